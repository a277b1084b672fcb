"""A foot whose cavities are sealed, at rest: closures where the enclosed air resists them.

A closure d of the gap leaves the share v = 1 - d/g of a cavity's volume, d and g being means over its area. The air in
it then has the pressure p of the gas law, and presses on both plates by what it is above the ambient pressure p_a:

    p v^n = m,        q = p - p_a,        d = d0 - B (l + A q)

with d0 the closures of an empty foot, B the compliance, l the forces of closed gaps (`foot/gap_contact.py`) and A the
area of a cell. m is the pressure that the air would have in the unloaded gap: the measure of its amount. n is 1 where
the air keeps the temperature of the walls, which a gap of 20 um does within microseconds, and 1.4 where it keeps its
heat. The pressures are found by Newton's method; the problem is the gradient of a convex function, so it has one
solution.
"""

import math
from functools import cached_property

import numpy as np

from footsense.foot.gap_contact import CELLS_PER_ELEMENT, element_means, solve_contact_lcp
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Deviations, Specimen
from footsense.frames import Vector

#: Pressure of the standard atmosphere [kPa].
AMBIENT_KPA = 101.325
#: Room temperature [K].
ROOM_TEMPERATURE_K = 296.15
#: Exponent n of the gas law: walls and air at one temperature, and no heat exchanged (air).
ISOTHERMAL, ADIABATIC = 1.0, 1.4
#: Newton steps at most; six are usual, eight with gaps in contact.
_MAX_NEWTON_STEPS = 60
#: Largest rest of a mean closure over the gap [1].
_TOLERANCE_REL = 1e-10
#: Least share of the absolute pressure that a step leaves [1], so that no pressure becomes negative.
_MIN_REMAINING_PRESSURE_REL = 0.2


class SealedFoot(Specimen):
    """A foot with sealed cavities, one amount of air in all.

    Args:
        response: Response of its type.
        deviations: Its deviations; None for a foot exactly as designed.
        gas_kpa: Pressure of the air in the unloaded gap [kPa].
        ambient_kpa: Ambient pressure [kPa].
        exponent: Exponent n of the gas law.

    Raises:
        ArithmeticError: Newton's method does not converge, here or under a load.
    """

    def __init__(
        self,
        response: FootResponse,
        deviations: Deviations | None = None,
        *,
        gas_kpa: float = AMBIENT_KPA,
        ambient_kpa: float = AMBIENT_KPA,
        exponent: float = ISOTHERMAL,
    ) -> None:
        self._gas_mpa, self._ambient_mpa, self._exponent = 1e-3 * gas_kpa, 1e-3 * ambient_kpa, exponent
        super().__init__(response, deviations)

    @cached_property
    def _opening(self) -> Vector:
        """Opening of each cell under a unit pressure in each cavity [um/MPa], shape (324, 9)."""
        by_cavity = self._compliance_um_per_n.reshape(-1, len(self.gap_um), CELLS_PER_ELEMENT).sum(axis=2)
        opening: Vector = by_cavity * self.response.design.electrode_area_mm2 / CELLS_PER_ELEMENT
        return opening

    def _limited_closures_um(self, free_um: Vector) -> Vector:
        excess_mpa = self._pressures_without_contact_mpa(element_means(free_um))
        closure_um = free_um - excess_mpa @ self._opening.T
        for load in np.flatnonzero((closure_um > self._gap_of_cell_um).any(axis=1)):
            closure_um[load] = self._closures_in_contact_um(free_um[load], excess_mpa[load])
        return closure_um

    def _volume_and_negative_slope(self, excess_mpa: Vector) -> tuple[Vector, Vector]:
        """Return each cavity's relative volume [1] at an excess pressure, and its negative derivative [1/MPa]."""
        pressure_mpa = excess_mpa + self._ambient_mpa
        volume: Vector = (self._gas_mpa / pressure_mpa) ** (1.0 / self._exponent)
        return volume, volume / self._exponent / pressure_mpa

    def _pressures_without_contact_mpa(self, free_um: Vector) -> Vector:
        """Return the excess air pressures [MPa], shape (n, 9), for gaps that do not touch.

        Raises:
            ArithmeticError: Newton's method does not converge.
        """
        excess_mpa, mean_opening = np.zeros_like(free_um), element_means(self._opening.T).T
        for _ in range(_MAX_NEWTON_STEPS):
            volume, slope = self._volume_and_negative_slope(excess_mpa)
            rest_um = free_um - excess_mpa @ mean_opening.T - self.gap_um * (1.0 - volume)
            if (np.abs(rest_um) <= _TOLERANCE_REL * self.gap_um).all():
                return excess_mpa
            matrix = mean_opening + (self.gap_um * slope)[:, :, None] * np.eye(len(self.gap_um))
            step_mpa = np.asarray(np.linalg.solve(matrix, rest_um[:, :, None])[:, :, 0], np.float64)
            excess_mpa = self._after_newton_step_mpa(excess_mpa, step_mpa)
        raise ArithmeticError(
            "the pressures of the cavities do not converge: is the compliance positive definite?"
        )

    def _closures_in_contact_um(self, free_um: Vector, excess_mpa: Vector) -> Vector:
        """Return the cell closures [um], shape (324,), of one load; `excess_mpa` is where the search starts.

        Raises:
            ArithmeticError: Newton's method does not converge.
        """
        largest_um, share = math.inf, 1.0
        step_mpa = np.zeros(len(self.gap_um))
        for _ in range(_MAX_NEWTON_STEPS):
            closure_um = solve_contact_lcp(
                free_um - self._opening @ excess_mpa, self._gap_of_cell_um, self._compliance_um_per_n
            ).cell_closures_um
            volume, slope = self._volume_and_negative_slope(excess_mpa)
            rest_um = element_means(closure_um) - self.gap_um * (1.0 - volume)
            size_um = float(np.abs(rest_um).max())
            if size_um <= _TOLERANCE_REL * self.gap_um.min():
                return closure_um
            if size_um > largest_um and share > 1e-3:
                # The set of closed cells changed too much: half of the step.
                share *= 0.5
                excess_mpa = excess_mpa - share * step_mpa
                continue
            largest_um, share = size_um, 1.0
            closed = np.flatnonzero(closure_um >= self._gap_of_cell_um)
            compliance = self._compliance_um_per_n[:, closed]
            carried = np.linalg.solve(compliance[closed], self._opening[closed])
            stiffness = element_means((self._opening - compliance @ carried).T).T + np.diag(
                self.gap_um * slope
            )
            newton_mpa = np.asarray(np.linalg.solve(stiffness, rest_um), np.float64)
            moved = self._after_newton_step_mpa(excess_mpa, newton_mpa)
            step_mpa, excess_mpa = moved - excess_mpa, moved
        raise ArithmeticError("the pressures of the cavities do not converge with gaps in contact")

    def _after_newton_step_mpa(self, excess_mpa: Vector, step_mpa: Vector) -> Vector:
        """Return the excess pressures after a Newton step [MPa], shortened where it would give a vacuum."""
        least = _MIN_REMAINING_PRESSURE_REL * (excess_mpa + self._ambient_mpa) - self._ambient_mpa
        return np.maximum(excess_mpa + step_mpa, least)
