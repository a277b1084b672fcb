"""Capacitance of an element that `footsense probe` should read on a finished foot, without the wiring's."""

import math
from dataclasses import dataclass

import numpy as np

from footsense.foot.cavity.fringe import fringe_pf
from footsense.foot.gap_contact import ALL_CELLS
from footsense.lab.fabrication.array import ElementArray
from footsense.lab.fabrication.tolerances import LIMIT_OVER_RMS, Budget
from footsense.lab.geometry import FootDesign
from footsense.lab.monte_carlo.sweeps import TYPICAL


@dataclass(frozen=True, slots=True, kw_only=True)
class Expected:
    """An unloaded element.

    Attributes:
        plates_pf: Capacitance of its plates [pF].
        fringe_pf: Capacitance of the field at their edges [pF].
        limit_rel: Largest deviation of the plates' capacitance within the printed tolerances [1].
        stray_pf: Largest stray capacitance that the design assumed to be unknown [pF].
    """

    plates_pf: float
    fringe_pf: float
    limit_rel: float
    stray_pf: float

    @property
    def unloaded_pf(self) -> float:
        """What the converter reads [pF]."""
        return self.plates_pf + self.fringe_pf

    @property
    def lowest_pf(self) -> float:
        """Least reading of a foot within its tolerances [pF]."""
        return self.unloaded_pf - self.plates_pf * self.limit_rel - self.stray_pf

    @property
    def highest_pf(self) -> float:
        """Largest reading of a foot within its tolerances [pF]."""
        return self.unloaded_pf + self.plates_pf * self.limit_rel + self.stray_pf


def expected(design: FootDesign, overlap_mm2: float) -> Expected:
    """Return the expected reading of an element.

    Args:
        design: The foot.
        overlap_mm2: Area in which its row and its column face each other [mm2].
    """
    capacitor = design.capacitor
    budget = Budget(design, ElementArray.of(design))
    film_um = LIMIT_OVER_RMS * TYPICAL.film_um / design.film_eps_r
    # The gap's limit holds the electrodes' area and offset already: `tolerances`.
    limit_um = math.hypot(LIMIT_OVER_RMS * TYPICAL.gap_um, film_um)
    spacing_um = np.full(ALL_CELLS, design.gap_um + design.film_um)
    return Expected(
        plates_pf=capacitor.unloaded_pf * overlap_mm2 / capacitor.electrode_area_mm2,
        fringe_pf=float(fringe_pf(capacitor, spacing_um)[0]),
        limit_rel=limit_um / budget.distance_um,
        stray_pf=LIMIT_OVER_RMS * TYPICAL.stray_pf,
    )
