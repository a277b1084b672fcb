"""A network that cannot be right is refused before the robot walks, in one line that says why."""

import json
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from footsense.config import DEFAULT
from footsense.daemon.models import load_models
from footsense.errors import ModelError
from footsense.foot.files.checksum_trailer import add_checksum
from footsense.foot.files.network_card import INPUT_ORDER, OUTPUT_ORDER
from tests.system.command import footsense, one_line_error, robot

NINE_INPUTS, THREE_NEWTONS = {"unit": "1", "order": INPUT_ORDER}, {"unit": "N", "order": OUTPUT_ORDER}
FITTING: dict[str, Any] = {
    "format": 2,
    "foot_type": "aoyagi-3x3",
    "input": {"name": "closure_rel", **NINE_INPUTS},
    "mask": {"name": "missing", **NINE_INPUTS},
    "output": {"name": "force_n", **THREE_NEWTONS},
    "sigma": {"name": "sigma_n", **THREE_NEWTONS},
    "gap_um": 20.0,
    "film_um": 17.0,
    "film_eps_r": 2.7,
    "electrode_area_mm2": 16.0,
    "closure_rel_min": [0.0] * 9,
    "closure_rel_max": [1.0] * 9,
    "moments": (np.eye(9) + 1.0).tolist(),
    "response_sha256": "",
}
BOTH_IN, BOTH_OUT = ("closure_rel", "missing"), ("force_n", "sigma_n")


def card(**changes: Any) -> str:
    """Return a card that fits but for the changes; what is changed to None is left out."""
    return json.dumps({key: value for key, value in {**FITTING, **changes}.items() if value is not None})


def moments(*changes: tuple[int, int, float]) -> list[list[float]]:
    """Return the moments of a fitting card with some entries set."""
    matrix = np.eye(9)
    for i, j, value in changes:
        matrix[i, j] = value
    return matrix.tolist()


def network_file(
    folder: Path,
    text: str | None,
    *,
    width: int = 9,
    inputs: Sequence[str] = BOTH_IN,
    outputs: Sequence[str] = BOTH_OUT,
    weight: float = 0.0,
    sigma_weight: float = 0.0,
) -> Path:
    """Write a small network of equal weights with this card or none, sigma from the last of its inputs."""

    def constant(name: str, value: float) -> onnx.TensorProto:
        return helper.make_tensor(name, TensorProto.FLOAT, [width, 3], [value] * 3 * width)

    nodes = [
        helper.make_node("MatMul", [inputs[0], "w"], [outputs[0]]),
        helper.make_node("MatMul", [inputs[-1], "v"], outputs[1:] or ["unused"]),
    ]
    graph = helper.make_graph(
        nodes,
        "n",
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", width]) for name in inputs],
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", 3]) for name in outputs],
        [constant("w", weight), constant("v", sigma_weight)],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    if text is not None:
        helper.set_model_props(model, {"footsense_card": text})
    file = folder / "network.onnx"
    file.write_bytes(add_checksum(model.SerializeToString()))
    return file


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
    network_file(tmp_path, card(), weight=1e3)
    result = footsense("check-config", robot(tmp_path, more="model: network.onnx\n"))
    assert re.search(
        r"contact\.threshold_n: 0\.03 N are lost in the noise of these feet; use at least",
        one_line_error(result, 2),
    )


def test_a_missing_network(tmp_path: Path) -> None:
    """The file is named."""
    assert "network.onnx: no such network" in refused(tmp_path)


def test_a_corrupt_network(tmp_path: Path) -> None:
    """Bytes that are no ONNX file, with and without the checksum of one."""
    (tmp_path / "network.onnx").write_bytes(b"this is no network")
    assert "no checksum at its end" in refused(tmp_path)
    (tmp_path / "network.onnx").write_bytes(add_checksum(b"this is no network"))
    assert "not a readable ONNX network" in refused(tmp_path)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (None, "no footsense_card inside"),
        ("{", "the card does not fit"),
        (card(foot_type="other-foot"), "made for foot type 'other-foot'"),
        (card(format=7), "card format 7, this version reads format 2"),
        (
            card(format=1, mask=None, sigma=None, moments=None),
            "card format 1, this version reads format 2",
        ),
        (card(input={**FITTING["input"], "unit": "um"}), "closure_rel is in 'um', the daemon needs '1'"),
        (card(sigma={**FITTING["sigma"], "unit": "mN"}), "sigma_n is in 'mN', the daemon needs 'N'"),
        (
            card(mask={**FITTING["mask"], "order": INPUT_ORDER.replace("leftmost", "rightmost")}),
            "missing is in the order 'flat index",
        ),
        (
            card(output={**FITTING["output"], "order": "z y x, foot frame"}),
            "is in the order 'z y x, foot frame', the daemon needs 'x y z",
        ),
        (card(mask=None), "the card does not fit: Object missing required field `mask`"),
        (card(sigma=None), "the card does not fit: Object missing required field `sigma`"),
        (card(moments=None), "the card does not fit: Object missing required field `moments`"),
        (card(input={**FITTING["input"], "name": "other"}), "the card names ['other', 'missing']"),
        (card(sigma=FITTING["output"]), "the card names ['force_n', 'force_n']"),
        (card(gap_um=0.0), "Expected `float` > 0.0 - at `$.gap_um`"),
        (card(gap_um=math.nan), "the card does not fit"),
        (card(closure_rel_max=[1.0, 0.0] + [1.0] * 7), "element 1 is trained from closure 0 to 0"),
        (card(moments=moments((0, 1, 0.5))), "moments have to be a symmetric, positive definite matrix"),
        (card(moments=moments((3, 3, 0.0))), "moments have to be a symmetric, positive definite matrix"),
        (
            card(moments=moments((0, 1, 2.0), (1, 0, 2.0))),
            "moments have to be a symmetric, positive definite matrix",
        ),
        (card(moments=np.eye(9)[:8].tolist()), "`$.moments`"),
        (card(moments=np.eye(9)[:, :8].tolist()), "`$.moments[0]`"),
        (card(moments=np.full((9, 9), 1e308).tolist()), "moments have to be"),
    ],
)
def test_a_network_whose_card_does_not_fit(tmp_path: Path, text: str | None, says: str) -> None:
    """Units, order, format, foot type, limits and moments are checked before anything runs."""
    network_file(tmp_path, text)
    assert says in refused(tmp_path)


