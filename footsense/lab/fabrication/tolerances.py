"""Printed tolerances: as wide as the lab's Monte Carlo of a typical foot assumed, and no wider.

The lab draws each gap, film, stiffness and mounting with an rms; a drawing has limits. Printed are twice the rms. What
the electrodes' size and their offset do to a capacitance is counted as a gap, and leaves the spacer the rest.
"""

import math
from dataclasses import dataclass

from footsense.lab.fabrication import process
from footsense.lab.fabrication.array import ElementArray
from footsense.lab.geometry import FootDesign
from footsense.lab.monte_carlo.sweeps import TYPICAL
from footsense.sim.foot.fabrication import FootTolerances

#: Printed limit over the assumed rms [1]: 95 % of normal deviates lie within.
LIMIT_OVER_RMS = 2.0
#: Step to which the limit of the spacer is rounded [um].
_STEP_UM = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Tolerance:
    """A dimension of the drawing with its limits.

    Attributes:
        name: What it is.
        nominal: Its designed value.
        limit: Largest deviation to either side.
        unit: Unit of both.
        counts: How much of the assumed quantity the limit uses up, in the unit of `allowed`.
        allowed: Largest deviation that the lab's Monte Carlo assumed.
        assumed: What was assumed, for people.
    """

    name: str
    nominal: float
    limit: float
    unit: str
    counts: float
    allowed: float
    assumed: str

    @property
    def kept(self) -> bool:
        """Whether the limit is no wider than what was assumed."""
        return self.counts <= self.allowed * (1.0 + 1e-9)


@dataclass(frozen=True, slots=True)
class Budget:
    """Deviations of a capacitance by the size and the offset of its electrodes.

    Attributes:
        design: The foot.
        array: Its array.
    """

    design: FootDesign
    array: ElementArray

    @property
    def distance_um(self) -> float:
        """Distance of the electrodes in air, the film's share included [um]."""
        return self.design.gap_um + self.design.capacitor.film_equivalent_um

    @property
    def etch_rel(self) -> float:
        """Largest deviation of an electrode's area by etching [1]."""
        return 2.0 * process.ETCH_MM / self.array.electrode_mm

    @property
    def offset_rel(self) -> float:
        """Largest loss of overlap by the offset of the flexes along both axes [1]."""
        return math.sqrt(2.0) * process.REGISTRATION_MM / self.array.electrode_mm

    @property
    def area_um(self) -> float:
        """Both, as the gap with the same effect on a capacitance [um]."""
        return math.hypot(self.etch_rel, self.offset_rel) * self.distance_um

    def gap_limit_um(self, assumed: FootTolerances = TYPICAL) -> float:
        """Return the limit of the gap that is left to the spacer [um], rounded down; 0 if there is none."""
        left = (LIMIT_OVER_RMS * assumed.gap_um) ** 2 - self.area_um**2
        return math.floor(math.sqrt(max(left, 0.0)) / _STEP_UM) * _STEP_UM

    def most_area_um(self, assumed: FootTolerances = TYPICAL) -> float:
        """Return the largest `area_um` that leaves the spacer a limit [um]."""
        return math.sqrt((LIMIT_OVER_RMS * assumed.gap_um) ** 2 - _STEP_UM**2)


def shore_a(youngs_mpa: float) -> float:
    """Return the Shore A hardness of a rubber with Young's modulus [MPa].

    Source:
        Gent, Rubber Chemistry and Technology 31, 896, 1958.

    Example:
        >>> round(shore_a(5.2))
        69
    """
    ratio = youngs_mpa * 0.137505 / 0.0981
    return (254.0 * ratio - 56.0) / (7.62336 + 2.54 * ratio)


def printed(design: FootDesign, assumed: FootTolerances = TYPICAL) -> list[Tolerance]:
    """Return the tolerances of a foot's drawing.

    Args:
        design: The foot.
        assumed: Rms deviations that the lab's Monte Carlo assumed.
    """
    budget = Budget(design, ElementArray.of(design))
    gap, film = LIMIT_OVER_RMS * assumed.gap_um, LIMIT_OVER_RMS * assumed.film_um
    gap_text, limit_um = f"gap +-{gap:g} um", budget.gap_limit_um(assumed)
    with_area = math.hypot(limit_um, budget.area_um)
    mount_deg, stiffness = LIMIT_OVER_RMS * assumed.mount_deg, LIMIT_OVER_RMS * assumed.stiffness_rel
    play_deg = math.degrees(process.CHANNEL_PLAY_MM / process.socket_radius_mm(design.ball_radius_mm))
    softest = shore_a(design.rubber.youngs_mpa * (1.0 - stiffness))
    hardest = shore_a(design.rubber.youngs_mpa * (1.0 + stiffness))
    shore = shore_a(design.rubber.youngs_mpa)
    shore_limit = math.floor(min(hardest - shore, shore - softest))
    rubber_mpa = design.rubber.youngs_mpa
    worst_rel = max(abs(_youngs_mpa(shore + s * shore_limit) / rubber_mpa - 1.0) for s in (-1.0, 1.0))
    return [
        Tolerance(
            name="spacer (gap)", nominal=design.gap_um, limit=limit_um, unit="um",
            counts=with_area, allowed=gap, assumed=f"{gap_text}, with area and offset of the electrodes",
        ),
        Tolerance(
            name="electrode side", nominal=design.electrode_mm, limit=process.ETCH_MM, unit="mm",
            counts=budget.etch_rel * budget.distance_um, allowed=gap, assumed=gap_text,
        ),
        Tolerance(
            name="offset of row flex and column flex", nominal=0.0, limit=process.REGISTRATION_MM, unit="mm",
            counts=budget.offset_rel * budget.distance_um, allowed=gap, assumed=gap_text,
        ),
        Tolerance(
            name="film", nominal=design.film_um, limit=film, unit="um",
            counts=film, allowed=film, assumed=f"film +-{film:g} um",
        ),
        Tolerance(
            name="hardness of the rubber", nominal=round(shore), limit=shore_limit, unit="Shore A",
            counts=worst_rel, allowed=stiffness, assumed=f"stiffness +-{stiffness:.0%}",
        ),
        Tolerance(
            name="angle of the foot on the leg", nominal=0.0, limit=round(play_deg, 1), unit="deg",
            counts=play_deg, allowed=mount_deg, assumed=f"mounting +-{mount_deg:g} deg",
        ),
    ]  # fmt: skip


def _youngs_mpa(hardness: float) -> float:
    """Return Young's modulus of a Shore A hardness [MPa], the inverse of `shore_a`."""
    return 0.0981 * (56.0 + 7.62336 * hardness) / (0.137505 * (254.0 - 2.54 * hardness))
