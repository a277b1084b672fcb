"""A network that cannot be right is refused before the robot walks, in one line that says why."""

import math
import re
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import onnx
import pytest

from footsense.config import DEFAULT
from footsense.daemon.models import load_models
from footsense.errors import ModelError
from footsense.foot.network_card import add_checksum
from footsense.frames import Vector
from tests.support.networks import ALL_IN, ALL_OUT, FLOAT, N_IN, N_OUT, card, network_file
from tests.system.command import footsense, one_line_error, robot


def constant(value: float, outputs: slice) -> Vector:
    """Return weights of newest closures that are all the same for some of the outputs, else zero."""
    weights = np.zeros((N_IN, N_OUT))
    weights[:9, outputs] = value
    return weights


def refused(folder: Path) -> str:
    """Return the one line with which the network in a folder is refused."""
    with pytest.raises(ModelError) as caught:
        load_models(msgspec.structs.replace(DEFAULT, model=str(folder / "network.onnx")))
    line = str(caught.value)
    assert "\n" not in line
    return line


def test_a_network_that_fits_is_taken(tmp_path: Path) -> None:
    """What every other test here changes in one way is right as it is."""
    network_file(tmp_path, card())
    config = robot(tmp_path, more="model: network.onnx\n")
    result = footsense("check-config", config)
    assert (result.returncode, result.stderr) == (0, "")


def test_a_contact_that_a_stiff_foot_does_not_show_is_refused(tmp_path: Path) -> None:
    """`check-config` refuses a contact threshold below the noise of the forces."""
    network_file(tmp_path, card(), weights=constant(1e3, slice(3)))
    result = footsense("check-config", robot(tmp_path, more="model: network.onnx\n"))
    assert re.search(
        r"contact\.threshold_n: 0\.03 N are lost in the noise of these feet; use at least",
        one_line_error(result, 78),
    )


def test_what_is_no_network(tmp_path: Path) -> None:
    """A missing file, a folder, and bytes that are no ONNX file, with and without the checksum of one."""
    assert "network.onnx: no such network" in refused(tmp_path)
    (tmp_path / "network.onnx").mkdir()
    assert "not a file; name the network itself" in refused(tmp_path)
    (tmp_path / "network.onnx").rmdir()
    (tmp_path / "network.onnx").write_bytes(b"this is no network")
    assert "no checksum at its end" in refused(tmp_path)
    (tmp_path / "network.onnx").write_bytes(add_checksum(b"this is no network"))
    assert "not a readable ONNX network" in refused(tmp_path)


@pytest.mark.parametrize(
    ("shape", "says"),
    [
        (
            {"inputs": [("closure_rel", 9, FLOAT), ("missing", 9, FLOAT)]},
            "closure_rel [n, 9] tensor(float), missing [n, 9] tensor(float); the daemon needs float32 closure_rel",
        ),
        ({"inputs": ALL_IN[:2]}, "its inputs are closure_rel [n, 27] tensor(float), age_s"),
        ({"inputs": ALL_IN[::-1]}, "its inputs are missing [n, 9] tensor(float), age_s"),
        (
            {"outputs": ALL_OUT[:1]},
            "its outputs are force_n [n, 3] tensor(float); the daemon needs float32 force_n [n, 3], sigma_n",
        ),
    ],
)
def test_a_network_of_another_shape(tmp_path: Path, shape: dict[str, Any], says: str) -> None:
    """One of a former version, one that knows of no missing element, or of no sigma, is not used."""
    network_file(tmp_path, card(), **shape)
    assert says in refused(tmp_path)


@pytest.mark.parametrize(
    ("weight", "sigma_weight", "named"),
    [
        (math.nan, 0.0, "gives [nan, nan, nan] N, sigma [0.0, 0.0, 0.0] N"),
        (0.0, math.nan, "gives [0.0, 0.0, 0.0] N, sigma [nan, nan, nan] N"),
    ],
)
def test_a_network_that_gives_no_number_is_not_used(
    tmp_path: Path, weight: float, sigma_weight: float, named: str
) -> None:
    """Corrupt weights, of the force or of sigma, are found at once: `check-config` and `run` say the same line."""
    weights = constant(weight, slice(3)) + constant(sigma_weight, slice(3, 6))
    network_file(tmp_path, card(), weights=weights)
    config = robot(tmp_path, more="model: network.onnx\n")
    line = one_line_error(footsense("check-config", config), 66)
    assert line.endswith(f"network.onnx: {named} inside its trained range; its weights are corrupt")
    assert one_line_error(footsense("run", "--config", config, "--duration", "1"), 66) == line


def test_a_network_whose_weights_do_not_fit_its_input_is_told_with_the_reason(tmp_path: Path) -> None:
    """What ONNX Runtime has against it is in the line."""
    file = network_file(tmp_path, card())
    model = onnx.load(str(file))
    model.graph.input[0].type.tensor_type.shape.dim[1].dim_value = 8
    file.write_bytes(add_checksum(model.SerializeToString()))
    line = refused(tmp_path)
    assert "not a readable ONNX network (" in line
    assert "ncompatible dimensions" in line
