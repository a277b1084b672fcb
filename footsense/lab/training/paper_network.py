"""Multilayer perceptron of the paper (2009), tanh layers and a linear output layer, and its optimiser RPROP.

Many are trained in one compiled program, one after the other (`jax.lax.map`): on one core 10 to 30 % faster than side
by side (`jax.vmap`).

RPROP, with weight backtracking, is an optax transformation.

Each weight has a step of its own, which only the sign of its gradient changes:

    same sign as before    the step grows by 1.2, the weight moves by it against the gradient
    sign has changed       the step shrinks to a half, the weight takes its last move back and forgets the sign
    no sign before or now  the step stays, the weight moves by it against the gradient

The size of the gradient has no influence, so weights far from the output learn as fast as those near it. Not
`optax.rprop`: see docs/adr/0013.

Source:
    M. Riedmiller and H. Braun, "A Direct Adaptive Method for Faster Backpropagation Learning: The RPROP
    Algorithm", IEEE Int. Conf. Neural Networks, San Francisco, 1993: reference [12] of Aoyagi et al.
"""

from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from time import process_time
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from numpy.typing import NDArray

from footsense.lab.training.descent import descend

#: Growth and shrinkage of a step [1].
STEP_GROWTH, STEP_SHRINKAGE = 1.2, 0.5
#: First, smallest and largest step, in the unit of the weights.
INITIAL_STEP, MIN_STEP, MAX_STEP = 0.1, 1e-6, 50.0


class RpropState(NamedTuple):
    """RPROP's optimiser state after an epoch; each field is shaped like the weights.

    Attributes:
        step_size: Sizes of the steps, above 0.
        gradient: The gradient, 0 where a move was taken back.
        weight_step: The last change of the weights.
    """

    step_size: Any
    gradient: Any
    weight_step: Any


def _initial_state(weights: Any) -> RpropState:
    """Return the optimiser state before the first epoch."""
    zero = jax.tree.map(jnp.zeros_like, weights)
    return RpropState(jax.tree.map(lambda w: jnp.full_like(w, INITIAL_STEP), weights), zero, zero)


def _update_array(gradient: Any, step_size: Any, previous_gradient: Any, last_weight_step: Any) -> RpropState:
    """Return the optimiser state of one weight array after an epoch."""
    agreement = jnp.sign(gradient) * jnp.sign(previous_gradient)
    factor = jnp.where(agreement > 0.0, STEP_GROWTH, jnp.where(agreement < 0.0, STEP_SHRINKAGE, 1.0))
    step_size = jnp.clip(step_size * factor, MIN_STEP, MAX_STEP)
    overshot = agreement < 0.0
    weight_step = jnp.where(overshot, -last_weight_step, -jnp.sign(gradient) * step_size)
    return RpropState(step_size, jnp.where(overshot, 0.0, gradient), weight_step)


def _update_all(gradient: Any, state: Any, weights: Any = None) -> tuple[Any, RpropState]:
    """Return the weight steps and the optimiser state of all weights after an epoch."""
    del weights
    after = jax.tree.map(_update_array, gradient, *state)
    state = jax.tree.transpose(jax.tree.structure(gradient), jax.tree.structure(RpropState(0, 0, 0)), after)
    return state.weight_step, state


RPROP = optax.GradientTransformation(_initial_state, _update_all)


class Layer(NamedTuple):
    """One dense layer's weights and biases; leading axes count parallel networks.

    Attributes:
        weight: Connections, shape (..., n_in, n_out).
        bias: Biases, shape (..., n_out).
    """

    weight: Any
    bias: Any


#: The layers of a network, from the input on.
Layers = tuple[Layer, ...]


def random_layers(rng: np.random.Generator, widths: Sequence[int]) -> Layers:
    """Return random layers, uniform within 1 / sqrt(inputs), so that no neuron saturates.

    Args:
        rng: Source of the numbers.
        widths: Neurons of each layer, inputs and outputs included.
    """
    layers = []
    for n_in, n_out in pairwise(widths):
        drawn = (rng.uniform(-1.0, 1.0, (n_in + 1, n_out)) / np.sqrt(n_in)).astype(np.float32)
        layers.append(Layer(drawn[:-1], drawn[-1]))
    return tuple(layers)


def stack(networks: Sequence[Layers]) -> Layers:
    """Return networks of equal shape stacked into one: the first axis of every array counts the networks."""
    stacked: Layers = jax.tree.map(lambda *parts: np.stack(parts), *networks)
    return stacked


def unstack(layers: Layers) -> list[Layers]:
    """Return the separate networks of a stack."""
    return [jax.tree.map(lambda part: part[k], layers) for k in range(len(layers[0].weight))]  # noqa: B023


def network_outputs(layers: Layers, inputs: Any) -> jax.Array:
    """Return the outputs, shape (n, n_out), of one network for inputs (n, n_in)."""
    for layer in layers[:-1]:
        inputs = jnp.tanh(inputs @ layer.weight + layer.bias)
    outputs: jax.Array = inputs @ layers[-1].weight + layers[-1].bias
    return outputs


def loss(layers: Layers, inputs: Any, targets: Any) -> jax.Array:
    """Return the mean squared error [target unit squared], summed over the outputs."""
    return jnp.mean(jnp.sum((network_outputs(layers, inputs) - targets) ** 2, axis=-1))


class TrainedNetworks(NamedTuple):
    """Trained networks with their losses and processor time.

    Attributes:
        layers: The networks, stacked.
        losses: Loss before each epoch, shape (networks, epochs).
        processor_s: Processor time without compilation [s].
    """

    layers: Layers
    losses: NDArray[np.float64]
    processor_s: float


@partial(jax.jit, static_argnames=("rule", "epochs"))
def _train_epochs(
    rule: optax.GradientTransformation, epochs: int, layers: Layers, state: Any, inputs: Any, targets: Any
) -> tuple[Layers, jax.Array]:
    """Return the networks after several epochs, and their losses, shape (networks, epochs)."""

    def train_one(carry: tuple[Layers, Any]) -> tuple[Layers, jax.Array]:
        """Return one network after all epochs, and its loss before each epoch."""
        (after, _), losses = descend(
            rule,
            lambda layers, cases: loss(layers, *cases),
            lambda _: (inputs, targets),
            carry,
            jnp.arange(epochs),
        )
        return after, losses

    trained: tuple[Layers, jax.Array] = jax.lax.map(train_one, (layers, state))
    return trained


def train(
    rule: optax.GradientTransformation,
    layers: Layers,
    inputs: NDArray[np.float64],
    targets: NDArray[np.float64],
    epochs: int,
    state: Any = None,
) -> TrainedNetworks:
    """Train networks by full-batch epochs; return weights, losses and processor time.

    Args:
        rule: The optimiser.
        layers: The networks at the start, stacked.
        inputs: Shape (n, n_in), of the order of 1.
        targets: Shape (n, n_out), of the order of 1.
        epochs: How many.
        state: The optimiser's state at the start, networks as the first axis of every array; None for `rule.init`.
    """
    if state is None:
        state = jax.vmap(rule.init)(layers)
    cases = np.asarray(inputs, np.float32), np.asarray(targets, np.float32)
    compiled = _train_epochs.lower(rule, epochs, layers, state, *cases).compile()
    started_s = process_time()
    after, losses = jax.block_until_ready(compiled(layers, state, *cases))
    return TrainedNetworks(after, np.asarray(losses, dtype=np.float64), process_time() - started_s)
