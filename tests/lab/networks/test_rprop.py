"""RPROP against its definition, and the perceptrons that learn by it."""

from typing import Any

import jax.numpy as jnp
import numpy as np
import optax
import pytest
from hypothesis import given
from hypothesis import strategies as st

from footsense.foot.capacitor import Capacitor
from footsense.lab.training.load_cases import Cases
from footsense.lab.training.paper_procedure import (
    INITIAL_STEP,
    MAX_STEP,
    MIN_STEP,
    RPROP,
    STEP_GROWTH,
    STEP_SHRINKAGE,
    NetworkInput,
    PaperTraining,
    RpropState,
    loss,
    network_outputs,
    random_layers,
    stack,
    train,
    unstack,
)

pytestmark = pytest.mark.lab


def step(weights: Any, gradient: Any, state: Any) -> tuple[Any, Any]:
    """Return weights and state after one epoch of RPROP."""
    change, state = RPROP.update(gradient, state)
    return optax.apply_updates(weights, change), state


def test_rprop_follows_a_hand_computed_sequence() -> None:
    """Signs + + - - 0 -: grow, take back and forget, go on with the smaller step, stay, stay.

    By hand: 0.1 down; 0.12 down; sign change: size 0.06 and 0.12 back; nothing remembered: 0.06 up; no gradient:
    no move; nothing remembered: 0.06 up. The sizes of the gradients play no part.
    """
    gradients = [3.0, 1e-3, -7.0, -0.5, 0.0, -1e6]
    sizes = [0.1, 0.12, 0.06, 0.06, 0.06, 0.06]
    places = [0.9, 0.78, 0.90, 0.96, 0.96, 1.02]
    weight = jnp.asarray(1.0)
    state = RPROP.init(weight)
    for gradient, step_size, place in zip(gradients, sizes, places, strict=True):
        weight, state = step(weight, jnp.asarray(gradient), state)
        assert float(state.step_size) == pytest.approx(step_size, rel=1e-5)
        assert float(weight) == pytest.approx(place, rel=1e-5)


def test_rprop_keeps_each_weight_its_own_step() -> None:
    """In one array, one weight grows its step while the other takes its move back."""
    weights = {"a": jnp.zeros(2)}
    state = RPROP.init(weights)
    weights, state = step(weights, {"a": jnp.array([1.0, 1.0])}, state)
    weights, state = step(weights, {"a": jnp.array([1.0, -1.0])}, state)
    np.testing.assert_allclose(
        state.step_size["a"], [INITIAL_STEP * STEP_GROWTH, INITIAL_STEP * STEP_SHRINKAGE], rtol=1e-6
    )
    np.testing.assert_allclose(weights["a"], [-0.22, 0.0], atol=1e-6)
    assert state.gradient["a"].tolist() == [1.0, 0.0]


def test_a_step_stops_at_its_bounds() -> None:
    """Growth ends at 50, shrinkage at 1e-6, exactly."""
    one = jnp.asarray(1.0)
    wide = RpropState(step_size=jnp.asarray(49.0), gradient=one, weight_step=-one)
    assert float(step(one, one, wide)[1].step_size) == MAX_STEP
    narrow = RpropState(step_size=jnp.asarray(1.5e-6), gradient=one, weight_step=-one)
    assert float(step(one, -one, narrow)[1].step_size) == pytest.approx(MIN_STEP, rel=1e-6)


@given(
    gradient=st.lists(st.floats(-1e3, 1e3, width=32, allow_subnormal=False), min_size=1, max_size=12),
    step_size=st.floats(MIN_STEP, MAX_STEP),
)
def test_steps_stay_within_bounds_and_a_sign_change_halves_them(
    gradient: list[float], step_size: float
) -> None:
    """For any gradients and first step: bounds hold, no move exceeds its step, and each change of sign halves."""
    weight = jnp.asarray(0.0)
    state = RPROP.init(weight)._replace(step_size=jnp.asarray(step_size, jnp.float32))
    for g in gradient:
        before, place = state, float(weight)
        weight, state = step(weight, jnp.asarray(g, jnp.float32), state)
        after = float(state.step_size)
        assert MIN_STEP * (1 - 1e-6) <= after <= MAX_STEP
        if g * float(before.gradient) < 0.0:
            assert after == pytest.approx(max(STEP_SHRINKAGE * float(before.step_size), MIN_STEP), rel=1e-6)
            assert float(state.weight_step) == -float(before.weight_step)
            assert float(state.gradient) == 0.0
        else:
            assert abs(float(state.weight_step)) in {0.0, after}
            assert float(weight) == pytest.approx(place - np.sign(g) * after, rel=1e-5, abs=1e-6)


def test_forward_is_the_formula() -> None:
    """Against numpy in float64."""
    rng = np.random.default_rng(1)
    layers = random_layers(rng, (4, 5, 6, 2))
    inputs, targets = rng.uniform(size=(7, 4)), rng.uniform(size=(7, 2))
    hidden = inputs
    for layer in layers[:-1]:
        hidden = np.tanh(hidden @ layer.weight.astype(np.float64) + layer.bias)
    outputs = hidden @ layers[-1].weight.astype(np.float64) + layers[-1].bias
    np.testing.assert_allclose(network_outputs(layers, inputs), outputs, rtol=1e-4, atol=1e-5)
    wanted = float(((outputs - targets) ** 2).sum(axis=1).mean())
    assert float(loss(layers, inputs, targets)) == pytest.approx(wanted, rel=1e-5)


@pytest.mark.slow
def test_stacked_networks_learn_as_if_alone() -> None:
    """The second of two is the same by itself; the losses are those before each epoch, and they fall."""
    inputs = np.random.default_rng(4).uniform(size=(30, 3))
    targets = np.sin(3.0 * inputs[:, :1])
    starts = [random_layers(np.random.default_rng(seed), (3, 6, 1)) for seed in (0, 1)]
    both, one = stack(starts), stack(starts[1:])
    together = train(RPROP, both, inputs, targets, 200)
    alone = train(RPROP, one, inputs, targets, 200)
    np.testing.assert_allclose(together.losses[1], alone.losses[0], rtol=1e-3)
    assert together.losses[1, 0] == pytest.approx(float(loss(starts[1], inputs, targets)), rel=1e-5)
    assert (together.losses[:, -1] < 0.01 * together.losses[:, 0]).all()
    answer = network_outputs(unstack(together.layers)[0], inputs)
    assert float(jnp.mean((answer - targets) ** 2)) <= 1.1 * together.losses[0, -1]


@pytest.mark.parametrize("network_input", ["capacitance", "closure"])
def test_a_training_scales_by_its_cases_and_answers_in_newtons(network_input: NetworkInput) -> None:
    """Forces that are linear in the closures are read back to 10 % rms from either input, also in other cases."""
    design = Capacitor(gap_um=20.0, film_um=17.0, film_eps_r=2.7, electrode_area_mm2=16.0)
    rng = np.random.default_rng(5)
    closure_um = rng.uniform(1.0, 8.0, (300, 9))
    force_n = closure_um @ rng.uniform(-0.05, 0.05, (9, 3))
    training = PaperTraining(design, Cases(force_n[:200], closure_um[:200]), network_input)
    assert (training.inputs.max(), np.abs(training.targets).max()) == (1.0, 1.0)
    (read,) = training.train([random_layers(rng, (9, 6, 3))], 600)
    wrong_n = read(closure_um[200:]) - force_n[200:]
    assert np.sqrt(np.mean(wrong_n**2)) < 0.1 * np.sqrt(np.mean(force_n**2))
