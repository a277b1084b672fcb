"""Parametric forward model of one foot: load and parameters to the readings of its elements.

Element i with cells c, unloaded reading C0 and the closures that the design's response predicts reads

    C_i = s_i + K mean_c 1 / (D_i - a_i d_c),     D_i = K / (C0_i - s_i),      K = eps0 A

with the stray s, the closure gain a, and closures d_c <= g_i of a solid (1 + k) times as stiff as designed, under a
load turned by the mount. A sheet off the balls' axis by o moves the
contact as seen from the sheet, to first order in o / R: its normal is n + o / R, and the force stays. The reference
reads (1 + r) f of a force f. The film does not appear: the unloaded distance D contains it.
"""

from collections.abc import Sequence

import numpy as np

from footsense.foot import gap_contact
from footsense.foot.directions import normalized, rotation
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import ContactLoads
from footsense.frames import ELEMENTS, Mask, Vector

# A foot's parameter vector; all zero is a foot as designed.
#: Slices of the parameters of single elements: stray [pF], closure gain minus one [1], gap minus the design's [um].
STRAY, GAIN, GAP = (slice(kind * ELEMENTS, (kind + 1) * ELEMENTS) for kind in range(3))
#: Slices of the parameters of the whole foot behind them: stiffness over the design's minus one [1], mount as a
#: rotation vector [rad], offset of the sheet from the axis of the balls along x and y over the ball's radius [1], and
#: gains of the reference along x, y, z minus one [1].
STIFFNESS, MOUNT, OFFSET, REFERENCE = slice(27, 28), slice(28, 31), slice(31, 33), slice(33, 36)
#: Their number of each kind, in the order of the vector, and of all.
PARAMETER_COUNTS = (ELEMENTS, ELEMENTS, ELEMENTS, 1, 3, 2, 3)
N_PARAMETERS = sum(PARAMETER_COUNTS)

#: Smallest distance of the electrodes [um]; the designed film is as thick as 6.3 um of air.
_MIN_DISTANCE_UM = 1.0
#: Distance to the gap within which a cell counts as closed [um].
_CLOSED_TOLERANCE_UM = 1e-6


def reference_gains(parameters: Vector) -> Vector:
    """Return the gain of the reference sensor along x, y, z, shape (3,), normalised to a mean of one."""
    gains: Vector = 1.0 + parameters[REFERENCE] - parameters[REFERENCE].mean()
    return gains


def shifted(parameters: Vector, which: slice, steps: Vector) -> Vector:
    """Return the parameters with those of a slice moved by their step; all have the shape (parameters,)."""
    moved = parameters.copy()
    moved[which] += steps[which]
    return moved


def _compliance_factor(parameters: Vector) -> float:
    """Return the compliance of the foot over that of the design [1]."""
    return 1.0 / (1.0 + float(parameters[STIFFNESS][0]))


