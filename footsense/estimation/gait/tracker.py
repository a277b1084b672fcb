"""Gait semantics of all legs, conversion by conversion.

Contact and its thresholds are those of `baseline/contact.py`. In Python numbers: for six legs, numpy's calls take
longer.
"""

import math
from collections.abc import Sequence

import numpy as np

from footsense.estimation.baseline.contact import ContactDetector
from footsense.estimation.gait.frame import EventKind, GaitEvent, GaitFrame
from footsense.estimation.gait.leg import LegGait
from footsense.estimation.gait.slip import Friction
from footsense.ports import Load


class GaitTracker:
    """Gait semantics of all legs.

    Args:
        n_legs: Legs of a frame.
    """

    def __init__(self, n_legs: int) -> None:
        self._friction = Friction()
        self._legs = [LegGait(self._friction) for _ in range(n_legs)]
        self._changed = True

    def observe(self, load: Load, contacts: Sequence[ContactDetector], now_ns: int) -> GaitFrame:
        """Return the gait as of `now_ns`.

        Args:
            load: Loads of all legs as of `now_ns`; NaN forces where they may not be used.
            contacts: Contact of each leg, as of the same readings.
            now_ns: Current time [ns].
        """
        events: list[GaitEvent] = []
        shares_n, rows = [], []
        legs = self._legs
        parts = zip(
            legs,
            contacts,
            load.force_n.tolist(),
            load.sigma_n.tolist(),
            load.contact.tolist(),
            load.contact_sigma.tolist(),
            strict=True,
        )
        for row, (leg, contact, force_n, sigma_n, point, point_sigma) in enumerate(parts):
            for kind, dated in leg.observe(contact, force_n, sigma_n, point, point_sigma, now_ns):
                events.append(GaitEvent(EventKind(kind), row, dated.t_ns, dated.sigma_s))
            known = math.isfinite(force_n[2])
            shares_n.append((max(force_n[2], 0.0) if leg.contact else 0.0) if known else math.nan)
            ground = leg.ground
            rows.append(
                (
                    leg.probability,
                    ground.normal_sigma_rad,
                    ground.friction_use,
                    ground.friction_use_sigma,
                    *ground.normal,
                )
            )
        total_n = sum(share_n for share_n in shares_n if math.isfinite(share_n))
        values = np.array(rows)
        states = np.array([(leg.contact, leg.raw, leg.slip) for leg in legs], np.uint8)
        if events or self._changed:
            self._changed = False
            self._times = (
                np.array([leg.touchdown.t_ns for leg in legs], np.int64),
                np.array([leg.touchdown.sigma_s for leg in legs]),
                np.array([leg.lift_off.t_ns for leg in legs], np.int64),
                np.array([leg.lift_off.sigma_s for leg in legs]),
            )
        touchdown_ns, touchdown_sigma_s, lift_off_ns, lift_off_sigma_s = self._times
        return GaitFrame(
            t_ns=now_ns,
            contact=states[:, 0].astype(np.bool_),
            contact_raw=states[:, 1].astype(np.bool_),
            probability=values[:, 0],
            touchdown_ns=touchdown_ns,
            touchdown_sigma_s=touchdown_sigma_s,
            lift_off_ns=lift_off_ns,
            lift_off_sigma_s=lift_off_sigma_s,
            load_share=np.array(shares_n) / (total_n or math.nan),
            normal=values[:, 4:],
            normal_sigma_rad=values[:, 1],
            friction_use=values[:, 2],
            friction_use_sigma=values[:, 3],
            slip=states[:, 2],
            friction=self._friction.coefficient,
            all_in_air=all(not leg.contact and leg.known for leg in legs),
            events=tuple(events),
        )
