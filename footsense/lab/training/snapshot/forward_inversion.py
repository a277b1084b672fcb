"""Inversion of the sensor's forward model (bent electrodes, closing gaps): from closures to mean free closures.

Elastance gives the closure of a flat gap. A plate that bends into its cavity has a smaller distance in the middle,
which dominates the capacitance, and where the middle closes, the rest carries. The response table has both: a cell's
free closure follows the elements' mean closures m by a linear profile P (fitted on loads of the kind to be read), the
air of closed cavities and contact take away their part, and the cells' capacitances add up. Newton's method finds the
m that explain the measured capacitances:

    C(m) = sum over cells of eps0 dA / (g - d + t / eps_r),      d = limited(P m),      C(m) = C measured

m is linear in the load although gaps close, so an estimator fitted at 50 and 150 gf is right at 100 gf too.
"""

from dataclasses import dataclass

import numpy as np

from footsense.foot import gap_contact
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Foot
from footsense.frames import Vector
from footsense.lab.response import spherical_cap_normals

#: Lowest elevation of the centred loads that the profile is fitted on [deg]: a little below the paper's lowest.
_MIN_FITTED_ELEVATION_DEG = 38.0
#: Rounds of Newton's method; six bring 1 um to 1e-6 um with gaps closed.
_NEWTON_ROUNDS = 8
#: Largest step of a round over the gap [1], and the step of the differences [um].
_LARGEST_REL, _STEP_UM = 0.2, 1e-3
#: Largest unexplained capacitance [pF]: a thousandth of the converter's noise.
_TOLERANCE_PF = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class ForwardModel:
    """Forward model of a foot: capacitances as a function of the closures without gap contact.

    Attributes:
        response: The foot.
        cell_closure_per_element_mean: Closure of each cell per mean closure of each element [1], shape (elements,
            cells).
    """

    response: FootResponse
    cell_closure_per_element_mean: Vector

    def capacitance_pf(self, mean_um: Vector) -> Vector:
        """Return the capacitances [pF] from closures without gap contact [um], shape (n, elements) each."""
        return Foot(self.response).capacitance_of_free_closures_pf(
            mean_um @ self.cell_closure_per_element_mean
        )

    def element_free_closure_um(self, closure_um: Vector) -> Vector:
        """Return the closures without gap contact [um], (n, elements), that explain closures by elastance.

        Args:
            closure_um: Closures by elastance [um], shape (n, elements), as `Cases` have them.

        Raises:
            ArithmeticError: No load gives such a capacitance.
        """
        target_pf = self.response.design.capacitance_pf(closure_um)
        mean, largest_um = closure_um.copy(), _LARGEST_REL * self.response.design.gap_um
        for _ in range(_NEWTON_ROUNDS):
            computed = self.capacitance_pf(mean)
            if np.abs(target_pf - computed).max(initial=0.0) < _TOLERANCE_PF:
                return mean
            moved = [self.capacitance_pf(mean + _STEP_UM * unit) for unit in np.eye(mean.shape[1])]
            slope = (np.stack(moved, axis=2) - computed[:, :, None]) / _STEP_UM
            step = np.linalg.solve(slope, (target_pf - computed)[:, :, None])[:, :, 0]
            mean += np.clip(step, -largest_um, largest_um)
        left = np.abs(target_pf - self.capacitance_pf(mean)).max()
        if left < _TOLERANCE_PF:
            return mean
        raise ArithmeticError(f"no closures explain these capacitances: {left:.3g} pF are left")


def forward_model(response: FootResponse) -> ForwardModel:
    """Return the forward model of a foot under centred loads."""
    direction = spherical_cap_normals(_MIN_FITTED_ELEVATION_DEG, rings=24, spokes=72)
    cells = response.free_closure_um(direction, direction)
    closure_per_mean = np.asarray(
        np.linalg.lstsq(gap_contact.element_means(cells), cells, rcond=None)[0], np.float64
    )
    return ForwardModel(response, closure_per_mean)
