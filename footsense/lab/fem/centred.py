"""Closures of the nine elements under one centred load by four adjoint solves, for mesh studies.

A load of azimuth 0 is even in y, so the classes (1, 1) and (-1, 1) hold all of it, and a vertical one the first alone.
"""

import numpy as np

from footsense.foot.directions import directions
from footsense.frames import Vector
from footsense.lab.fem.adjoint import solve_cell_closure_fields
from footsense.lab.fem.mesh import MeshSize, build_mesh, cavity_cells
from footsense.lab.fem.quarter import Parity, QuarterFoot
from footsense.lab.geometry import FootDesign
from footsense.lab.response import fit_series, mean_over_patch

#: Elements that close less than this share of the most closed one are left out of relative errors [1].
MIN_COUNTED_REL = 0.05
#: Elements of which a part lies in the quarter: corner, the one on the x axis, the one on the y axis, middle.
_QUARTER_ELEMENTS = (0, 1, 3, 4)
#: Which of them each of the nine is the image of.
_MIRROR_IMAGE_OF_ELEMENT = np.array([0, 1, 0, 2, 3, 2, 0, 1, 0])
#: Sign under x -> -x of each of the nine, 0 on the mirror plane.
_X_MIRROR_SIGN = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0, -1.0, -1.0, -1.0])


def solve_centred_closures(
    design: FootDesign, size: MeshSize, elevation_deg: tuple[float, ...]
) -> tuple[Vector, int]:
    """Return the nine closures [um] under centred loads of 1 N at azimuth 0, for mesh studies.

    Args:
        design: The foot.
        size: Resolution of the mesh.
        elevation_deg: Elevation of each load [deg]; if all are 90, one class is solved, else two.

    Returns:
        Mean closure of each element per newton [um], shape (loads, 9), and the number of unknowns of one class.

    Raises:
        ModelError: The foot cannot be meshed, or its stiffness is singular.
    """
    mesh = build_mesh(design, size)
    force = directions(0.0, elevation_deg)
    upright = min(elevation_deg) >= 90.0
    cells = cavity_cells(design)
    parts = [[cell.name for cell in cells if cell.element == element] for element in _QUARTER_ELEMENTS]
    faces = [("|".join(names), design.cavity_cell_area_mm2 * len(names)) for names in parts]
    total = np.zeros((len(force), 9))
    for parity in (Parity(1, 1),) if upright else (Parity(1, 1), Parity(-1, 1)):
        quarter = QuarterFoot(design, size, parity, mesh)
        field = solve_cell_closure_fields(quarter, faces)
        series = fit_series(field)
        patch_mm = design.hertz_patch_radius_mm(1.0)
        per_newton = mean_over_patch(series.reshape(len(series), -1), force, patch_mm, design)
        part = (per_newton.reshape(len(force), len(_QUARTER_ELEMENTS), 3) * force[:, None]).sum(axis=2)
        sign = np.ones(9) if parity.x > 0 else _X_MIRROR_SIGN
        # The quarter's form is a quarter of the foot's, so its field is four times the foot's.
        total += part[:, _MIRROR_IMAGE_OF_ELEMENT] * sign / 4.0
    return total, quarter.n_unknowns


def largest_change(closure_um: Vector, of_um: Vector) -> float:
    """Return the largest relative difference of closures that count, with its sign [1]."""
    counted = np.abs(of_um) > MIN_COUNTED_REL * np.abs(of_um).max()
    change = (closure_um / of_um - 1.0)[counted]
    return float(change[np.abs(change).argmax()])
