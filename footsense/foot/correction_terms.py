"""Basis functions of the learnt force correction of a calibrated foot (see `parameters.py`)."""

import numpy as np

from footsense.frames import Vector

#: Terms of the correction.
N_CORRECTION_TERMS = 15


def correction_terms(force_n: Vector) -> Vector:
    """Return the basis functions phi of the force correction [N], shape (n, N_CORRECTION_TERMS).

    They are the products of a direction's components up to degree three times the magnitude, which keeps them
    homogeneous of degree one in the force, as the linear solid is. Products that follow from the others because a
    direction has length one are left out.

    Args:
        force_n: Forces p [N], shape (n, 3); zero gives zeros.
    """
    size_n = np.sqrt((force_n * force_n).sum(axis=1, keepdims=True))
    x, y, z = (force_n / np.maximum(size_n, np.finfo(np.float64).tiny)).T
    xy, xz, yz, xx, yy = x * y, x * z, y * z, x * x, y * y
    terms: Vector = np.stack(
        [x, y, z, xy, xz, yz, xx, yy, xx * x, yy * y, xx * y, x * yy, xx * z, yy * z, xy * z], axis=1
    )
    terms *= size_n
    return terms
