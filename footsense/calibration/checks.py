"""Checks of sessions: one foot in all of them, and units and axes of the reference against the foot's own estimates.

A carelessly made foot errs by some 20 deg and 20 %, which is enough to tell a kilogram-force from a newton and left
from right. So the checks find wrong units and axes, but no error of the reference's own calibration.
"""

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np
from msgspec.structs import astuple

from footsense.calibration.evaluation import DesignModels
from footsense.calibration.recorded_session import RecordedSession
from footsense.config.test_stand import StandConfig
from footsense.errors import CalibrationError
from footsense.foot.directions import angles_between_deg
from footsense.frames import Vector
from footsense.reference.sensor_mounting import NEWTONS_PER_UNIT, rotation_matrix

#: Largest difference of an element's unloaded reading between sessions of one foot [1], that of a tare.
_SAME_FOOT_TOLERANCE_REL = 0.03
#: Fewest loads of a finding.
_MIN_LOADS = 5
#: Ratio of magnitudes that no foot reaches, and the ratio to which another unit has to explain it.
_SUSPICIOUS_RATIO_THRESHOLD, _EXPLAINED_RATIO_THRESHOLD = 2.0, 1.5
#: Mean angles that hardly a foot reaches, and that no foot reaches, even if no axes fit [deg]: of 60 made as badly as
#: the paper's, the worst errs by 35.
_SUSPICIOUS_ANGLE_THRESHOLD_DEG, _IMPOSSIBLE_ANGLE_THRESHOLD_DEG = 35.0, 50.0
#: Angles by which other axes have to be better, and better than the next [deg].
_MIN_IMPROVEMENT_DEG, _MIN_LEAD_DEG = 20.0, 8.0


def reference_findings(test_stand: StandConfig, reference_n: Vector, estimate_n: Vector) -> list[str]:
    """Return wrong units or axes of a reference sensor, one text line each; empty with fewer than 5 estimates.

    Args:
        test_stand: Units, axes and mount of the sensor.
        reference_n: Forces of the reference [N], shape (n, 3).
        estimate_n: The foot's own estimates [N], same shape, NaN where the network has none.
    """
    known = np.isfinite(estimate_n).all(axis=1) & (np.linalg.norm(estimate_n, axis=1) > 0.0)
    if known.sum() < _MIN_LOADS:
        return []
    reference_n, estimate_n = reference_n[known], estimate_n[known]
    return [
        *_unit_findings(reference_n, estimate_n, test_stand.units),
        *_axis_findings(reference_n, estimate_n, test_stand),
    ]


def _unit_findings(reference_n: Vector, estimate_n: Vector, units: str) -> Iterator[str]:
    """Yield a finding if another unit explains the ratio of reference to estimated magnitudes."""
    ratio = float(np.median(np.linalg.norm(reference_n, axis=1) / np.linalg.norm(estimate_n, axis=1)))
    if abs(math.log(ratio)) < math.log(_SUSPICIOUS_RATIO_THRESHOLD):
        return
    off = {
        unit: abs(math.log(ratio * value / NEWTONS_PER_UNIT[units]))
        for unit, value in NEWTONS_PER_UNIT.items()
    }
    best = min(off, key=off.__getitem__)
    finding = f"the reference reads {ratio:.3g} times the force that the foot itself estimates"
    if best != units and off[best] < math.log(_EXPLAINED_RATIO_THRESHOLD):
        yield f"{finding}: its readings seem to be in {best}, and the test stand's file says units: {units}"
    else:
        yield (
            f"{finding}, which no other unit explains; check units and unit_per_count in the test stand's file, "
            "and the foot"
        )


def _axis_findings(reference_n: Vector, estimate_n: Vector, test_stand: StandConfig) -> Iterator[str]:
    """Yield a finding if other axes explain the angles between reference and estimated forces."""
    given_deg = float(angles_between_deg(reference_n, estimate_n).mean())
    if given_deg < _SUSPICIOUS_ANGLE_THRESHOLD_DEG:
        return
    axes, to_sensor = astuple(test_stand.axes), rotation_matrix(test_stand.mount_deg).T
    inner_n = reference_n @ to_sensor.T
    tried = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            turned_n = (inner_n[:, order] * signs) @ to_sensor
            tried.append((float(angles_between_deg(turned_n, estimate_n).mean()), order, signs))
    tried.sort()
    (best_deg, order, signs), (second_deg, *_) = tried[:2]
    finding = f"the reference points {given_deg:.0f} deg away from the force that the foot itself estimates"
    if best_deg < given_deg - _MIN_IMPROVEMENT_DEG and second_deg - best_deg > _MIN_LEAD_DEG:
        names = [_signed_axis(axes[source], sign) for source, sign in zip(order, signs, strict=True)]
        fits = ", ".join(f"{axis}: {name}" for axis, name in zip("xyz", names, strict=True))
        yield f"{finding}: axes: {{{fits}}} would fit to {best_deg:.0f} deg"
    elif given_deg > _IMPOSSIBLE_ANGLE_THRESHOLD_DEG:
        yield (
            f"{finding}; check the signs of axes in the test stand's file, and press from more sides to see which "
            "would fit"
        )


def _signed_axis(axis: str, sign: float) -> str:
    """Return an axis name with its sign, such as `-x`; the opposite one if `sign` is negative.

    Example:
        >>> _signed_axis("-x", -1.0), _signed_axis("+y", -1.0), _signed_axis("z", 1.0)
        ('x', '-y', 'z')
    """
    negative = (axis[0] == "-") != (sign < 0)
    return f"{'-' if negative else ''}{axis[-1]}"


def require_one_foot(sessions: Sequence[RecordedSession]) -> None:
    """Raise an error if the unloaded readings of the sessions are not those of one and the same foot.

    Raises:
        CalibrationError: One is not, or has no accepted load.
    """
    first, first_pf = sessions[0], None
    for session in sessions:
        if not session.loads:
            raise CalibrationError(
                f"{session.path}: no load is accepted; {'; '.join(session.warnings) or 'it has none'}"
            )
        unloaded_pf = session.loads.median_baseline_pf
        first_pf = unloaded_pf if first_pf is None else first_pf
        difference_rel = unloaded_pf / first_pf - 1.0
        worst = int(np.argmax(np.abs(difference_rel)))
        if abs(difference_rel[worst]) > _SAME_FOOT_TOLERANCE_REL:
            raise CalibrationError(
                f"{session.path}: element {worst} of {session.foot} reads {unloaded_pf[worst]:.3f} pF unloaded, "
                f"{first_pf[worst]:.3f} pF in {first.path}; two feet with one id? at most "
                f"{_SAME_FOOT_TOLERANCE_REL:.0%} differ"
            )


def require_consistent_reference(models: DesignModels, sessions: Sequence[RecordedSession]) -> None:
    """Raise an error if a session's reference forces contradict the foot's own estimates (units, axes).

    Args:
        models: Models of the foot's type.
        sessions: Its sessions, each with loads; one whose recording does not describe its test stand is not checked.

    Raises:
        CalibrationError: It contradicts at least one; the message names each.
    """
    found = []
    for session in sessions:
        if session.test_stand is None:
            continue
        own_n = models.estimate(session.loads, None).force_n
        if findings := reference_findings(session.test_stand, session.loads.force_n, own_n):
            found.append(f"{session.path}: {'; '.join(findings)}")
    if found:
        raise CalibrationError(f"{'; '.join(found)}; correct the test stand's file, and record again")
