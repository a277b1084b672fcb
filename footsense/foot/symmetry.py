"""Mirror symmetries of the square foot, applied to cells, response series and compliance.

The cells of all nine electrodes together are a square grid, 18 x 18, row 0 the most forward, column 0 the leftmost (the
bars between the electrodes left out). A mirror of the foot maps the grid onto itself, so a quarter determines the rest.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from footsense.foot.gap_contact import CELLS_PER_SIDE
from footsense.frames import ROWS, Vector

#: Cells along a side of the grid.
GRID_SIDE = ROWS * CELLS_PER_SIDE
#: Flat index (element by element) of each cell of the grid, shape (18, 18).
FLAT_OF_GRID: NDArray[np.intp] = (
    np.arange(GRID_SIDE**2)
    .reshape(ROWS, ROWS, CELLS_PER_SIDE, CELLS_PER_SIDE)
    .transpose(0, 2, 1, 3)
    .reshape(GRID_SIDE, GRID_SIDE)
)


@cache
def product_powers(degree: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the degrees i and j of every basis function T_i(X) T_j(Y), in the order of the series."""
    i, j = np.indices((degree + 1, degree + 1))
    kept = i + j <= degree
    return i[kept].astype(np.intp), j[kept].astype(np.intp)


def mirrored_series(series: Vector, degree: int, axis: int) -> Vector:
    """Return the series coefficients of the mirror images of some cells.

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
    """Return the series coefficients of all cells, shape (products, 324, 3), from those of one quarter of the foot.

    Args:
        quarter: Coefficients of the cells of the quarter x > 0, y > 0, shape (products, 9, 9, 3), or of all cells of a
            foot that is not symmetric, shape (products, 18, 18, 3).
        degree: Degree of the series.
    """
    flat = np.empty((len(quarter), GRID_SIDE**2, 3))
    if quarter.shape[1] == GRID_SIDE:
        flat[:, FLAT_OF_GRID] = quarter
        return flat
    half = np.concatenate([quarter, mirrored_series(quarter, degree, 0)[:, ::-1]], axis=1)
    whole = np.concatenate([half, mirrored_series(half, degree, 1)[:, :, ::-1]], axis=2)
    flat[:, FLAT_OF_GRID] = whole
    return flat


def whole_compliance(quarter: Vector) -> Vector:
    """Return the compliance matrix of all cells, shape (324, 324), from the rows of one quarter of the foot.

    Args:
        quarter: Closure of every cell of the grid under a force on a cell of the quarter, shape (9, 9, 18, 18), or on
            any cell of a foot that is not symmetric, shape (18, 18, 18, 18).
    """
    whole = quarter
    if len(quarter) != GRID_SIDE:
        half = np.concatenate([quarter, quarter[::-1, :, ::-1]], axis=0)
        whole = np.concatenate([half, half[:, ::-1, :, ::-1]], axis=1)
    order = FLAT_OF_GRID.ravel()
    flat = np.empty((GRID_SIDE**2, GRID_SIDE**2))
    flat[np.ix_(order, order)] = whole.reshape(flat.shape)
    return flat
