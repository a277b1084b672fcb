"""The snapshot network: from the closures of one scan to a force and its sigma.

    s = |x|^2 / n,   r = sqrt(s + e^2),   u = x / r           x: n closures over gap, missing ones filled in
    f = L x + (s / r) V h2,      ln sigma = ln r + Q h2 + q,      h2 = tanh(W2 h1 + b2),   h1 = tanh(W1 [u, m, r] + b1)

As long as no gap closes, the foot's response is homogeneous of degree one but for the growing contact patch: the same
pattern u at any size r means the same direction. So the pattern is the input of the hidden layers, and the size scales
their output; r is an input as well, for the patch and for gaps that close. m has a one for each missing element. No
load gives exactly no force (s = 0), and e, of the size of the converter's noise, keeps the pattern of a very light
touch from being noise alone.

The foot has the eight symmetries of the square, and so has the network, by construction: a hidden channel is eight
units, one for each symmetry g, which apply the same weights to the pattern mapped by the inverse of g. Units of the
second layer see those of the first by their relative symmetry. Each weight thus stands in eight places of the matrices;
`expand_over_symmetries` puts it there, and the ONNX file does the same by Gather.

Source:
    Cohen and Welling, Group equivariant convolutional networks, ICML 2016, section 6 (regular representation).
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from footsense.frames import Vector
from footsense.lab.symmetry import SYMMETRIES
from footsense.lab.training.symmetric_layers import (
    PATTERN_SOFTENING_REL,
    SharedWeights,
    expand_hidden,
    linear_basis,
)

#: Features of an element and of the foot: closure, mask; size.
FEATURES_PER_ELEMENT, FEATURES_PER_FOOT = 2, 1


class Weights(SharedWeights):
    """Trained weights of a snapshot network.

    Its outputs are the force [N]; `sigma_offset` is of the axes sideways and along z, shape (2,).
    """

    __slots__ = ()


class LayerMatrices(NamedTuple):
    """Full weight matrices of the network, expanded from the shared weights: a layer is x @ w + b."""

    linear: Any
    w1: Any
    b1: Any
    w2: Any
    b2: Any
    force: Any
    sigma: Any
    sigma_offset: Any


def expand_over_symmetries(weights: Weights) -> LayerMatrices:
    """Return the full weight matrices of the shared weights: unit g * c + i is channel i under symmetry g."""
    turns = np.stack(SYMMETRIES)
    force = jnp.einsum("gab,cb->gca", turns, weights.out)
    sigma = jnp.einsum("gab,cb->gca", np.abs(turns), weights.sigma)
    return LayerMatrices(
        linear=jnp.tensordot(weights.linear, linear_basis(), 1),
        **expand_hidden(weights, FEATURES_PER_ELEMENT, FEATURES_PER_FOOT),
        force=force.reshape(-1, 3),
        sigma=sigma.reshape(-1, 3),
        sigma_offset=weights.sigma_offset[np.array([0, 0, 1])],
    )


def run(matrices: LayerMatrices, closure_rel: Any, missing: Any) -> tuple[Any, Any]:
    """Return estimated force and its sigma [N], shape (n, 3) each.

    Args:
        matrices: The network.
        closure_rel: Closures over the gap, missing ones filled in [1], shape (n, elements).
        missing: One for each element that is missing, else zero, shape (n, elements).
    """
    square = jnp.mean(closure_rel**2, axis=-1, keepdims=True)
    size = jnp.sqrt(square + PATTERN_SOFTENING_REL**2)
    seen = jnp.concatenate([closure_rel / size, missing, size], axis=-1)
    first = jnp.tanh(seen @ matrices.w1 + matrices.b1)
    second = jnp.tanh(first @ matrices.w2 + matrices.b2)
    force = closure_rel @ matrices.linear + square / size * (second @ matrices.force)
    sigma = size * jnp.exp(second @ matrices.sigma + matrices.sigma_offset)
    return force, sigma


def hidden_layer_input(closure_rel: Vector) -> Vector:
    """Return the inputs of the hidden layers for closures, none missing, shape (n, inputs), as `run` in numpy."""
    size = np.sqrt(np.mean(closure_rel**2, axis=-1, keepdims=True) + PATTERN_SOFTENING_REL**2)
    return np.concatenate([closure_rel / size, np.zeros_like(closure_rel), size], axis=-1)
