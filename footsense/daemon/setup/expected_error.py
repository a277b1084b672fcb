"""How far the force of each foot is expected to err by what nobody knows of the foot itself.

A foot that nobody has calibrated differs from its design by the tolerances of its manufacture
(`footsense.sim.uncalibrated`). Of a calibrated foot the error that its fit has left is known, and a robot that stands
or walks tells neither stiffness nor mounting. Since its calibration the gains of its elements have wandered: those of a
measured insole are others in each session, of one day or another (page `real-sensors`).

The tolerances are those with which simulated feet err as the paper's do, and no foot has been made; the errors are
means over feet and loads, as of normal distributions, and one foot may err twice as much.
"""

import math
from datetime import datetime, timedelta
from typing import NamedTuple, Self

from footsense.foot.calibration_files import FootCalibration
from footsense.foot.parameters import ForceUncertainty
from footsense.sim.fabrication import MOUNT_SIGMA_RAD, uncertainty_of_parameters

#: Means of the size of a normal deviate, and of the distance of a point of two, over the standard deviation of each.
_MEAN_SIZE, _MEAN_DISTANCE = math.sqrt(2.0 / math.pi), math.sqrt(math.pi / 2.0)
#: Of a foot that is not calibrated and whose type has no response table.
UNKNOWN = ForceUncertainty(1.0, 1.0)


class ExpectedError(NamedTuple):
    """Expected error of the force of a foot, mean over loads.

    Attributes:
        size_rel: Of its size, over it [1]; NaN where it is not known.
        direction_deg: Of its direction [deg], same.
    """

    size_rel: float
    direction_deg: float

    @classmethod
    def of(cls, uncertainty: ForceUncertainty) -> Self:
        """Return the means of normal distributions of these standard deviations."""
        if uncertainty == UNKNOWN:
            return cls(math.nan, math.nan)
        angle_rad = math.atan(_MEAN_DISTANCE * uncertainty.across_rel)
        return cls(_MEAN_SIZE * uncertainty.along_rel, math.degrees(angle_rad))


def uncertainty_of_calibrated(found: FootCalibration) -> ForceUncertainty:
    """Return what nobody knows of a foot just calibrated: what its fit left, and what standing or walking hides."""
    pressed = not (found.manifest.by_standing or found.manifest.by_walking)
    return uncertainty_of_parameters(found.parameters, pressed=pressed)


def uncertainty_since(found: FootCalibration, at: str, wear: ForceUncertainty) -> ForceUncertainty:
    """Return what nobody knows of a calibrated foot some time later.

    Its gains are taken to wander like a random walk that is pulled back within a day: as far as between two sessions
    when a few days have passed. That the time is a day is an assumption. An hour before its calibration and earlier
    the clock is wrong, and nothing is known.

    Args:
        found: The calibration.
        at: The time, UTC, ISO 8601.
        wear: What the gains of another session make uncertain.
    """
    age = datetime.fromisoformat(at) - datetime.fromisoformat(found.manifest.made)
    share = 1.0
    if age > -timedelta(hours=1):
        share = math.sqrt(-math.expm1(-abs(age / timedelta(days=1))))
    return uncertainty_of_calibrated(found).plus(wear, share)


def electrodes_error_deg(unknown: ForceUncertainty, found: FootCalibration | None, at: str) -> float:
    """Return the direction error to expect by electrodes that nobody has found, or that have wandered since [deg].

    Args:
        unknown: What nobody knows of the foot.
        found: Its calibration; None without one.
        at: The time, UTC, ISO 8601; before that of the calibration it is wrong, and nothing is said to have wandered.
    """
    known_rel = MOUNT_SIGMA_RAD if found is None else uncertainty_of_calibrated(found).across_rel
    if found is not None and datetime.fromisoformat(at) < datetime.fromisoformat(found.manifest.made):
        return 0.0
    across_rel = math.sqrt(max(unknown.across_rel**2 - known_rel**2, 0.0))
    return ExpectedError.of(ForceUncertainty(0.0, across_rel)).direction_deg


def error_text(uncertainty: ForceUncertainty) -> str:
    """Return the expected error of a foot in words."""
    error = ExpectedError.of(uncertainty)
    if math.isnan(error.direction_deg):
        return "unknown size"
    return f"{error.direction_deg:.2g} deg in direction and {error.size_rel:.0%} in size"
