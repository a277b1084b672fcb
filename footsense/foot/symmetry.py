"""Symmetries of the square foot, applied to cells, series and compliance.

The cells of all electrodes together are an 18 x 18 grid, row 0 the most forward, column 0 the leftmost (the bars
between the electrodes left out). A mirror of the foot maps the grid onto itself, so a quarter determines the rest.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from footsense.foot.gap_contact import ALL_CELLS, CELLS_PER_SIDE
from footsense.frames import Vector

#: Cells along a side of the grid, and along a side of the quarter x > 0, y > 0.
SIDE = 3 * CELLS_PER_SIDE
HALF_SIDE = SIDE // 2


def flat_of_grid() -> NDArray[np.intp]:
    """Return the flat index of each cell of the grid, shape (18, 18).

    Example:
        >>> flat_of_grid()[0, :8].tolist()
        [0, 1, 2, 3, 4, 5, 36, 37]
    """
    flat: NDArray[np.intp] = np.arange(ALL_CELLS).reshape(3, 3, CELLS_PER_SIDE, CELLS_PER_SIDE)
    return flat.transpose(0, 2, 1, 3).reshape(SIDE, SIDE)


@cache
def product_powers(degree: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return i and j of every product T_i(X) T_j(Y) with i + j <= degree, in the order of the series."""
    i, j = np.indices((degree + 1, degree + 1))
    kept = i + j <= degree
    return i[kept].astype(np.intp), j[kept].astype(np.intp)


def mirrored_series(series: Vector, degree: int, axis: int) -> Vector:
    """Return the series of the mirror images of some cells.

    For a mirror g: w_{g c}(g n) = g w_c(n). It changes the sign of one coordinate of n and of one component of w.

    Args:
        series: Coefficients, products first, force component last.
        degree: Degree of the series.
        axis: 0 for x -> -x, 1 for y -> -y.

    Returns:
        Coefficients of the images, same shape.
    """
    odd = product_powers(degree)[axis] % 2 == 1
    image = np.where(odd.reshape(-1, *[1] * (series.ndim - 1)), -series, series)
    image[..., axis] *= -1.0
    return image


def whole_series(quarter: Vector, degree: int) -> Vector:
    """Return the series of all cells in flat order, shape (products, 324, 3), from one quarter of the foot.

    Args:
        quarter: Coefficients of the cells of the quarter x > 0, y > 0, shape (products, 9, 9, 3), or of all cells of a
            foot that is not symmetric, shape (products, 18, 18, 3).
        degree: Degree of the series.
    """
    flat = np.empty((len(quarter), ALL_CELLS, 3))
    if quarter.shape[1] == SIDE:
        flat[:, flat_of_grid()] = quarter
        return flat
    half = np.concatenate([quarter, mirrored_series(quarter, degree, 0)[:, ::-1]], axis=1)
    whole = np.concatenate([half, mirrored_series(half, degree, 1)[:, :, ::-1]], axis=2)
    flat[:, flat_of_grid()] = whole
    return flat


def whole_compliance(quarter: Vector) -> Vector:
    """Return the compliance of all cells in flat order, shape (324, 324), from the rows of a quarter.

    Args:
        quarter: Closure of every cell of the grid under a force on a cell of the quarter, shape (9, 9, 18, 18), or on
            any cell of a foot that is not symmetric, shape (18, 18, 18, 18).
    """
    whole = quarter
    if quarter.shape[0] == HALF_SIDE:
        half = np.concatenate([quarter, quarter[::-1, :, ::-1]], axis=0)
        whole = np.concatenate([half, half[:, ::-1, :, ::-1]], axis=1)
    order = flat_of_grid().ravel()
    flat = np.empty((ALL_CELLS, ALL_CELLS))
    flat[np.ix_(order, order)] = whole.reshape(ALL_CELLS, ALL_CELLS)
    return flat
