"""Layers with the eight symmetries of the square: a hidden channel is eight units that share their weights.

Unit g of a channel applies the channel's weights to the inputs mapped by the inverse of symmetry g. Units of the second
layer see those of the first by their relative symmetry.

Source:
    Cohen and Welling, Group equivariant convolutional networks, ICML 2016, section 6 (regular representation).
"""

from typing import Any

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from footsense.frames import ELEMENTS
from footsense.lab.symmetry import SYMMETRIES, element_permutation

#: Size e below which a pattern means little [1 of the gap]: 40 nm of 20 um.
PATTERN_SOFTENING_REL = 2e-3
#: Symmetries of the square.
N_SYMMETRIES = len(SYMMETRIES)


def hidden_input_index(n_planes: int, n_scalars: int) -> NDArray[np.intp]:
    """Return which input of a channel meets each input of the layer in its unit g, shape (8, inputs).

    Args:
        n_planes: Features of each element; the inputs begin with nine of each.
        n_scalars: Features of the foot, which follow.
    """
    inverse = np.argsort(np.stack([element_permutation(g) for g in SYMMETRIES]), axis=1)
    planes = [ELEMENTS * plane + inverse for plane in range(n_planes)]
    scalars = np.tile(ELEMENTS * n_planes + np.arange(n_scalars), (N_SYMMETRIES, 1))
    return np.concatenate([*planes, scalars], axis=1).astype(np.intp)


def relative_symmetry_index() -> NDArray[np.intp]:
    """Return the index of inverse(g) h among the eight symmetries, shape (8 of g, 8 of h)."""
    stack = np.stack(SYMMETRIES)
    products = np.einsum("gji,hjk->ghik", stack, stack)
    same = np.abs(products[:, :, None] - stack).max(axis=(3, 4)) == 0.0
    symmetry_index: NDArray[np.intp] = same.argmax(axis=2).astype(np.intp)
    return symmetry_index


def linear_basis() -> NDArray[np.float64]:
    """Return the five linear maps that have the square's symmetry, shape (5, 9, 3)."""
    basis = np.zeros((5, 9, 3))
    corners, edges = [0, 2, 6, 8], [1, 3, 5, 7]
    basis[0, corners, 2] = basis[1, edges, 2] = basis[2, 4, 2] = 1.0
    for g in SYMMETRIES:  # fx from row 0, turned in all directions
        image = element_permutation(g)
        for element, weight in ((0, 0.25), (2, 0.25)):
            basis[3, image[element]] += weight * g @ [1.0, 0.0, 0.0]
        basis[4, image[1]] += 0.5 * g @ [1.0, 0.0, 0.0]
    return basis


def expand_hidden(weights: Any, n_planes: int, n_scalars: int) -> dict[str, Any]:
    """Return the matrices and offsets of both hidden layers by name: unit g * c + i is channel i under symmetry g.

    Args:
        weights: Weights of c channels: `w1` (c, inputs), `b1` (c,), `w2` (c, 8 c), the symmetry slow, and `b2` (c,).
        n_planes: As for `hidden_input_index`.
        n_scalars: As for `hidden_input_index`.
    """
    c = weights.channels
    w1 = weights.w1[:, hidden_input_index(n_planes, n_scalars)]  # (c, 8, inputs)
    w2 = weights.w2.reshape(c, N_SYMMETRIES, c)[:, relative_symmetry_index()]  # (c of unit, g, h, c of input)
    return {
        "w1": jnp.transpose(w1, (2, 1, 0)).reshape(w1.shape[-1], -1),
        "b1": jnp.tile(weights.b1, N_SYMMETRIES),
        "w2": jnp.transpose(w2, (2, 3, 1, 0)).reshape(N_SYMMETRIES * c, -1),
        "b2": jnp.tile(weights.b2, N_SYMMETRIES),
    }
