"""The windowed network: its features, its symmetry, and one ONNX graph that computes the same."""

from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from onnx import TensorProto

from footsense.estimation.missing_elements import MISSING_SETS
from footsense.estimation.network import STEADY_AGES_S
from footsense.foot.network_card import INPUTS, OUTPUTS
from footsense.lab.symmetry import SYMMETRIES, element_permutation
from footsense.lab.training.export import OnnxNetwork, as_stored, load_weights, onnx_model
from footsense.lab.training.windowed_network import (
    FEATURES_PER_ELEMENT,
    FEATURES_PER_FOOT,
    LN_SIGMA_BOUNDS,
    MAX_FEATURE,
    Features,
    Weights,
    features,
    linear_basis,
    predict,
)
from footsense.ports import LoadEstimate, Window
from tests.lab.networks.windows import STEP_S, assert_symmetric, some_windows, turned
from tests.support.networks import CARD

pytestmark = pytest.mark.lab

Vector = NDArray[np.float64]


def some_weights(channels: int = 3, seed: int = 0, size: float = 0.5) -> Weights:
    """Return weights that nobody trained."""
    rng = np.random.default_rng(seed)
    c = channels
    n_linear, n_inputs = 2 * len(linear_basis()), FEATURES_PER_ELEMENT * 9 + FEATURES_PER_FOOT
    shapes = [(n_linear,), (c, n_inputs), (c,), (c, 8 * c), (c,), (c, 7), (c, 7), (4,)]
    return Weights(*(rng.normal(0.0, size, shape).astype(np.float32) for shape in shapes))


def seen_of(window: Window) -> Features:
    closure_rel, age_s, missing = (np.asarray(part, np.float64) for part in window)
    return features(closure_rel, age_s, missing, np)


def in_double(weights: Weights, window: Window) -> LoadEstimate:
    """Return the loads of some windows in double precision: unit g of a channel sees the foot turned back by g."""
    linear, w1, b1, w2, b2, out, sigma, sigma_offset = (np.asarray(part, np.float64) for part in weights)
    c = len(b1)
    seen = seen_of(window)
    images = [element_permutation(g) for g in SYMMETRIES]
    first = [
        np.tanh(seen_of(turned(window, np.argsort(image))).hidden_inputs @ w1.T + b1) for image in images
    ]
    by_relative = w2.reshape(c, 8, c)
    outputs, ln_sigma = np.zeros((2, len(seen.extrapolated_closure_rel), 7))
    for g in SYMMETRIES:
        total = b2 + sum(first[k] @ by_relative[:, place_of(g.T @ h)].T for k, h in enumerate(SYMMETRIES))
        turn = block_diagonal(g, g[:2, :2], g[:2, :2])
        outputs += np.tanh(total) @ out @ turn.T
        ln_sigma += np.tanh(total) @ sigma @ np.abs(turn).T
    level, slope = (np.tensordot(part, linear_basis(), 1) for part in (linear[:5], linear[5:]))
    square = (seen.extrapolated_closure_rel**2).mean(axis=1, keepdims=True)
    force_n = (
        seen.extrapolated_closure_rel @ level
        + (seen.extrapolated_closure_rel - seen.newest_closure_rel) @ slope
        + square / seen.closure_rms_rel * outputs[:, :3]
    )
    sigma_of = np.exp(np.clip(ln_sigma + sigma_offset[[0, 0, 1, 2, 2, 3, 3]], *LN_SIGMA_BOUNDS))
    return LoadEstimate(force_n, seen.closure_rms_rel * sigma_of[:, :3], outputs[:, 3:], sigma_of[:, 3:])


def place_of(symmetry: Vector) -> int:
    """Return the place of a symmetry in their list."""
    [place] = [k for k, known in enumerate(SYMMETRIES) if np.array_equal(known, symmetry)]
    return place


def block_diagonal(*blocks: Vector) -> Vector:
    matrix = np.zeros((7, 7))
    at = 0
    for block in blocks:
        matrix[at : at + len(block), at : at + len(block)] = block
        at += len(block)
    return matrix


def in_file(folder: Path, weights: Weights) -> OnnxNetwork:
    onnx.save(onnx_model(weights, CARD), folder / "network.onnx")
    return OnnxNetwork(folder / "network.onnx")


