"""A network like the released one for any number of inputs: a linear path beside two hidden layers."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from numpy.typing import NDArray

from footsense.lab.training.network import SOFT_REL

Vector = NDArray[np.float64]

#: Units of each of two hidden layers.
HIDDEN = 24
#: Cases in a step, highest learning rate, and force below which errors count absolutely [N].
_BATCH, _RATE, _FLOOR_N = 512, 1e-2, 0.1
_SEED = 20090304


def _features(closures: Any) -> tuple[Any, Any]:
    """Return pattern and size, shape (n, m + 1), and the scale of the nonlinear path, shape (n, 1), of (n, m)."""
    square = (closures**2).mean(axis=-1, keepdims=True)
    size = (square + SOFT_REL**2) ** 0.5
    module = jnp if isinstance(closures, jax.Array) else np
    return module.concatenate([closures / size, size], axis=-1), square / size


def train_scans(closures: Vector, force_n: Vector, steps: int) -> Callable[[Vector], Vector]:
    """Train a network; return a function from closures, shape (..., m), to forces [N], shape (..., 3).

    Args:
        closures: Inputs over the gap, shape (n, m).
        force_n: Forces [N], shape (n, 3).
        steps: Steps of Muon.
    """
    pattern, _ = _features(closures)
    variance, axes = np.linalg.eigh(np.cov(pattern.T))
    whiten = jnp.asarray(axes / np.sqrt(np.maximum(variance, 1e-7)), jnp.float32)
    mean = jnp.asarray(pattern.mean(axis=0), jnp.float32)
    weight = 1.0 / np.sqrt((force_n**2).sum(axis=1, keepdims=True) + _FLOOR_N**2)
    line = np.linalg.lstsq(closures * weight, force_n * weight, rcond=None)[0]
    x, f = jnp.asarray(closures, jnp.float32), jnp.asarray(force_n, jnp.float32)
    keys = jax.random.split(jax.random.PRNGKey(_SEED), 4)
    widths = (pattern.shape[1], HIDDEN, HIDDEN, 3)
    start = {
        "linear": jnp.asarray(line, jnp.float32),
        "weights": [
            jax.random.normal(key, pair) / np.sqrt(pair[0])
            for key, pair in zip(keys[:3], pairwise(widths), strict=True)
        ],
        "offsets": [jnp.zeros(width) for width in widths[1:]],
    }

    def answer(net: Any, inputs: jax.Array) -> jax.Array:
        layer, scale = _features(inputs)
        layer = (layer - mean) @ whiten
        for k in range(2):
            layer = jnp.tanh(layer @ net["weights"][k] + net["offsets"][k])
        return inputs @ net["linear"] + scale * (layer @ net["weights"][2] + net["offsets"][2])

    def loss(net: Any, inputs: jax.Array, force: jax.Array) -> jax.Array:
        square = ((answer(net, inputs) - force) ** 2).sum(axis=-1)
        return (square / ((force**2).sum(axis=-1) + _FLOOR_N**2)).mean()

    optimiser = optax.contrib.muon(optax.cosine_onecycle_schedule(steps, _RATE, pct_start=0.1))

    def step(carry: tuple[Any, Any], key: jax.Array) -> tuple[tuple[Any, Any], None]:
        chosen = jax.random.randint(key, (_BATCH,), 0, len(x))
        change, state = optimiser.update(jax.grad(loss)(carry[0], x[chosen], f[chosen]), carry[1], carry[0])
        return (optax.apply_updates(carry[0], change), state), None

    (net, _), _ = jax.jit(lambda carry, all_keys: jax.lax.scan(step, carry, all_keys))(
        (start, optimiser.init(start)), jax.random.split(keys[3], steps)
    )

    def read(inputs: Vector) -> Vector:
        flat = jnp.asarray(inputs.reshape(-1, inputs.shape[-1]), jnp.float32)
        return np.asarray(answer(net, flat), dtype=np.float64).reshape(*inputs.shape[:-1], 3)

    return read
