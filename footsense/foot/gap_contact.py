"""Unilateral contact in the gaps: closures under a load when electrodes touch (linear complementarity problem).

Every electrode is divided into square cells. Without contact a load closes the cells by d0 (linear in the load); a
contact force l_j >= 0 on cell j opens cell i by B_ij l_j, with B the compliance of the solid, symmetric and positive
definite:

    d = d0 - B l,      s = g - d >= 0,      l >= 0,      s l = 0           (Signorini's conditions, per cell)

A linear complementarity problem with one solution. It is solved by block principal pivoting: all cells that violate a
condition change sides at once (a primal-dual active set), and after ten such steps without progress only the last of
them (Murty's rule), which terminates.

Source:
    Judice and Pires, Computers & Operations Research 21(5), 1994, for the pivoting.
"""

from dataclasses import dataclass

import numpy as np

from footsense.foot.capacitor import EPS0_PF_UM_PER_MM2, Capacitor
from footsense.frames import ELEMENTS, Mask, Vector

#: Cells along an electrode's side. Flat index of a cell: (element * 6 + forward) * 6 + leftward.
CELLS_PER_SIDE = 6
#: Cells of an electrode.
CELLS_PER_ELEMENT = CELLS_PER_SIDE**2
#: Cells of all elements.
N_CELLS = ELEMENTS * CELLS_PER_ELEMENT

_UM_PER_MM = 1e3
# The cells of an electrode that lie at its edges, shape (36,).
_IS_EDGE_CELL = np.pad(np.zeros((CELLS_PER_SIDE - 2,) * 2, bool), 1, constant_values=True).ravel()
#: Block pivots without fewer violations before single pivots follow.
_MAX_STALLED_BLOCK_PIVOTS = 10
#: Violation by rounding, over the gap and over the largest contact force [1].
_ROUNDING_REL = 1e-10


def element_means(cells: Vector) -> Vector:
    """Return the mean over each element's cells, shape (..., 9), of cell values, shape (..., 324)."""
    means: Vector = cells.reshape(
        *cells.shape[:-1], cells.shape[-1] // CELLS_PER_ELEMENT, CELLS_PER_ELEMENT
    ).mean(axis=-1)
    return means


def capacitance_pf(design: Capacitor, distance_um: Vector) -> Vector:
    """Return each element's capacitance without stray [pF], shape (..., 9), from the cells' plate distances [um].

    Args:
        design: Dimensions of the capacitors, for the area.
        distance_um: Distance of the electrodes at each cell in air, the film's share included [um], shape (..., 324).
    """
    per_cell = EPS0_PF_UM_PER_MM2 * design.electrode_area_mm2 / CELLS_PER_ELEMENT
    of_cells = (1.0 / distance_um).reshape(*distance_um.shape[:-1], ELEMENTS, CELLS_PER_ELEMENT)
    element_capacitance_pf: Vector = per_cell * of_cells.sum(axis=-1)
    return element_capacitance_pf


def fringe_pf(design: Capacitor, spacing_um: Vector) -> Vector:
    """Return the fringe capacitance of each element's four edges [pF], shape (..., 9), which parallel plates lack.

    Beside two facing strips of width w at a distance h, an edge adds per length the field of two half planes,

        eps0 eps_r / (2 pi) (1 + ln(2 pi w / h))

    with eps_r that of the polymer around the cavity. It is a constant in parallel with the element, nearly: the
    logarithm moves by less than a hundredth of what the plates do.

    Args:
        design: Dimensions of the capacitors.
        spacing_um: Distance of the electrodes at each cell, film and gap [um], shape (..., 324).

    Source:
        Palmer, Trans. AIEE 56, 363, 1937, for strips; a solve of the field in tests/lab/mechanics differs by less than
        a fiftieth.
    """
    side_mm = np.sqrt(design.electrode_area_mm2)
    at_edge_um = spacing_um.reshape(*spacing_um.shape[:-1], -1, CELLS_PER_ELEMENT)[..., _IS_EDGE_CELL].mean(
        axis=-1
    )
    per_mm = EPS0_PF_UM_PER_MM2 / _UM_PER_MM * design.film_eps_r / (2.0 * np.pi)
    fringe_capacitance_pf: Vector = (
        4.0 * side_mm * per_mm * (1.0 + np.log(2.0 * np.pi * side_mm * _UM_PER_MM / at_edge_um))
    )
    return fringe_capacitance_pf


