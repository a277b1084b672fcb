"""A network of other inputs and outputs is refused, whichever of them differs; one that fits gets what it is given."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from firmware_interface.conversion_order import CONVERSION_ORDERS
from footsense.daemon.foot_types import released_path
from footsense.errors import ModelError
from footsense.estimation.network import STEADY_AGES_S, Network, steady_windows
from footsense.ports import Window
from tests.support.networks import ALL_IN, ALL_OUT, DOUBLE, FLOAT, N_IN, N_OUT, card, network_file

TYPES = {FLOAT: "tensor(float)", DOUBLE: "tensor(double)"}


def test_readings_ages_and_mask_go_in_and_every_output_comes_out(tmp_path: Path) -> None:
    """Newest reading first, each by its elements; four outputs, of a row from that row alone."""
    weights = np.zeros((N_IN, N_OUT))
    # force: element 1 now, two readings ago, and of the age of element 5 one reading ago; sigma: the mask of 0, 4, 8.
    weights[[1, 18 + 2, 27 + 9 + 5, 54, 58, 62], range(6)] = 1.0
    weights[range(10, 18), range(6, 14)] = 1.0  # contact: elements 1 to 8 one reading ago
    network = Network(network_file(tmp_path, card(), weights=weights), 3)
    rng = np.random.default_rng(1)
    for _ in range(2):
        closure_rel, age_s = rng.random((2, 3, 3, 9))
        missing = rng.random((3, 9)) < 0.5
        load = network.estimate(Window(closure_rel, age_s, missing))
        expected_n = np.stack([closure_rel[:, 0, 1], closure_rel[:, 2, 2], age_s[:, 1, 5]], axis=1)
        np.testing.assert_allclose(load.force_n, expected_n, rtol=1e-6)
        np.testing.assert_array_equal(load.sigma_n, missing[:, [0, 4, 8]])
        np.testing.assert_allclose(load.contact_point_and_friction, closure_rel[:, 1, 1:5], rtol=1e-6)
        np.testing.assert_allclose(load.contact_sigma, closure_rel[:, 1, 5:], rtol=1e-6)
        assert {part.dtype for part in load} == {np.dtype(np.float64)}


def test_an_estimate_is_not_overwritten_by_the_next(tmp_path: Path) -> None:
    """The buffers stay with the runtime; a frame may be kept."""
    network = Network(network_file(tmp_path, card(), weights=np.ones((N_IN, N_OUT))), 1)
    first = network.estimate(steady_windows(np.full((1, 9), 0.5)))
    kept_n = first.force_n.copy()
    network.estimate(steady_windows(np.zeros((1, 9))))
    np.testing.assert_array_equal(first.force_n, kept_n)


@pytest.mark.parametrize("wrong", ["width", "type", "name", "missing", "extra"])
@pytest.mark.parametrize("at", [0, -1])
@pytest.mark.parametrize("kind", ["input", "output"])
def test_another_input_or_output_is_refused_with_what_there_is(
    tmp_path: Path, kind: str, at: int, wrong: str
) -> None:
    """One of another width, type or name, one that is missing, and one too many."""
    needed = ALL_IN if kind == "input" else ALL_OUT
    values = list(needed)
    name, width, _ = values[at]
    if wrong == "missing":
        del values[at]
    elif wrong == "extra":
        values.append((f"{name}_2", width, FLOAT))
    else:
        values[at] = {
            "width": (name, width - 1, FLOAT),
            "type": (name, width, DOUBLE),
            "name": (f"{name}_2", width, FLOAT),
        }[wrong]
    own_in, own_out = (values, ALL_OUT) if kind == "input" else (ALL_IN, values)
    path = network_file(tmp_path, card(), inputs=own_in, outputs=own_out)
    with pytest.raises(ModelError) as caught:
        Network(path, 12)
    found = ", ".join(f"{name} [n, {width}] {TYPES[each]}" for name, width, each in values)
    wanted = ", ".join(f"{name} [n, {width}]" for name, width, _ in needed)
    assert str(caught.value) == f"{path}: its {kind}s are {found}; the daemon needs float32 {wanted}"


def test_a_foot_at_rest_has_the_ages_at_the_end_of_a_scan() -> None:
    """In the order in which a robot reads them, one conversion apart, and a scan from reading to reading."""
    newest_first = np.array(CONVERSION_ORDERS["lo_shu"])[::-1]
    np.testing.assert_array_equal(STEADY_AGES_S[0].argsort(), newest_first)
    steps_s = np.diff(STEADY_AGES_S[:, newest_first].ravel())
    np.testing.assert_allclose(steps_s, steps_s[0])
    assert 2.5e-3 < steps_s[0] < 3e-3


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_weights_that_are_no_numbers_are_found_at_start(tmp_path: Path, number: float) -> None:
    """Before any force is sent: the network is tried over its trained range, contact and its sigma included."""
    weights = np.zeros((N_IN, N_OUT))
    weights[40, 13] = number  # the last output alone
    with pytest.raises(ModelError, match="inside its trained range; its weights are corrupt"):
        Network(network_file(tmp_path, card(), weights=weights), 2)


def test_the_released_network_reads_an_unloaded_foot_as_nothing() -> None:
    """Exactly, at any age and whatever is missing."""
    network = Network(released_path("network.onnx"), 4)
    missing = np.zeros((4, 9), bool)
    missing[1, 4] = missing[2, :3] = True
    age_s = STEADY_AGES_S * np.array([1.0, 0.3, 3.0, 1.0])[:, None, None]
    load = network.estimate(Window(np.zeros((4, 3, 9)), age_s, missing))
    assert not load.force_n.any()
    assert (load.sigma_n > 0.0).all()


def test_the_library_starts_no_thread_and_writes_no_file(tmp_path: Path) -> None:
    """Its telemetry would inherit the loop's scheduling, and leave an identity of the robot in the home directory."""
    program = (
        "import os; from footsense.daemon.models import load_models; from footsense.config import SMALL_BOARD;"
        "load_models(SMALL_BOARD); print(len(os.listdir('/proc/self/task')))"
    )
    environment = {name: value for name, value in os.environ.items() if not name.startswith("ORT_")}
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={**environment, "HOME": str(tmp_path), "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "1\n"
    assert list(tmp_path.iterdir()) == []
