"""Training loop of the symmetric networks: Muon optimiser, random batches, one-cycle schedule, one seed.

Muon orthogonalises the step of each matrix (the rest goes by Adam), so that weak patterns are learnt as fast as strong
ones. Every batch draws its own noise and its own missing elements.

The loss is the likelihood of the error under the network's sigma, so that cases which noise or a missing row makes
ambiguous do not dominate it; tempered, and with a share of the plain squared error over the squared force, so that
they still count. Inputs of the hidden layers are whitened while training, because the patterns that distinguish
friction from inclination are a hundred times weaker than those of the force; the whitening is then folded into the
first layer. The linear path starts at the least-squares estimator.

Source:
    Seitzer et al., On the pitfalls of heteroscedastic uncertainty estimation with probabilistic neural networks, ICLR
    2022, for the tempering.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
import optax
from numpy.typing import NDArray

from footsense.frames import Vector
from footsense.lab.training.symmetric_layers import linear_basis
from footsense.progress import progress_bar

Weights = TypeVar("Weights")

#: Tempering of the likelihood by a case's own sigma, the beta of Seitzer et al.: 0 is the likelihood, which neglects
#: hard cases; 1 is the squared error, which they dominate.
_LIKELIHOOD_TEMPERING_BETA = 0.25


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingSettings:
    """Training settings of a symmetric network: channels, steps, batch size, learning rate, seed.

    Attributes:
        channels: Channels of each of the two hidden layers, eight units each.
        steps: Steps, a multiple of those of a call.
        batch: Cases in a step.
        rate: Highest learning rate.
        min_force_n: Force below which errors count absolutely [N].
        seed: Seed of start weights, batches, noise and masks.
    """

    channels: int
    steps: int
    batch: int
    rate: float
    min_force_n: float = 0.3
    seed: int = 20090304

    def card(self) -> dict[str, Any]:
        """Return the training settings as JSON values for the network's card."""
        return {"optimiser": "muon, cosine one-cycle", **asdict(self)}


def whitening_transform(
    hidden_inputs: Vector, index: NDArray[np.intp], place: NDArray[np.intp], least_variance: float
) -> tuple[jax.Array, jax.Array]:
    """Return whitening matrix (inputs, inputs) and mean (inputs,) of the hidden layer's inputs, symmetrised.

    Args:
        hidden_inputs: Inputs of the first hidden layer, shape (n, inputs).
        index: Result of `hidden_input_index`, shape (8, inputs).
        place: The inputs to whiten: all but the masks.
        least_variance: Variance along an axis below which the inputs count as constant.
    """
    covariance = np.cov(hidden_inputs.T)
    covariance = np.mean([covariance[np.ix_(row, row)] for row in index], axis=0)
    mean = np.mean([hidden_inputs.mean(axis=0)[row] for row in index], axis=0)
    variance, axes = np.linalg.eigh(covariance[np.ix_(place, place)])
    whiten, shift = np.eye(len(mean)), np.zeros(len(mean))
    whiten[np.ix_(place, place)] = (axes / np.sqrt(np.maximum(variance, least_variance))) @ axes.T
    shift[place] = mean[place]
    return jnp.asarray(whiten, jnp.float32), jnp.asarray(shift, jnp.float32)


def fit_linear_start(inputs: Sequence[Vector], force_n: Vector, min_force_n: float) -> jax.Array:
    """Return start weights of the network's linear paths [N], by weighted least squares.

    Args:
        inputs: Closures over the gap [1], shape (n, elements) each.
        force_n: Forces [N], shape (n, 3).
        min_force_n: Force below which errors count absolutely [N].
    """
    weight = 1.0 / np.sqrt((force_n**2).sum(axis=1, keepdims=True) + min_force_n**2)
    basis = linear_basis()
    columns = [np.einsum("ne,beo->nob", part * weight, basis) for part in inputs]
    flat = np.concatenate(columns, axis=2).reshape(-1, len(basis) * len(columns))
    solution = np.linalg.lstsq(flat, (force_n * weight).ravel(), rcond=None)
    return jnp.asarray(solution[0], jnp.float32)


def force_likelihood_loss(
    force_n: Any, sigma_n: Any, true_n: Any, min_force_n: float, squared_error_weight: float
) -> Any:
    """Return the training loss of forces: tempered negative log-likelihood plus relative squared error.

    Args:
        force_n: Estimated forces [N], shape (n, 3).
        sigma_n: Their stated sigma [N], same shape.
        true_n: True forces [N], same shape.
        min_force_n: Force below which errors count absolutely [N].
        squared_error_weight: Weight of the squared error.
    """
    square = (force_n - true_n) ** 2
    scale = jnp.sqrt(jnp.sum(true_n**2, axis=-1, keepdims=True) + min_force_n**2)
    weight = jax.lax.stop_gradient(sigma_n / scale) ** (2.0 * _LIKELIHOOD_TEMPERING_BETA)
    likelihood = jnp.log(sigma_n) + 0.5 * square / sigma_n**2
    return jnp.mean(weight * likelihood) + squared_error_weight * jnp.mean(square / scale**2)


def fit(
    random_weights: Callable[[jax.Array, int], Weights],
    loss: Callable[[Weights, Any], jax.Array],
    random_batch: Callable[[Any, jax.Array], Any],
    data: Any,
    settings: TrainingSettings,
    steps_per_call: int,
    report: Callable[[str], object] = lambda _: None,
) -> Weights:
    """Return the weights after the given number of training steps.

    Args:
        random_weights: Returns start weights, of a key and the number of channels.
        loss: Returns the loss, of weights and a batch.
        random_batch: Returns a batch, of the data and a key.
        data: The cases and constants on the device.
        settings: Sizes, steps and seed.
        steps_per_call: Steps that are compiled into one call.
        report: Receives a line now and then.
    """
    schedule = optax.cosine_onecycle_schedule(settings.steps, settings.rate, pct_start=0.1)
    optimiser = optax.contrib.muon(schedule)

    def train_chunk(carry: tuple[Weights, Any], key: jax.Array, data: Any) -> Any:
        """Return the state after several training steps, as one compiled call."""

        def step(carry: tuple[Weights, Any], key: jax.Array) -> tuple[tuple[Weights, Any], jax.Array]:
            """Return the state after one training step, and the loss that it started from."""
            free, state = carry
            now, gradient = jax.value_and_grad(loss)(free, random_batch(data, key))
            change, state = optimiser.update(gradient, state, free)
            return (optax.apply_updates(free, change), state), now

        return jax.lax.scan(step, carry, jax.random.split(key, steps_per_call))

    start, *rounds = jax.random.split(jax.random.PRNGKey(settings.seed), 1 + settings.steps // steps_per_call)
    free = random_weights(start, settings.channels)
    carry = (free, optimiser.init(free))
    compiled = jax.jit(train_chunk)
    with progress_bar("training", len(rounds)) as rounds_done:
        for number, key in enumerate(rounds, 1):
            carry, losses = compiled(carry, key, data)
            if number % 10 == 0 or number == len(rounds):
                report(f"step {number * steps_per_call}: loss {float(losses.mean()):.4f}")
                rounds_done(number)  # after the loss was waited for
    return carry[0]
