"""Solution of the shapes that designs start from: once, an hour and a half on one core; `shapes` uses the result.

Shapes with one number changed are solved on the mesh of a release. How far two changes are from multiplying is a small
number that a coarse mesh knows well enough, as its own error is in all four solutions alike:

    ln A(i, j) - ln A(i) - ln A(j) + ln A(0)
"""

from collections.abc import Callable
from itertools import combinations
from pathlib import Path

import numpy as np

from footsense.foot.response_table import FootResponse
from footsense.frames import Vector
from footsense.lab.design.shapes import BESIDE, CENTRE, Shape, amplitudes, of_shape, solved_shapes
from footsense.lab.fem.mesh import COARSE, SHIPPED
from footsense.lab.geometry import FootDesign
from footsense.lab.response import make_response

#: Number whose pairs are solved at its farthest value alone: its lower one is between.
_ONE_SIDED = "sheet_poisson"


def solve(like: FootDesign, path: Path, report: Callable[[str], None]) -> None:
    """Solve all shapes and write their file.

    Args:
        like: Any foot, for what the shape does not contain.
        path: File to write.
        report: Receives a line after each shape.
    """
    fine = []
    for shape in solved_shapes():
        fine.append(make_response(of_shape(shape, like), SHIPPED))
        report(f"{shape}")

    def coarse(shape: Shape) -> Vector:
        made = make_response(of_shape(shape, like), COARSE)
        report(f"{shape}, coarse")
        return np.log(amplitudes(made.quarter_series, made.quarter_compliance))

    store(path, fine, pair_corrections(coarse))


def pair_corrections(ln_amplitude: Callable[[Shape], Vector]) -> Vector:
    """Return how far pairs of changes are from multiplying, shape (shapes, shapes, 4), above the diagonal.

    Args:
        ln_amplitude: Returns the logarithms of the amplitudes of a shape, shape (4,).
    """
    shapes = solved_shapes()
    alone = {shape: ln_amplitude(shape) for shape in shapes if shape.sheet_poisson != BESIDE[_ONE_SIDED][0]}
    centre = alone[CENTRE]
    pairs = np.zeros((len(shapes), len(shapes), 4))
    names = list(BESIDE)
    for one, other in combinations(names, 2):
        for i, value in enumerate(BESIDE[one]):
            for j, second in enumerate(BESIDE[other]):
                if other == _ONE_SIDED and j == 0:
                    continue
                changed = CENTRE._replace(**{one: value, other: second})
                first, then = (
                    CENTRE._replace(**{name: one_value})
                    for name, one_value in ((one, value), (other, second))
                )
                apart = ln_amplitude(changed) - alone[first] - alone[then] + centre
                pairs[1 + 2 * names.index(one) + i, 1 + 2 * names.index(other) + j] = apart
    # Between, in proportion to the logarithm.
    nearer, farther = (
        CENTRE._replace(sheet_poisson=value).coordinates[-1] - CENTRE.coordinates[-1]
        for value in BESIDE[_ONE_SIDED]
    )
    pairs[:, -2] = pairs[:, -1] * nearer / farther
    return pairs


def store(path: Path, solved: list[FootResponse], pairs: Vector) -> None:
    """Write the solved shapes, in the order of `solved_shapes`, in single precision."""
    np.savez_compressed(
        path,
        quarter_series=np.stack([one.quarter_series for one in solved]).astype(np.float32),
        quarter_compliance=np.stack([one.quarter_compliance for one in solved]).astype(np.float32),
        pairs=pairs.astype(np.float32),
    )
