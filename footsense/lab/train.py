"""Find the network's weights: Muon on random batches, one-cycle schedule, everything from one seed.

Muon orthogonalises the step of each matrix (offsets and nothing else go by Adam), so that weak patterns are learnt
as fast as strong ones: here it came in 50,000 steps to the error that Adam reached in 200,000.

The loss is the squared error over the squared force (with a floor), so that a degree counts the same at 0.3 N as
at 2 N. Inputs of the hidden layers are whitened while training, because the patterns that tell friction from
inclination are a hundred times weaker than the ones that carry the force; the whitening is then folded into W1.
The linear path starts at the least-squares read-out. The square's symmetry enters as eight copies of every case.
"""

from dataclasses import asdict, dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from numpy.typing import NDArray

from footsense.lab.network import Weights, apply, hidden_input


@dataclass(frozen=True, slots=True, kw_only=True)
class Protocol:
    """How a network is trained.

    Attributes:
        hidden: Units of each of the two hidden layers.
        steps: Steps, a multiple of 1000.
        batch: Cases in a step.
        rate: Highest learning rate.
        floor_n: Force below which errors count absolutely [N].
        seed: Of start weights and batches.
    """

    hidden: int = 36
    steps: int = 200_000
    batch: int = 1024
    rate: float = 2e-2
    floor_n: float = 0.3
    seed: int = 20090304

    def card(self) -> dict[str, Any]:
        """Return the protocol as JSON values."""
        return {"optimiser": "muon, cosine one-cycle", **asdict(self)}


def linear_start(
    closure_rel: NDArray[np.float64], force_n: NDArray[np.float64], floor_n: float
) -> NDArray[np.float64]:
    """Return the least-squares linear read-out [N], shape (3, 9), weighted like the loss and without offset."""
    weight = 1.0 / np.sqrt((force_n**2).sum(axis=1, keepdims=True) + floor_n**2)
    solution: NDArray[np.float64] = np.linalg.lstsq(closure_rel * weight, force_n * weight, rcond=None)[0]
    return solution.T


def _start(key: jax.Array, hidden: int) -> Weights:
    """Return random weights; the linear path is a correction to its start and begins at zero."""
    k1, k2, k3, k4 = jax.random.split(key, 4)
    return Weights(
        linear=jnp.zeros((3, 9)),
        w1=jax.random.normal(k1, (hidden, 10)) / np.sqrt(10.0),
        b1=0.5 * jax.random.normal(k2, (hidden,)),
        w2=jax.random.normal(k3, (hidden, hidden)) / np.sqrt(hidden),
        b2=jnp.zeros(hidden),
        w3=0.3 * jax.random.normal(k4, (3, hidden)) / np.sqrt(hidden),
        b3=jnp.zeros(3),
    )


def train(closure_rel: NDArray[np.float64], force_n: NDArray[np.float64], protocol: Protocol) -> Weights:
    """Train a network.

    Args:
        closure_rel: Closures over the gap, noise and symmetric copies included [1], shape (n, 9).
        force_n: Forces [N], shape (n, 3).
        protocol: How.

    Returns:
        The weights in the form of `network.apply`, float32.
    """
    pattern = hidden_input(closure_rel)
    variance, axes = np.linalg.eigh(np.cov(pattern.T))
    whiten = jnp.asarray((axes / np.sqrt(np.maximum(variance, 1e-8))).T, jnp.float32)
    mean = jnp.asarray(pattern.mean(axis=0), jnp.float32)
    linear = jnp.asarray(linear_start(closure_rel, force_n, protocol.floor_n), jnp.float32)
    inputs, targets = jnp.asarray(closure_rel, jnp.float32), jnp.asarray(force_n, jnp.float32)

    def folded(free: Weights) -> Weights:
        w1 = free.w1 @ whiten
        return free._replace(linear=linear + free.linear, w1=w1, b1=free.b1 - w1 @ mean)

    def loss(free: Weights, x: jax.Array, f: jax.Array) -> jax.Array:
        square = jnp.sum((apply(folded(free), x) - f) ** 2, axis=-1)
        return jnp.mean(square / (jnp.sum(f**2, axis=-1) + protocol.floor_n**2))

    schedule = optax.cosine_onecycle_schedule(protocol.steps, protocol.rate, pct_start=0.1)
    optimiser = optax.contrib.muon(schedule)

    def step(carry: tuple[Weights, Any], key: jax.Array) -> tuple[tuple[Weights, Any], None]:
        free, state = carry
        chosen = jax.random.randint(key, (protocol.batch,), 0, len(inputs))
        gradient = jax.grad(loss)(free, inputs[chosen], targets[chosen])
        change, state = optimiser.update(gradient, state, free)
        return (optax.apply_updates(free, change), state), None

    def thousand(carry: tuple[Weights, Any], key: jax.Array) -> tuple[Weights, Any]:
        after: tuple[Weights, Any] = jax.lax.scan(step, carry, jax.random.split(key, 1000))[0]
        return after

    start, *rounds = jax.random.split(jax.random.PRNGKey(protocol.seed), 1 + protocol.steps // 1000)
    free = _start(start, protocol.hidden)
    carry = (free, optimiser.init(free))
    compiled = jax.jit(thousand)
    for key in rounds:
        carry = compiled(carry, key)
    return folded(carry[0])


def predict(weights: Weights, closure_rel: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return forces [N], shape (n, 3), of closures over the gap, shape (n, 9), as float32 arithmetic has them."""
    return np.asarray(apply(weights, jnp.asarray(closure_rel, jnp.float32)), dtype=np.float64)
