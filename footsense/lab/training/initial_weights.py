"""Start weights of the windowed network: random ones, or another network's with more channels."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from footsense.frames import ELEMENTS
from footsense.lab.training.windowed_network import (
    FEATURES_PER_ELEMENT,
    FEATURES_PER_FOOT,
    N_SYMMETRIES,
    Weights,
    linear_basis,
)


def random_weights(key: jax.Array, c: int) -> Weights:
    """Return random initial weights; the linear path starts at zero, as a correction to least squares."""
    n_inputs = FEATURES_PER_ELEMENT * ELEMENTS + FEATURES_PER_FOOT
    k1, k2, k3, k4 = jax.random.split(key, 4)
    return Weights(
        linear=jnp.zeros(2 * len(linear_basis())),
        w1=jax.random.normal(k1, (c, n_inputs)) / np.sqrt(12.0),
        b1=0.5 * jax.random.normal(k2, (c,)),
        w2=jax.random.normal(k3, (c, 8 * c)) / np.sqrt(8.0 * c),
        b2=jnp.zeros(c),
        out=0.3 * jax.random.normal(k4, (c, 7)) / np.sqrt(8.0 * c),
        sigma=jnp.zeros((c, 7)),
        sigma_offset=jnp.array([-3.0, -4.0, -2.5, -2.0]),
    )


def widened(weights: Weights, channels: int, key: jax.Array) -> Weights:
    """Return the weights with more channels, whose outputs are nothing yet."""
    old, new = weights.channels, random_weights(key, channels)
    if old == channels:
        return weights
    # Of each relative symmetry, the channels of the layer before.
    w2 = np.array(new.w2).reshape(channels, N_SYMMETRIES, channels)
    w2[:old] = 0.0
    w2[:old, :, :old] = np.asarray(weights.w2).reshape(old, N_SYMMETRIES, old)

    def stacked(mine: Any, others: Any) -> jax.Array:
        return jnp.concatenate([jnp.asarray(mine), jnp.asarray(others)[old:]])

    return weights._replace(
        w1=stacked(weights.w1, new.w1),
        b1=stacked(weights.b1, new.b1),
        w2=jnp.asarray(w2.reshape(channels, -1)),
        b2=stacked(weights.b2, new.b2),
        out=stacked(weights.out, jnp.zeros_like(new.out)),
        sigma=stacked(weights.sigma, new.sigma),
    )
