"""Precomputed capacitances of a foot over a log of loads, to simulate long walks quickly.

A log repeats, and so does what its loads do to a foot, rubber included, once the creep of the first rounds is over: the
first rounds are computed one after the other, with the rubber's memory, and all later ones are as the last of them.
"""

from bisect import bisect_right

import numpy as np

from footsense.foot.specimen import Specimen
from footsense.frames import Vector
from footsense.sim.loads.load_log import RepeatedLog
from footsense.sim.rubber import ElementCreep, ViscoelasticRubber

#: Rounds of the log that are computed; after the second, creep of 10 s is at 90 % of its end in logs of 12 s.
_N_ROUNDS = 2
#: Loads that are computed at once: each takes 15 kB.
_CHUNK = 1000


class LogTable:
    """Table of one foot's capacitances over a repeated log: `capacitance_pf`.

    Args:
        foot: The foot.
        log: The log.
        leg: Leg of the foot.
        rubber: Makes its rubber; None for elastic rubber.
        element_creep: Creep of its single elements; None for none.
    """

    def __init__(
        self,
        foot: Specimen,
        log: RepeatedLog,
        leg: str,
        rubber: ViscoelasticRubber | None = None,
        element_creep: ElementCreep | None = None,
    ) -> None:
        self._from_ns, self._t_ns = log.from_ns, log.t_ns.tolist()
        self._unloaded_pf: list[float] = foot.unloaded_pf.tolist()
        rounds: list[Vector] = []
        for number in range(_N_ROUNDS):
            t_ns = log.from_ns + number * log.t_ns[-1] + log.t_ns
            normal, force_n = log.contacts(leg, first=number == 0)
            if rubber is not None:
                loads = [
                    rubber.next_effective_load(*load)
                    for load in zip(t_ns.tolist(), normal, force_n, strict=True)
                ]
                normal, force_n = (np.array(column) for column in zip(*loads, strict=True))
            pf = _capacitance_pf(foot, normal, force_n)
            if element_creep is not None:
                pairs = zip(t_ns.tolist(), pf, strict=True)
                pf = np.array([element_creep.next_capacitance_pf(*pair) for pair in pairs])
            rounds.append(pf)
        self._rounds = rounds

    def capacitance_pf(self, t_ns: int) -> list[float]:
        """Return each element's capacitance at a time [pF], interpolated."""
        since_ns = t_ns - self._from_ns
        if since_ns < 0:
            return self._unloaded_pf
        number, within_ns = divmod(since_ns, self._t_ns[-1])
        rows_pf = self._rounds[min(number, _N_ROUNDS - 1)]
        row = bisect_right(self._t_ns, within_ns) - 1
        share = (within_ns - self._t_ns[row]) / (self._t_ns[row + 1] - self._t_ns[row])
        between_pf: list[float] = (rows_pf[row] + share * (rows_pf[row + 1] - rows_pf[row])).tolist()
        return between_pf


def _capacitance_pf(foot: Specimen, normal: Vector, force_n: Vector) -> Vector:
    """Return the capacitances under n loads [pF], shape (n, elements); a foot in the air costs nothing."""
    pf = np.tile(foot.unloaded_pf, (len(force_n), 1))
    loaded = np.flatnonzero(force_n.any(axis=1))
    for start in range(0, len(loaded), _CHUNK):
        rows = loaded[start : start + _CHUNK]
        pf[rows] = foot.capacitance_pf(normal[rows], force_n[rows])
    return pf
