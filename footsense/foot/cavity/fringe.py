"""Fringe field at the edges of an element's electrodes, which the parallel-plate formula neglects.

Beside two facing strips of width w at a distance h, an edge adds per length the field of two half planes,

    eps0 eps_r / (2 pi) (1 + ln(2 pi w / h))

with eps_r that of the polymer around the cavity. It is a constant in parallel with the element, nearly: the logarithm
moves by less than a hundredth of what the plates do.

Source:
    Palmer, Trans. AIEE 56, 363, 1937, for strips; `lab/fem/fringe.py` solves the field, and differs by a fortieth.
"""

import numpy as np

from footsense.foot.capacitor import EPS0_PF_UM_PER_MM2, CapacitorDesign
from footsense.foot.gap_contact import CELLS_PER_ELEMENT, CELLS_PER_SIDE
from footsense.frames import Vector

_UM_PER_MM = 1e3
#: The cells of an electrode that lie at its edges, shape (36,).
_IS_EDGE_CELL = np.pad(np.zeros((CELLS_PER_SIDE - 2,) * 2, bool), 1, constant_values=True).ravel()


def fringe_pf(design: CapacitorDesign, spacing_um: Vector) -> Vector:
    """Return the fringe capacitance of each element's four edges [pF], shape (..., 9).

    Args:
        design: Dimensions of the capacitors.
        spacing_um: Distance of the electrodes at each cell, film and gap [um], shape (..., 324).
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
