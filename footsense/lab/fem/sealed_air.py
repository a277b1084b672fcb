"""A foot whose cavities are sealed, at rest: closures where the enclosed air resists them.

A closure d of the gap leaves the share v = 1 - d/g of a cavity's volume, d and g being means over its area. The air in
it then has the pressure p of the gas law, and presses on both plates by what it is above the ambient pressure p_a:

    p v = p_a,        q = p - p_a,        d = d0 - B (l + A q)

with d0 the closures of an empty foot, B the compliance, l the forces of closed gaps (`foot/gap_contact.py`) and A the
area of a cell. The air keeps the temperature of the walls, which a gap of 20 um does within microseconds. The unknowns
are the logarithms of p, by Powell's hybrid method; the problem is the gradient of a convex function, so it has one
solution.
"""

from functools import cached_property

import numpy as np
from scipy import optimize

from footsense.foot.gap_contact import CELLS_PER_ELEMENT, element_means, solve_contact_lcp
from footsense.foot.specimen import Specimen
from footsense.frames import Vector

#: Pressure of the standard atmosphere [MPa].
_AMBIENT_MPA = 0.101325
#: Tolerance of the pressures' logarithms, and largest rest of a mean closure over the gap [1].
_TOLERANCE_REL, _MAX_REST_REL = 1e-12, 1e-9


class SealedFoot(Specimen):
    """A foot with sealed cavities, in which the unloaded gap holds air of the standard atmosphere, as around them.

    Raises:
        ArithmeticError: The pressures are not found, here or under a load.
    """

    @cached_property
    def _opening(self) -> Vector:
        """Opening of each cell under a unit pressure in each cavity [um/MPa], shape (324, 9)."""
        by_cavity = self._compliance_um_per_n.reshape(-1, len(self.gap_um), CELLS_PER_ELEMENT).sum(axis=2)
        opening: Vector = by_cavity * self.response.design.electrode_area_mm2 / CELLS_PER_ELEMENT
        return opening

    def _limited_closures_um(self, free_um: Vector) -> Vector:
        return np.stack([self._closures_of_load_um(one) for one in free_um])

    def _closures_of_load_um(self, free_um: Vector) -> Vector:
        """Return the cell closures of one load [um], shape (324,).

        Raises:
            ArithmeticError: The pressures are not found.
        """

        def closures_um(ln_pressure: Vector) -> Vector:
            excess_um = self._opening @ (_AMBIENT_MPA * np.expm1(ln_pressure))
            return solve_contact_lcp(
                free_um - excess_um, self._gap_of_cell_um, self._compliance_um_per_n
            ).cell_closures_um

        def rest_and_slope_um(ln_pressure: Vector) -> tuple[Vector, Vector]:
            closure_um, pressure_mpa = closures_um(ln_pressure), _AMBIENT_MPA * np.exp(ln_pressure)
            volume = _AMBIENT_MPA / pressure_mpa
            closed = np.flatnonzero(closure_um >= self._gap_of_cell_um)
            columns = self._compliance_um_per_n[:, closed]
            yielding = self._opening - columns @ np.linalg.solve(columns[closed], self._opening[closed])
            slope_um = -element_means(yielding.T).T * pressure_mpa - np.diag(self.gap_um * volume)
            return element_means(closure_um) - self.gap_um * (1.0 - volume), slope_um

        found = optimize.root(
            rest_and_slope_um, np.zeros(len(self.gap_um)), jac=True, options={"xtol": _TOLERANCE_REL}
        )
        if not np.abs(found.fun).max() <= _MAX_REST_REL * self.gap_um.min():
            raise ArithmeticError(f"the pressures of the cavities are not found: {found.message}")
        return closures_um(found.x)
