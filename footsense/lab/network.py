"""The network on paper: nine closures to three force components, two hidden layers beside a linear path.

    s   = |x|^2 / 9,   r = sqrt(s + e^2),   u = x / r          x: closure over gap
    f   = L x + (s / r) * (W3 tanh(W2 tanh(W1 [u, r] + b1) + b2) + b3)

As long as no gap shuts, the foot's answer is homogeneous of degree one but for the growing contact patch: the same
pattern u at any size r means the same direction. So the hidden layers see the pattern, and the size scales what
they say; r is offered to them as the tenth input for the patch. No load gives exactly no force (s = 0), and e,
of the size of the converter's noise, keeps the pattern of a touch too light to have one from being noise alone.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

#: Size e below which a pattern means little [1 of the gap]: 40 nm of 20 um.
SOFT_REL = 2e-3


class Weights(NamedTuple):
    """Every number that training finds; rows are outputs, so that a layer is x @ w.T + b.

    Attributes:
        linear: L [N], shape (3, 9).
        w1: First hidden layer, shape (h, 10).
        b1: Its offsets, shape (h,).
        w2: Second hidden layer, shape (h, h).
        b2: Its offsets, shape (h,).
        w3: Output layer [N], shape (3, h).
        b3: Its offsets [N], shape (3,).
    """

    linear: jax.Array
    w1: jax.Array
    b1: jax.Array
    w2: jax.Array
    b2: jax.Array
    w3: jax.Array
    b3: jax.Array

    @property
    def size(self) -> int:
        """Number of weights."""
        return sum(int(part.size) for part in self)


def apply(weights: Weights, closure_rel: jax.Array) -> jax.Array:
    """Return the force [N], shape (n, 3), of closures over the gap [1], shape (n, 9)."""
    square = jnp.mean(closure_rel**2, axis=-1, keepdims=True)
    size = jnp.sqrt(square + SOFT_REL**2)
    seen = jnp.concatenate([closure_rel / size, size], axis=-1)
    first = jnp.tanh(seen @ weights.w1.T + weights.b1)
    second = jnp.tanh(first @ weights.w2.T + weights.b2)
    pattern = second @ weights.w3.T + weights.b3
    return closure_rel @ weights.linear.T + square / size * pattern


def hidden_input(closure_rel: np.ndarray) -> np.ndarray:
    """Return what the first hidden layer sees, shape (n, 10); the same formula as in `apply`, in numpy."""
    size = np.sqrt(np.mean(closure_rel**2, axis=-1, keepdims=True) + SOFT_REL**2)
    return np.concatenate([closure_rel / size, size], axis=-1)
