"""How far the force of each foot is expected to err by what nobody knows of the foot itself.

A foot that nobody has calibrated differs from its design by the tolerances of its manufacture
(`footsense.sim.uncalibrated`). Of a calibrated foot the error that its fit has left is known, its elements have other
gains in each session after it, and a robot that stands or walks tells neither stiffness nor mounting.

The tolerances are those with which simulated feet err as the paper's do, and no foot has been made; the errors are
means over feet and loads, as of normal distributions, and one foot may err twice as much.
"""

import math
from typing import NamedTuple, Self

from footsense.foot.calibration_files import FootCalibration
from footsense.foot.parameters import ForceUncertainty
from footsense.sim.fabrication import uncertainty_of_parameters

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


def uncertainty_of_calibrated(found: FootCalibration, wear: ForceUncertainty) -> ForceUncertainty:
    """Return what nobody knows of a calibrated foot: its fit's rest, its wear, what standing or walking do not show."""
    pressed = not (found.manifest.by_standing or found.manifest.by_walking)
    return uncertainty_of_parameters(found.parameters, wear, pressed=pressed)


def error_text(uncertainty: ForceUncertainty) -> str:
    """Return the expected error of a foot in words."""
    error = ExpectedError.of(uncertainty)
    if math.isnan(error.direction_deg):
        return "unknown size"
    return f"{error.direction_deg:.2g} deg in direction and {error.size_rel:.0%} in size"