def test_the_network_has_the_squares_symmetry_whatever_its_weights(tmp_path: Path) -> None:
    """By construction: exactly in double precision, and in the file as exactly as float32 can."""
    weights = some_weights()
    assert_symmetric(lambda window: in_double(weights, window), atol=1e-12)
    assert_symmetric(lambda window: predict(weights, window), atol=2e-4)
    assert_symmetric(in_file(tmp_path, weights).estimate, atol=2e-4)


def test_the_linear_paths_are_all_maps_with_the_squares_symmetry() -> None:
    """Each turns with the foot, and they are as many as the characters of the group say."""
    basis, images = linear_basis(), [element_permutation(g) for g in SYMMETRIES]
    for g, image in zip(SYMMETRIES, images, strict=True):
        np.testing.assert_array_equal(basis[:, image], basis @ g.T)
    kept = [(image == np.arange(9)).sum() * np.trace(g) for g, image in zip(SYMMETRIES, images, strict=True)]
    assert np.linalg.matrix_rank(basis.reshape(len(basis), -1)) == len(basis) == sum(kept) / 8


@pytest.mark.parametrize("seed", range(4))
def test_the_paper_the_file_and_jax_compute_the_same(tmp_path: Path, seed: int) -> None:
    """Features and network in one graph, in float32: in motion, at rest, of wild readings and of the smallest loads."""
    weights, rng = as_stored(some_weights(4, seed, 0.3)), np.random.default_rng(seed)
    in_motion = some_windows(48, seed)
    at_rest = np.repeat(rng.uniform(0.0, 0.8, (16, 1, 9)), 3, axis=1)
    steps = rng.uniform(-5.0, 5.0, (16, 3, 9))
    window = Window(
        np.concatenate([in_motion.closure_rel, at_rest, 1e-4 * at_rest, steps]),
        np.concatenate([in_motion.age_s, np.tile(STEADY_AGES_S, (48, 1, 1))]),
        np.concatenate([in_motion.missing, MISSING_SETS, MISSING_SETS, MISSING_SETS]),
    )
    exact = in_double(weights, window)
    size_n = np.abs(exact.force_n).max(axis=1, keepdims=True)
    for found in (in_file(tmp_path, weights).estimate(window), predict(weights, window)):
        # Differences of readings lose digits: a few units of the last place of the largest.
        assert (np.abs(found.force_n - exact.force_n) < 3e-5 * (size_n + 0.1)).all()
        np.testing.assert_allclose(found.sigma_n, exact.sigma_n, rtol=3e-4)
        np.testing.assert_allclose(
            found.contact_point_and_friction, exact.contact_point_and_friction, atol=2e-4
        )
        np.testing.assert_allclose(found.contact_sigma, exact.contact_sigma, rtol=3e-4)


def test_no_load_is_exactly_no_force(tmp_path: Path) -> None:
    """Whatever the ages and whatever is missing: zero to the bit, with a sigma above it, and numbers everywhere."""
    weights = some_weights()
    window = some_windows()._replace(closure_rel=np.zeros((40, 3, 9)))
    for load in (
        in_double(weights, window),
        predict(weights, window),
        in_file(tmp_path, weights).estimate(window),
    ):
        assert not load.force_n.any()
        assert (load.sigma_n > 0.0).all()
        assert np.isfinite(load.contact_point_and_friction).all()
        assert (load.contact_sigma > 0.0).all()


def test_a_row_is_computed_from_its_own_readings_alone(tmp_path: Path) -> None:
    """To the bit: a fault of one leg changes no other leg's force, and any number of legs is one call."""
    network, window = in_file(tmp_path, some_weights()), some_windows(6)
    together = network.estimate(window)
    closure_rel = window.closure_rel.copy()
    closure_rel[2] = 7.0
    disturbed = network.estimate(window._replace(closure_rel=closure_rel))
    others = [0, 1, 3, 4, 5]
    for one, other in zip(together, disturbed, strict=True):
        np.testing.assert_array_equal(one[others], other[others])
    for row in range(6):
        one_row = Window(*(part[row : row + 1] for part in window))  # type: ignore[arg-type]
        alone = network.estimate(one_row)
        np.testing.assert_allclose(alone.force_n, together.force_n[row : row + 1], rtol=1e-5, atol=1e-6)