@dataclass(frozen=True, slots=True, eq=False)
class ContactSolution:
    """Solution of the gap contact problem of one load: cell closures and contact forces.

    Attributes:
        cell_closures_um: Closure of each cell [um], shape (324,), at most its gap.
        cell_forces_n: Contact force on each cell [N], shape (324,), at least zero.
        n_pivots: Number of linear systems solved.
    """

    cell_closures_um: Vector
    cell_forces_n: Vector
    n_pivots: int


def solve_contact_lcp(free_um: Vector, gap_um: Vector, compliance_um_per_n: Vector) -> ContactSolution:
    """Return the cell closures and contact forces of one load (linear complementarity problem).

    Args:
        free_um: Closure of each cell without contact [um], shape (324,).
        gap_um: Gap of each cell at rest [um], shape (324,).
        compliance_um_per_n: B, symmetric and positive definite, shape (324, 324).

    Returns:
        The one solution.

    Raises:
        ValueError: An input is not a number.
        ArithmeticError: The compliance is not positive definite.
    """
    if not (np.isfinite(free_um).all() and np.isfinite(gap_um).all()):
        raise ValueError("closures and gaps have to be finite numbers")
    closed = free_um > gap_um
    if not closed.any():
        return ContactSolution(free_um, np.zeros_like(free_um), 0)
    fewest, patience = len(free_um) + 1, _MAX_STALLED_BLOCK_PIVOTS
    for pivots in range(1, _MAX_STALLED_BLOCK_PIVOTS * len(free_um)):
        force = np.zeros_like(free_um)
        inside = np.flatnonzero(closed)
        try:
            force[inside] = np.linalg.solve(
                compliance_um_per_n[np.ix_(inside, inside)], (free_um - gap_um)[inside]
            )
        except np.linalg.LinAlgError as error:
            raise ArithmeticError("the compliance is singular, not positive definite") from error
        closure = free_um - compliance_um_per_n[:, inside] @ force[inside]
        pulls = closed & (force < -_ROUNDING_REL * np.abs(force).max(initial=0.0))
        overlaps = ~closed & (closure > gap_um * (1.0 + _ROUNDING_REL))
        wrong = pulls | overlaps
        n_wrong = int(wrong.sum())
        if n_wrong == 0:
            return ContactSolution(np.where(closed, gap_um, closure), np.maximum(force, 0.0), pivots)
        if n_wrong < fewest:
            fewest, patience = n_wrong, _MAX_STALLED_BLOCK_PIVOTS
        else:
            patience -= 1
        if patience < 0:  # one at a time, the last
            last = np.flatnonzero(wrong)[-1]
            wrong = np.zeros_like(wrong)
            wrong[last] = True
        closed = closed ^ wrong
    raise ArithmeticError("the contact problem has no end: its compliance is not positive definite")


def closures_for_closed_cells_um(
    free_um: Vector, gap_um: Vector, compliance_um_per_n: Vector, closed: Mask
) -> Vector:
    """Return the cell closures for a given set of closed cells [um], shape (k, n, 324).

    Near a solution, it is how that solution changes as long as no other cell closes or opens; it is linear, and costs
    one solve of each load however many changes are asked for.

    Args:
        free_um: Closures without contact of n loads in k variants [um], shape (k, n, 324).
        gap_um: Gap of each cell at rest in each variant [um], shape (k, 324).
        compliance_um_per_n: B, shape (324, 324), or any multiple of it.
        closed: Closed cells of each load, shape (n, 324).
    """
    beyond_um = free_um - gap_um[:, None]
    for load in np.flatnonzero(closed.any(axis=1)):
        inside = np.flatnonzero(closed[load])
        rows = compliance_um_per_n[inside]
        force_n = np.linalg.solve(rows[:, inside], beyond_um[:, load, inside].T)
        beyond_um[:, load] -= force_n.T @ rows
    closure_um: Vector = gap_um[:, None] + beyond_um
    return closure_um


def contact_closures_um(free_um: Vector, gap_um: Vector, compliance_um_per_n: Vector) -> Vector:
    """Return the cell closures under several loads with gap contact [um], shape (n, 324).

    Args:
        free_um: Closures without contact [um], shape (n, 324).
        gap_um: Gap of each cell at rest [um], shape (324,).
        compliance_um_per_n: B, shape (324, 324).
    """
    closure_um = free_um.copy()
    for load in np.flatnonzero((free_um > gap_um).any(axis=1)):
        closure_um[load] = solve_contact_lcp(free_um[load], gap_um, compliance_um_per_n).cell_closures_um
    return closure_um
