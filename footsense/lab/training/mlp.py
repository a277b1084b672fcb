"""The multilayer perceptron of 2009: tanh layers and a linear one. For the studies; what is shipped is `network`.

Many of them learn in one compiled program, one after the other (`jax.lax.map`), which on one core took 10 to 30 %
less time than side by side (`jax.vmap`). A neuron whose weights are all zero says nothing and its gradient is
zero, so it stays silent under any rule that does not move without a gradient: networks of several widths go
through the same program padded with silent neurons.
"""

import resource
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray


class Layer(NamedTuple):
    """One layer of weights, with any number of networks as leading axes.

    Attributes:
        weight: Connections, shape (..., n_in, n_out).
        offset: Offsets, shape (..., n_out).
    """

    weight: Any
    offset: Any


#: The layers of a network, from the input on.
Layers = tuple[Layer, ...]

#: One epoch of a learning rule: makes weights and the rule's memory of weights, gradient and memory.
Step = Callable[[Any, Any, Any], tuple[Any, Any]]


def start_layers(rng: np.random.Generator, widths: Sequence[int], room: Sequence[int] = ()) -> Layers:
    """Return random layers, uniform within 1 / sqrt(inputs), so that no neuron starts in saturation.

    Args:
        rng: Source of the numbers.
        widths: Neurons of each layer, inputs and outputs included.
        room: Neurons that each layer is to be padded to with silent ones, as many as the widths; none if empty.
    """
    room = room or widths
    layers = []
    for n_in, n_out, room_in, room_out in zip(widths[:-1], widths[1:], room[:-1], room[1:], strict=True):
        drawn = rng.uniform(-1.0, 1.0, (n_in + 1, n_out)) / np.sqrt(n_in)
        layer = Layer(np.zeros((room_in, room_out), np.float32), np.zeros(room_out, np.float32))
        layer.weight[:n_in, :n_out], layer.offset[:n_out] = drawn[:-1], drawn[-1]
        layers.append(layer)
    return tuple(layers)


def stack(networks: Sequence[Layers]) -> Layers:
    """Return networks of the same shape as one, the networks being the first axis of every array."""
    stacked: Layers = jax.tree.map(lambda *parts: np.stack(parts), *networks)
    return stacked


def unstack(layers: Layers) -> list[Layers]:
    """Return stacked networks one by one."""
    return [jax.tree.map(lambda part: part[k], layers) for k in range(len(layers[0].weight))]  # noqa: B023


def forward(layers: Layers, inputs: Any) -> jax.Array:
    """Return the outputs, shape (n, n_out), of one network for inputs of shape (n, n_in)."""
    for layer in layers[:-1]:
        inputs = jnp.tanh(inputs @ layer.weight + layer.offset)
    outputs: jax.Array = inputs @ layers[-1].weight + layers[-1].offset
    return outputs


def loss(layers: Layers, inputs: Any, targets: Any) -> jax.Array:
    """Return the squared error of a case, summed over the outputs, mean over the cases."""
    return jnp.mean(jnp.sum((forward(layers, inputs) - targets) ** 2, axis=-1))


class Learnt(NamedTuple):
    """What came of learning.

    Attributes:
        layers: The networks, stacked.
        losses: Loss before each epoch, shape (networks, epochs).
        processor_s: Processor time of all of it, compilation apart [s].
    """

    layers: Layers
    losses: NDArray[np.float64]
    processor_s: float


@partial(jax.jit, static_argnames=("step", "epochs"))
def _run(
    step: Step, epochs: int, layers: Layers, memory: Any, inputs: Any, targets: Any
) -> tuple[Layers, jax.Array]:
    """Return the networks after the epochs, and their losses, shape (networks, epochs)."""

    def epoch(carry: tuple[Layers, Any], _: None) -> tuple[tuple[Layers, Any], jax.Array]:
        before, gradient = jax.value_and_grad(loss)(carry[0], inputs, targets)
        return step(carry[0], gradient, carry[1]), before

    def one(carry: tuple[Layers, Any]) -> tuple[Layers, jax.Array]:
        (after, _), losses = jax.lax.scan(epoch, carry, None, length=epochs)
        return after, losses

    learnt: tuple[Layers, jax.Array] = jax.lax.map(one, (layers, memory))
    return learnt


def _processor_s() -> float:
    """Return the processor time that this process has used [s]: what others on the machine do is not in it."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def learn(
    step: Step,
    layers: Layers,
    memory: Any,
    inputs: NDArray[np.float64],
    targets: NDArray[np.float64],
    epochs: int,
) -> Learnt:
    """Let networks learn by heart, all cases in every epoch.

    Args:
        step: The rule.
        layers: The networks at the start, stacked.
        memory: The rule's memory at the start, networks as the first axis of every array.
        inputs: Shape (n, n_in), of the order of 1.
        targets: Shape (n, n_out), of the order of 1.
        epochs: How many.
    """
    cases = np.asarray(inputs, np.float32), np.asarray(targets, np.float32)
    compiled = _run.lower(step, epochs, layers, memory, *cases).compile()
    started_s = _processor_s()
    after, losses = jax.block_until_ready(compiled(layers, memory, *cases))
    return Learnt(after, np.asarray(losses, dtype=np.float64), _processor_s() - started_s)
