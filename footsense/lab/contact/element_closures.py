"""Closures and capacitances of the elements from the displacement field.

Every electrode is sampled at the Gauss points of 6 x 6 square cells. The capacitance is that of parallel plates
point by point, C = int eps0 dA / (g - d + t_film / eps_r), which exceeds that of the mean closure: a gap that
closes in its middle counts for more.
"""

from typing import Any

import numpy as np

from footsense.foot.capacitor import EPS0_PF_UM_PER_MM2
from footsense.frames import Vector
from footsense.lab.geometry import UM_PER_MM, FootDesign

#: Cells along the side of an electrode.
CELLS_PER_SIDE = 6
#: Gauss points along the side of a cell.
GAUSS_POINTS_PER_SIDE = 3
#: Points are looked up this far inside the body [mm]: on the plane itself, and closer to it than half of this, the
#: search may find the other body.
SAMPLE_DEPTH_MM = 2e-4


def sample_points_mm(design: FootDesign) -> tuple[Vector, Vector]:
    """Return x and y [mm] of the sample points, each (9, 6, 3, 6, 3): element, x cell, point, y cell, point.

    Both grow against their axis, as rows and columns of the array do.
    """
    inside, _ = np.polynomial.legendre.leggauss(GAUSS_POINTS_PER_SIDE)
    along = (np.arange(CELLS_PER_SIDE)[:, None] + 0.5 * (inside + 1.0)) / CELLS_PER_SIDE
    offset = design.electrode_mm * (0.5 - along)
    centres = np.array(design.element_centres_mm)
    x_mm = centres[:, 0, None, None, None, None] + offset[:, :, None, None]
    y_mm = centres[:, 1, None, None, None, None] + offset
    shape = (9, CELLS_PER_SIDE, GAUSS_POINTS_PER_SIDE, CELLS_PER_SIDE, GAUSS_POINTS_PER_SIDE)
    return np.broadcast_to(x_mm, shape), np.broadcast_to(y_mm, shape)


def sampled_closure_um(design: FootDesign, mesh: Any, ground: Any, leg: Any, *, is_half_foot: bool) -> Vector:
    """Return the gap closure at the sample points [um]: axes element, x cell, Gauss point, y cell, Gauss point.

    Args:
        design: The foot.
        mesh: Mesh of the whole foot, or of its half with y > 0.
        ground: Displacement of the ground side [mm].
        leg: Displacement of the leg side [mm].
        is_half_foot: The mesh has y > 0 only, and y < 0 is its mirror image.
    """
    x_mm, y_mm = (places.ravel() for places in sample_points_mm(design))
    if is_half_foot:
        y_mm = np.abs(y_mm)

    def plane_displacement_mm(displacement: Any, up: float) -> Vector:
        """Return the vertical displacement of a plate's electrode plane z = 0 [mm], extrapolated from inside."""
        near, far = (
            np.asarray(displacement[2](mesh(x_mm, y_mm, np.full(x_mm.shape, up * depth_mm))))
            for depth_mm in (SAMPLE_DEPTH_MM, 2.0 * SAMPLE_DEPTH_MM)
        )
        at_plane: Vector = 2.0 * near - far
        return at_plane

    jump = plane_displacement_mm(ground, -1.0) - plane_displacement_mm(leg, 1.0)
    return (
        jump.reshape(9, CELLS_PER_SIDE, GAUSS_POINTS_PER_SIDE, CELLS_PER_SIDE, GAUSS_POINTS_PER_SIDE)
        * UM_PER_MM
    )


def cell_means(samples: Vector) -> Vector:
    """Return the mean closure of each cell [um], shape (9, 36), flat index 6 ix + iy, from `sampled_closure_um`."""
    _, weights = np.polynomial.legendre.leggauss(GAUSS_POINTS_PER_SIDE)
    means: Vector = np.einsum("eipjq,p,q->eij", samples, weights / 2.0, weights / 2.0)
    return means.reshape(9, CELLS_PER_SIDE**2)


def capacitance_pf(design: FootDesign, samples_um: Vector) -> Vector:
    """Return the elements' capacitances without stray [pF], shape (9,), from sampled closures [um]."""
    film_um = design.capacitor.film_equivalent_um
    distance_um = design.gap_um - np.minimum(samples_um, design.gap_um) + film_um
    density = EPS0_PF_UM_PER_MM2 / distance_um
    capacitance: Vector = cell_means(density).mean(axis=1) * design.electrode_mm**2
    return capacitance
