"""The eight symmetries of a square array, as permutations of its elements."""

import numpy as np
from numpy.typing import NDArray

from footsense.frames import ELEMENTS, ROWS, Vector

#: The eight symmetries of the square, each as a 3 x 3 matrix that maps the foot frame onto itself.
SYMMETRIES: tuple[Vector, ...] = tuple(
    np.array(matrix, dtype=np.float64)
    for sx in (1, -1)
    for sy in (1, -1)
    for matrix in ([[sx, 0, 0], [0, sy, 0], [0, 0, 1]], [[0, sx, 0], [sy, 0, 0], [0, 0, 1]])
)


def element_permutation(symmetry: Vector) -> NDArray[np.intp]:
    """Return the permutation m of the elements by a symmetry: element e comes to lie on element m[e].

    Args:
        symmetry: One of `SYMMETRIES`.
    """
    row, column = np.divmod(np.arange(ELEMENTS), ROWS)
    place = 1.0 - symmetry[:2, :2] @ np.stack([1.0 - row, 1.0 - column])
    mapped: NDArray[np.intp] = (ROWS * place[0] + place[1]).astype(np.intp)
    return mapped
