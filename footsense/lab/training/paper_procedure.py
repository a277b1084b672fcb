"""The paper's network and its training: capacitances to forces, tanh layers, RPROP, 362 training cases.

It uses nothing of what the other networks know about the foot: ΔC unless closures are chosen, no symmetry, no linear
path. Inputs and forces are divided by the largest of the training cases.

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
    Aoyagi et al., sections III D to III G;
    M. Riedmiller and H. Braun, "A Direct Adaptive Method for Faster Backpropagation Learning: The RPROP
    Algorithm", IEEE Int. Conf. Neural Networks, San Francisco, 1993: their reference [12].
"""

from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from time import process_time
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from numpy.typing import NDArray

from footsense.foot.capacitor import Capacitor
from footsense.frames import Vector
from footsense.lab.evaluation.evaluate_models import ForceEstimator
from footsense.lab.training.descent import descend
from footsense.lab.training.load_cases import Cases, closure_of_designed_foot_um

#: Inputs of a network: capacitance changes, as in the paper, or the gap closures that elastance measures.
NetworkInput = Literal["capacitance", "closure"]

#: Neurons of the two hidden layers, twice the inputs; the paper found its own by trial and error (Table I).
HIDDEN_NEURONS = (18, 18)
#: Epochs of training; the paper states none. Four times as many change the errors by less than the seeds do.
EPOCHS = 5000
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
    return inputs @ layers[-1].weight + layers[-1].bias


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


class PaperTraining:
    """Training set for plain networks: scaled inputs (capacitance changes or closures) and forces.

    Args:
        design: Electrical design of the capacitors.
        training: The cases.
        network_input: Inputs of the networks.

    Attributes:
        inputs: Shape (n, 9), the largest 1.
        targets: Shape (n, 3), the largest force component 1.
    """

    def __init__(
        self, design: Capacitor, training: Cases, network_input: NetworkInput = "capacitance"
    ) -> None:
        self._design, self._input_kind = design, network_input
        fed = self._network_inputs(training.closure_um)
        self._input_scale = float(np.abs(fed).max())
        self._force_scale_n = float(np.abs(training.force_n).max())
        self.inputs = fed / self._input_scale
        self.targets = training.force_n / self._force_scale_n

    def _network_inputs(self, closure_um: Vector) -> Vector:
        """Return the network's inputs from closures [um]: capacitance changes [pF] or closures, (n, 9)."""
        if self._input_kind == "closure":
            return closure_um
        return self._design.capacitance_pf(closure_um) - self._design.unloaded_pf

    def _force_estimator(self, network: Layers) -> ForceEstimator:
        """Return a network as a function from closures [um] to forces [N]."""

        def read(closure_um: Vector) -> Vector:
            """Return forces [N] from closures [um]."""
            inputs = (self._network_inputs(closure_um) / self._input_scale).astype(np.float32)
            return np.asarray(network_outputs(network, inputs), dtype=np.float64) * self._force_scale_n

        return read

    def train(self, starts: Sequence[Layers], epochs: int) -> list[ForceEstimator]:
        """Return force estimators trained by RPROP, one per set of start weights."""
        trained = train(RPROP, stack(starts), self.inputs, self.targets, epochs)
        return [self._force_estimator(network) for network in unstack(trained.layers)]


def start_weights_by_seed(seeds: int, widths: Sequence[int] = (9, *HIDDEN_NEURONS, 3)) -> list[Layers]:
    """Return random start weights of one network per seed, from seed 0."""
    return [random_layers(np.random.default_rng(seed), widths) for seed in range(seeds)]


def per_foot_force_n(
    design: Capacitor, seed: int, epochs: int, training_pf: Vector, force_n: Vector, test_pf: Vector
) -> Vector:
    """Return forces [N], (m, 3), estimated by a network trained on one foot's calibration loads.

    Args:
        design: Electrical design of the capacitors, without effect: the inputs are changes of capacitance.
        seed: Seed of the network's start; each foot has its own.
        epochs: Training epochs.
        training_pf: Changes of capacitance under the training loads [pF], shape (n, 9).
        force_n: Reference forces of the training loads [N], shape (n, 3).
        test_pf: Changes of capacitance under the other loads [pF], shape (m, 9).
    """
    training = PaperTraining(design, Cases(force_n, closure_of_designed_foot_um(design, training_pf)))
    start = random_layers(np.random.default_rng(seed), (9, *HIDDEN_NEURONS, 3))
    return training.train([start], epochs)[0](closure_of_designed_foot_um(design, test_pf))
