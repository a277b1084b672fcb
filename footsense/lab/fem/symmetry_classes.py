"""Symmetry classes of displacement fields (even or odd under x -> -x and y -> -y), each solved separately.

A load on one cell is a quarter of the sum of the loads that put the cell and its mirror images together with the signs
of each class. So the response to it is a quarter of the sum of the classes' responses.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from footsense.foot.response_table import product_powers
from footsense.frames import Vector


@dataclass(frozen=True, slots=True)
class Parity:
    """Parity (even or odd) of a displacement field under the mirrors x -> -x and y -> -y.

    Attributes:
        x: +1 if the field is its own mirror image under x -> -x, -1 if it is the opposite of it.
        y: +1 if the field is its own mirror image under y -> -y, -1 if it is the opposite of it.
    """

    x: int
    y: int

    def fixed_mirror_faces(self, component: int) -> str:
        """Return the mirror planes on which displacement component 0..2 vanishes, joined by `|`."""
        planes = []
        for axis, (plane, parity) in enumerate((("mirror_x", self.x), ("mirror_y", self.y))):
            if (component == axis) == (parity > 0):
                planes.append(plane)
        return "|".join(planes)

    def mirror_image_signs(self, component: int) -> tuple[int, int]:
        """Return the sign of a displacement component in its images under x -> -x and under y -> -y."""
        return (-self.x if component == 0 else self.x), (-self.y if component == 1 else self.y)

    def unfold_z_component(self, quarter: Vector, axis: int = 0) -> Vector:
        """Return z components on the whole foot from the quarter (x runs along `axis`, y along the next axis)."""
        half = np.concatenate([quarter, self.x * np.flip(quarter, axis)], axis)
        return np.concatenate([half, self.y * np.flip(half, axis + 1)], axis + 1)


#: The classes that are solved; (-1, 1) is the transpose of (1, -1).
SOLVED_CLASSES = (Parity(1, 1), Parity(1, -1), Parity(-1, -1))


def _transposed_product_indices(degree: int) -> NDArray[np.intp]:
    """Return for each monomial T_i T_j the index of T_j T_i in the series."""
    i, j = product_powers(degree)
    place = {pair: number for number, pair in enumerate(zip(i.tolist(), j.tolist(), strict=True))}
    return np.array([place[b, a] for a, b in zip(i.tolist(), j.tolist(), strict=True)], np.intp)


def transposed_series(series: Vector, degree: int) -> Vector:
    """Return a response series with x and y exchanged, shape (products, 9, 9, 3)."""
    return series[_transposed_product_indices(degree)].transpose(0, 2, 1, 3)[..., [1, 0, 2]]


def single_cell_series(classes: dict[Parity, Vector], degree: int) -> Vector:
    """Return the closure series of single cells, superposed from the symmetry classes, shape (products, 9, 9, 3).

    A load on a single cell is a quarter of the sum of the four loads that put it and its mirror images together with
    the signs of each class.
    """
    even_odd = classes[Parity(1, -1)]
    total = sum(classes.values()) + transposed_series(even_odd, degree)
    single: Vector = total / 4.0
    return single


def whole_foot_compliance(classes: dict[Parity, Vector]) -> Vector:
    """Return the compliance from cells of the quarter to all cells, summed over the classes, shape (9, 9, 18, 18).

    Args:
        classes: Closure of one cell of the quarter under a force on another, shapes (9, 9, 9, 9).
    """
    transposed = classes[Parity(1, -1)].transpose(1, 0, 3, 2)
    parts = [*classes.items(), (Parity(-1, 1), transposed)]
    whole: Vector = np.sum([parity.unfold_z_component(part, 2) for parity, part in parts], axis=0) / 4.0
    return whole