class FootTwin:
    """Forward model of one foot; its methods take the parameter vector, shape (parameters,).

    Args:
        response: Response table of its foot type.
        unloaded_pf: Unloaded reading of each element, stray included [pF], shape (elements,).
    """

    def __init__(self, response: FootResponse, unloaded_pf: Vector) -> None:
        self._response = response
        self._unloaded_pf = unloaded_pf
        self._min_sine = np.sin(np.radians(response.min_elevation_deg))

    def parameter_bounds(self) -> tuple[Vector, Vector]:
        """Return the lower and the upper bound of each parameter, shape (parameters,) each."""
        lower, upper = np.full(N_PARAMETERS, -np.inf), np.full(N_PARAMETERS, np.inf)
        upper[STRAY] = 0.5 * self._unloaded_pf
        lower[GAIN], upper[GAIN] = -0.5, 1.0
        lower[GAP] = -0.9 * self._response.design.gap_um
        lower[STIFFNESS], upper[STIFFNESS] = -0.9, 20.0
        lower[OFFSET], upper[OFFSET] = -0.3, 0.3
        lower[REFERENCE], upper[REFERENCE] = -0.1, 0.1
        return lower, upper

    def gap_um(self, parameters: Vector) -> Vector:
        """Return the unloaded gap of each element [um], shape (elements,)."""
        gap_um: Vector = self._response.design.gap_um + parameters[GAP]
        return gap_um

    def cell_closures_um(self, parameters: Vector, loads: ContactLoads) -> Vector:
        """Return the closure of each cell of the gaps [um], shape (n, cells), limited to the cell's gap."""
        free_um = _compliance_factor(parameters) * self._designed_cell_closures_um(parameters, loads)
        gap_um = np.repeat(self.gap_um(parameters), gap_contact.CELLS_PER_ELEMENT)
        if not (free_um > gap_um).any():  # scaling the compliance would take longer than the rest
            return free_um
        compliance = _compliance_factor(parameters) * self._response.compliance_um_per_n
        return gap_contact.contact_closures_um(free_um, gap_um, compliance)

    def closed_cells(self, parameters: Vector, cell_closures_um: Vector) -> Mask:
        """Return the mask of the cells whose gap is fully closed, shape (n, cells), at given closures [um]."""
        closed_cells: Mask = (
            cell_closures_um
            >= np.repeat(self.gap_um(parameters), gap_contact.CELLS_PER_ELEMENT) - _CLOSED_TOLERANCE_UM
        )
        return closed_cells

    def cell_closures_for_closed_cells_um(
        self, nearby: Sequence[tuple[Vector, ContactLoads]], closed_cells: Mask
    ) -> Vector:
        """Return cell closures [um], shape (k, n, cells), at nearby parameters, with the set of closed cells fixed.

        Args:
            nearby: Parameters and n loads, k times, all near those of the closed cells.
            closed_cells: Cells that are closed, shape (n, cells); all others are open.
        """
        # Gaps and stiffness leave a load where it is, and the forces of one contact need one evaluation of the table.
        contacts = [
            (parameters[MOUNT.start :].tobytes(), loads.normal.tobytes()) for parameters, loads in nearby
        ]
        free_um = np.empty((len(nearby), *closed_cells.shape))
        for contact in dict.fromkeys(contacts):
            rows = [row for row, one in enumerate(contacts) if one == contact]
            parameters, loads = nearby[rows[0]]
            several = ContactLoads(loads.normal, np.stack([nearby[row][1].force_n for row in rows]))
            free_um[rows] = self._designed_cell_closures_um(parameters, several)
        free_um *= np.array([_compliance_factor(parameters) for parameters, _ in nearby])[:, None, None]
        gap_um = np.stack(
            [np.repeat(self.gap_um(parameters), gap_contact.CELLS_PER_ELEMENT) for parameters, _ in nearby]
        )
        # A softer solid is pushed as far back by less force: the closures do not depend on the compliance's scale.
        return gap_contact.closures_for_closed_cells_um(
            free_um, gap_um, self._response.compliance_um_per_n, closed_cells
        )

    def _designed_cell_closures_um(self, parameters: Vector, loads: ContactLoads) -> Vector:
        """Return the closures of each cell for a solid as stiff as designed [um], shape (n, cells).

        Forces of the shape (k, n, 3) at n contacts give closures of the shape (k, n, cells).
        """
        mount = rotation(parameters[MOUNT])
        moved = loads.normal @ mount.T
        moved[:, :2] += parameters[OFFSET]
        force_n = (loads.force_n / reference_gains(parameters)) @ mount.T
        return self._response.free_closure_um(self._clamped_to_min_elevation(normalized(moved)), force_n)

    def reading_pf(self, parameters: Vector, cell_closures_um: Vector) -> Vector:
        """Return the readings of the elements [pF], shape (..., elements), from cell closures [um], (..., cells)."""
        design, stray_pf = self._response.design, parameters[STRAY]
        unloaded_um = design.plate_distance_um(self._unloaded_pf - stray_pf)
        closure_um = cell_closures_um * np.repeat(1.0 + parameters[GAIN], gap_contact.CELLS_PER_ELEMENT)
        distance_um = np.maximum(
            np.repeat(unloaded_um, gap_contact.CELLS_PER_ELEMENT) - closure_um, _MIN_DISTANCE_UM
        )
        return gap_contact.capacitance_pf(design, distance_um) + stray_pf

    def electrode_slopes_pf(
        self, parameters: Vector, cell_closures_um: Vector, gap_closures_um: Vector, steps: Vector
    ) -> Vector:
        """Return the slopes of the readings by strays, gains and gaps [pF per unit], shape (n, elements, 27).

        Args:
            parameters: The parameters.
            cell_closures_um: Closures of the cells [um], shape (n, cells).
            gap_closures_um: The same with gaps that are moved by their step. With all at once, shape (1, n, cells), the
                slope of each gap is that of all together on its own element, which does not vanish as soon as one
                closes nearby; with one at a time, shape (9, n, cells), its own on all elements, which vanishes unless
                it closes.
            steps: Steps of the differences, shape (parameters,).
        """
        model_pf, diagonal = self.reading_pf(parameters, cell_closures_um), np.arange(ELEMENTS)
        slopes_pf = np.zeros((*model_pf.shape, GAP.stop))
        for kind in (STRAY, GAIN):
            moved_pf = self.reading_pf(shifted(parameters, kind, steps), cell_closures_um)
            slopes_pf[:, diagonal, kind.start + diagonal] = (moved_pf - model_pf) / steps[kind]
        by_gap_pf = (self.reading_pf(parameters, gap_closures_um) - model_pf) / steps[GAP.start]
        if len(by_gap_pf) == 1:
            slopes_pf[:, diagonal, GAP.start + diagonal] = by_gap_pf[0]
        else:
            slopes_pf[..., GAP] = by_gap_pf.transpose(1, 2, 0)
        return slopes_pf

    def capacitance_pf(self, parameters: Vector, loads: ContactLoads) -> Vector:
        """Return the predicted reading of each element under loads [pF], shape (n, elements)."""
        return self.reading_pf(parameters, self.cell_closures_um(parameters, loads))

    def _clamped_to_min_elevation(self, normal: Vector) -> Vector:
        """Return the normals with elevations raised to at least the response table's lowest."""
        low = normal[:, 2] < self._min_sine
        lifted = normal.copy()
        across = normal[low, :2] / np.linalg.norm(normal[low, :2], axis=1, keepdims=True)
        lifted[low, :2] = np.sqrt(1.0 - self._min_sine**2) * across
        lifted[low, 2] = self._min_sine
        return lifted
