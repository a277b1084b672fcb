"""Expected capacitance reading of an unloaded element of a finished foot, without the wiring's stray."""

import math
from dataclasses import dataclass

import numpy as np

from footsense.foot.gap_contact import CELLS_PER_ELEMENT, fringe_pf
from footsense.lab.fabrication.tolerances import LIMIT_OVER_RMS, overlap_area_deviation_rel
from footsense.lab.geometry import FootDesign
from footsense.sim.fabrication import FootTolerances


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpectedCapacitance:
    """Expected capacitance of an unloaded element, with tolerance limits.

    Attributes:
        plate_formula_pf: Capacitance of its plates [pF].
        fringe_pf: Capacitance of the field at their edges [pF].
        plate_tolerance_rel: Largest deviation of the plates' capacitance within the printed tolerances [1].
        max_unknown_stray_pf: Largest stray capacitance that the design assumed to be unknown [pF].
    """

    plate_formula_pf: float
    fringe_pf: float
    plate_tolerance_rel: float
    max_unknown_stray_pf: float

    @property
    def unloaded_pf(self) -> float:
        """Expected reading of the unloaded element [pF]."""
        return self.plate_formula_pf + self.fringe_pf

    @property
    def min_unloaded_pf(self) -> float:
        """Lowest reading of the unloaded element within the fabrication tolerances and the assumed stray [pF]."""
        return self.unloaded_pf - self.plate_formula_pf * self.plate_tolerance_rel - self.max_unknown_stray_pf

    @property
    def max_unloaded_pf(self) -> float:
        """Highest reading of the unloaded element within the fabrication tolerances and the assumed stray [pF]."""
        return self.unloaded_pf + self.plate_formula_pf * self.plate_tolerance_rel + self.max_unknown_stray_pf


def expected_capacitance(design: FootDesign, assumed: FootTolerances) -> ExpectedCapacitance:
    """Return the expected capacitance reading of an unloaded element with its limits.

    Args:
        design: The foot.
        assumed: Rms deviations that the design assumed.
    """
    capacitor = design.capacitor
    distance_um = design.gap_um + capacitor.film_equivalent_um
    limits_um = LIMIT_OVER_RMS * assumed.gap_um, LIMIT_OVER_RMS * assumed.film_um / design.film_eps_r
    spacing_um = np.full(CELLS_PER_ELEMENT, design.gap_um + design.film_um)
    return ExpectedCapacitance(
        plate_formula_pf=capacitor.unloaded_pf,
        fringe_pf=float(fringe_pf(capacitor, spacing_um)[0]),
        plate_tolerance_rel=math.hypot(
            math.hypot(*limits_um) / distance_um, overlap_area_deviation_rel(design.electrode_mm)
        ),
        max_unknown_stray_pf=LIMIT_OVER_RMS * assumed.stray_pf,
    )
