"""Finite element solution of the shape library, which `shapes` interpolates: `footsense lab shapes`.

Shapes with one number changed are solved on the mesh of a release. How far two changes are from multiplying is a small
number that a coarse mesh knows well enough, as its own error is in all four solutions alike:

    ln A(i, j) - ln A(i) - ln A(j) + ln A(0)
"""

from collections.abc import Callable
from itertools import combinations
from pathlib import Path

import numpy as np

from footsense.frames import Vector
from footsense.lab.design.shapes import (
    PAPER_SHAPE,
    SHAPE_INTERPOLATION_NODES,
    FootShape,
    design_of_shape,
    response_amplitudes,
    solved_shapes,
    stored_steps,
)
from footsense.lab.fem.mesh import COARSE_MESH, RELEASED_MESH
from footsense.lab.geometry import FootDesign
from footsense.lab.response import make_response

#: Values whose pairs are solved, by place in `SHAPE_INTERPOLATION_NODES`: narrow electrodes, thin plates, soft and
#: incompressible sheets, where the feet of larger robots lie. Other pairs are left to multiply.
_SOLVED_PAIR_VALUE_INDICES = {
    "electrode_over_pitch": 0,
    "plate_rel": 0,
    "sheet_modulus_rel": 0,
    "sheet_poisson": 1,
}


def solve_shapes(reference_design: FootDesign, path: Path, report: Callable[[str], None]) -> None:
    """Solve all shapes of the library by finite elements and write their file.

    Args:
        reference_design: Any foot, for what the shape does not contain.
        path: File to write.
        report: Receives a line after each shape.
    """
    fine = []
    for shape in solved_shapes():
        fine.append(make_response(design_of_shape(shape, reference_design), RELEASED_MESH))
        report(f"{shape}")

    def coarse_ln_amplitudes(shape: FootShape) -> Vector:
        """Return the logarithms of a shape's response amplitudes on the coarse mesh."""
        made = make_response(design_of_shape(shape, reference_design), COARSE_MESH)
        report(f"{shape}, coarse")
        return np.log(response_amplitudes(made.quarter_series, made.quarter_compliance))

    np.savez_compressed(
        path,
        **stored_steps("quarter_series", np.stack([one.quarter_series for one in fine])),
        **stored_steps("quarter_compliance", np.stack([one.quarter_compliance for one in fine])),
        pairs=_pair_interaction_corrections(coarse_ln_amplitudes).astype(np.float32),
    )


def _pair_interaction_corrections(ln_amplitude: Callable[[FootShape], Vector]) -> Vector:
    """Return the correction of the interpolation where two dimensions change together, shape (shapes, shapes, 4).

    Args:
        ln_amplitude: Returns the logarithms of the amplitudes of a shape, shape (4,).
    """
    places = {name: 1 + 2 * number for number, name in enumerate(SHAPE_INTERPOLATION_NODES)}
    values = {
        name: SHAPE_INTERPOLATION_NODES[name][side] for name, side in _SOLVED_PAIR_VALUE_INDICES.items()
    }
    centre = ln_amplitude(PAPER_SHAPE)
    alone = {
        name: ln_amplitude(PAPER_SHAPE._replace(**{name: value})) - centre for name, value in values.items()
    }
    n_shapes = 1 + 2 * len(SHAPE_INTERPOLATION_NODES)
    pairs = np.zeros((n_shapes, n_shapes, 4))
    for one, other in combinations(_SOLVED_PAIR_VALUE_INDICES, 2):
        both = ln_amplitude(PAPER_SHAPE._replace(**{one: values[one], other: values[other]})) - centre
        at = places[one] + _SOLVED_PAIR_VALUE_INDICES[one], places[other] + _SOLVED_PAIR_VALUE_INDICES[other]
        pairs[at] = both - alone[one] - alone[other]
    # The nearer Poisson's ratio in proportion to the logarithm.
    nearer, farther = (
        PAPER_SHAPE._replace(sheet_poisson=value).interpolation_coordinates[-1]
        - PAPER_SHAPE.interpolation_coordinates[-1]
        for value in SHAPE_INTERPOLATION_NODES["sheet_poisson"]
    )
    pairs[:, -2] = pairs[:, -1] * nearer / farther
    return pairs