@pytest.mark.parametrize(
    ("shape", "says"),
    [
        (
            {"width": 8},
            "its inputs are tensor(float) of shape ['n', 8] and tensor(float) of shape ['n', 8], the daemon needs two",
        ),
        (
            {"inputs": ("closure_rel",)},
            "its inputs are tensor(float) of shape ['n', 9], the daemon needs two, float32 of shape [n, 9]",
        ),
        (
            {"outputs": ("force_n",)},
            "its outputs are tensor(float) of shape ['n', 3], the daemon needs two, float32 of shape [n, 3]",
        ),
        (
            {"inputs": BOTH_IN[::-1]},
            "which the network does not have; it has ['missing', 'closure_rel']",
        ),
    ],
)
def test_a_network_of_another_shape(tmp_path: Path, shape: dict[str, Any], says: str) -> None:
    """One that knows of no missing element, or of no sigma, is not used."""
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
    network_file(tmp_path, card(), weight=weight, sigma_weight=sigma_weight)
    config = robot(tmp_path, more="model: network.onnx\n")
    line = one_line_error(footsense("check-config", config), 4)
    assert line.endswith(f"network.onnx: {named} inside its trained range; its weights are corrupt")
    assert one_line_error(footsense("run", "--config", config, "--duration", "1"), 4) == line


def test_a_network_whose_weights_do_not_fit_its_input_is_told_with_the_reason(tmp_path: Path) -> None:
    """What ONNX Runtime has against it is in the line."""
    file = network_file(tmp_path, card())
    model = onnx.load(str(file))
    model.graph.input[0].type.tensor_type.shape.dim[1].dim_value = 8
    file.write_bytes(add_checksum(model.SerializeToString()))
    line = refused(tmp_path)
    assert "not a readable ONNX network (" in line
    assert "ncompatible dimensions" in line


def test_a_folder_is_no_network(tmp_path: Path) -> None:
    """It is there, so `no such` would be wrong."""
    config = robot(tmp_path, more="model: .\n")
    assert "not a file, but a directory" in one_line_error(footsense("check-config", config), 4)