@given(
    st.lists(st.floats(-1e3, 1e3), min_size=27, max_size=27),
    st.floats(-0.1, 10.0),
    st.lists(st.floats(0.0, 10.0), min_size=18, max_size=18),
)
@settings(deadline=None)
def test_no_window_makes_something_that_is_no_number(
    closures: list[float], newest_s: float, later_s: list[float]
) -> None:
    """Any closures, ages from the future to seconds, readings of the same time: bounded features, honest numbers."""
    ages_s = newest_s + np.concatenate([np.zeros((1, 9)), np.cumsum(np.reshape(later_s, (2, 9)), axis=0)])
    window = Window(np.reshape(closures, (1, 3, 9)), ages_s[None], np.zeros((1, 9), bool))
    seen = seen_of(window)
    assert np.abs(seen.hidden_inputs[:, : (FEATURES_PER_ELEMENT - 1) * 9]).max() <= MAX_FEATURE
    load = predict(some_weights(), window)
    assert all(np.isfinite(part).all() for part in load)
    assert (load.sigma_n >= 0.9 * float(np.exp(LN_SIGMA_BOUNDS[0])) * seen.closure_rms_rel).all()
    assert (load.sigma_n <= 1.1 * float(np.exp(LN_SIGMA_BOUNDS[1])) * seen.closure_rms_rel).all()


def along_a_line(closure_rel: Vector, rate_per_s: Vector, age_s: Vector) -> Window:
    """Return windows of closures that grow evenly to `closure_rel` at the asked time."""
    past = closure_rel[:, None] - rate_per_s[:, None] * age_s
    return Window(past, age_s, np.zeros(closure_rel.shape, bool))


def test_even_motion_is_seen_as_of_the_asked_time() -> None:
    """Whenever and in whatever order the elements were read, however long ago: the same load, no curvature."""
    rng = np.random.default_rng(5)
    closure_rel = np.tile(rng.uniform(0.1, 0.6, 9), (30, 1))
    rate = np.tile(rng.uniform(-4.0, 4.0, 9), (30, 1))
    orders = np.argsort(rng.random((30, 9)), axis=1)
    age_s = rng.uniform(0.0, 0.02, (30, 1, 1)) + STEP_S * (orders[:, None] + 9 * np.arange(3)[:, None])
    seen = seen_of(along_a_line(closure_rel, rate, age_s))
    np.testing.assert_allclose(seen.extrapolated_closure_rel, closure_rel, atol=1e-12)
    planes = (
        seen.hidden_inputs[:, : FEATURES_PER_ELEMENT * 9].reshape(30, FEATURES_PER_ELEMENT, 9)
        * seen.closure_rms_rel[:, None]
    )
    np.testing.assert_allclose(planes[:, 1], 9 * STEP_S * rate, atol=1e-12)
    np.testing.assert_allclose(planes[:, 3:6], 0.0, atol=1e-12)


def test_the_period_of_the_scan_is_seen_and_its_unit_is_not() -> None:
    """A foot that is read half as fast, of a load half as fast, differs in one input: the logarithm of the period."""
    window = some_windows()
    seen, slower = (
        seen_of(window._replace(age_s=factor * window.age_s)).hidden_inputs for factor in (1.0, 2.0)
    )
    np.testing.assert_allclose(slower[:, :-1], seen[:, :-1], atol=1e-12)
    np.testing.assert_allclose(slower[:, -1] - seen[:, -1], np.log(2.0))


def test_the_file_holds_each_weight_once(tmp_path: Path) -> None:
    """In the old format that every runtime reads, with the card's inputs and outputs and any number of rows.

    Those of the second layer in 16 bits; what is read of a file is what it computes with.
    """
    weights = as_stored(some_weights(5))
    model = onnx_model(weights, CARD)
    assert (model.ir_version, model.opset_import[0].version) == (8, 17)
    for values, signals in ((model.graph.input, INPUTS), (model.graph.output, OUTPUTS)):
        shapes: list[Any] = [
            (value.name, [dim.dim_param or dim.dim_value for dim in value.type.tensor_type.shape.dim])
            for value in values
        ]
        assert shapes == [(signal.name, ["n", signal.width]) for signal in signals]
    stored = {tensor.name: tensor for tensor in model.graph.initializer}
    assert {tensor.data_type for name, tensor in stored.items() if name in weights._fields} == {
        TensorProto.FLOAT
    }
    assert stored["w2_steps"].data_type == TensorProto.INT16
    onnx.save(model, tmp_path / "network.onnx")
    for weight, again in zip(weights, load_weights(tmp_path / "network.onnx"), strict=True):
        np.testing.assert_array_equal(weight, again)
    assert weights.n_weights == 10 + 5 * 65 + 5 + 5 * 40 + 5 + 70 + 4
