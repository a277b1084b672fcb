"""Network layers equivariant to the eight symmetries of the square: each channel is eight units sharing weights.

Unit g of a channel applies the channel's weights to the inputs mapped by the inverse of symmetry g. Units of the second
layer see those of the first by their relative symmetry.

Source:
    Cohen and Welling, Group equivariant convolutional networks, ICML 2016, section 6 (regular representation).
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from footsense.frames import ELEMENTS, Vector
from footsense.lab.symmetry import SYMMETRIES, element_permutation

#: Size e below which a pattern means little [1 of the gap]: 40 nm of 20 um.
PATTERN_SOFTENING_REL = 2e-3
#: Symmetries of the square.
N_SYMMETRIES = len(SYMMETRIES)


class Weights(NamedTuple):
    """Trained weights of the windowed network, with `c` channels in each hidden layer.

    Its outputs are force, contact point and friction ratio.

    Attributes:
        linear: Linear paths [N], a weight for each map of `linear_basis`, of the paths L, then M.
        w1: First hidden layer, shape (c, inputs).
        b1: Offsets of the first layer, shape (c,).
        w2: Second hidden layer by relative symmetry, shape (c, 8 c), the symmetry slow.
        b2: Offsets of the second layer, shape (c,).
        out: Output layer, shape (c, outputs).
        sigma: Output layer of ln sigma, shape (c, outputs).
        sigma_offset: Offsets of ln sigma of the force sideways, along z, of contact point and of friction ratio, shape
            (4,): axes that the square exchanges share one.
    """

    linear: Any
    w1: Any
    b1: Any
    w2: Any
    b2: Any
    out: Any
    sigma: Any
    sigma_offset: Any

    @property
    def n_weights(self) -> int:
        """Number of trained weights."""
        return sum(int(part.size) for part in self)

    @property
    def channels(self) -> int:
        """Number of channels in a hidden layer."""
        return int(self.b1.size)


def hidden_input_index(n_planes: int, n_scalars: int) -> NDArray[np.intp]:
    """Return for each unit and input the index of the shared weight, shape (8, inputs).

    Args:
        n_planes: Features of each element; the inputs begin with as many of each as there are elements.
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
    """Return the basis of linear maps from closures to force with the square's symmetry, (maps, elements, 3).

    Elements that the symmetries exchange share their weights. First come the maps to fz, one for each group of such
    elements, then those to fx and fy: none of the central element, one of each other group.
    """
    images = np.stack([element_permutation(g) for g in SYMMETRIES])
    fz_maps: list[NDArray[np.float64]] = []
    fxy_maps: list[NDArray[np.float64]] = []
    for first in np.unique(images.min(axis=0)):
        basis = np.zeros((3, ELEMENTS, 3))
        basis[2, images[:, first], 2] = 1.0
        fz_maps.append(basis[2])
        for g, image in zip(
            SYMMETRIES, images, strict=True
        ):  # fx and fy from one element, turned in all directions
            basis[:2, image[first]] += 0.5 * g[:, :2].T
        one, other = basis[:2]
        fxy_maps.extend([one] if np.array_equal(one, other) else [one, other])
    return np.stack([*fz_maps, *(part for part in fxy_maps if part.any())])


def expand_hidden(weights: Weights, n_planes: int, n_scalars: int) -> dict[str, Any]:
    """Return the matrices and offsets of both hidden layers by name: unit g * c + i is channel i under symmetry g.

    Args:
        weights: Weights of c channels.
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


def mean_closure_product_matrix(closure_rel: Vector) -> Vector:
    """Return second moments of closures over their rms, averaged over symmetries, shape (elements, elements)."""
    size = np.sqrt(np.mean(closure_rel**2, axis=-1, keepdims=True) + PATTERN_SOFTENING_REL**2)
    pattern = closure_rel / size
    plain = pattern.T @ pattern / len(pattern)
    maps = [element_permutation(g) for g in SYMMETRIES]
    even: Vector = np.mean([plain[np.ix_(m, m)] for m in maps], axis=0) + 1e-7 * np.eye(ELEMENTS)
    return even
