"""Whatever is handed to the command line: one clear line, the right exit code, no traceback, no half-written file."""

import math
from pathlib import Path

import onnx
import pytest
from onnx import TensorProto, helper

from footsense.inference.card import INPUT_ORDER, OUTPUT_ORDER
from tests.system.command import footsense, one_line_error

ROBOT = """
buses:
  - {device: DEVICE, legs: {lf: 0, rf: 1}}
can: {interface: INTERFACE, channel: CHANNEL}
"""


def robot(
    folder: Path, *, device: str = "sim", interface: str = "virtual", channel: str = "can0", more: str = ""
) -> Path:
    """Write a configuration file."""
    file = folder / "robot.yaml"
    text = ROBOT.replace("DEVICE", device).replace("INTERFACE", interface).replace("CHANNEL", channel)
    file.write_text(text + more)
    return file


def network_file(folder: Path, *, n_inputs: int = 9, card: str | None = None, weight: float = 0.0) -> Path:
    """Write a small network of equal weights with or without a card."""
    graph = helper.make_graph(
        [helper.make_node("MatMul", ["closure_rel", "w"], ["force_n"])],
        "n",
        [helper.make_tensor_value_info("closure_rel", TensorProto.FLOAT, ["n", n_inputs])],
        [helper.make_tensor_value_info("force_n", TensorProto.FLOAT, ["n", 3])],
        [helper.make_tensor("w", TensorProto.FLOAT, [n_inputs, 3], [weight] * 3 * n_inputs)],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    if card is not None:
        helper.set_model_props(model, {"footsense_card": card})
    file = folder / "network.onnx"
    onnx.save(model, str(file))
    return file


CARD = (
    '{"format": 1, "foot_type": "TYPE", "input": {"name": "closure_rel", "unit": "UNIT",'
    f' "order": "{INPUT_ORDER}"}}, "output": {{"name": "force_n", "unit": "N", "order": "{OUTPUT_ORDER}"}},'
    ' "gap_um": 20.0, "film_um": 17.0, "film_eps_r": 2.7,'
    ' "electrode_area_mm2": 16.0, "closure_rel_min": [0,0,0,0,0,0,0,0,0], "closure_rel_max": [1,1,1,1,1,1,1,1,1],'
    ' "sigma_floor_n": [0,0,0], "sigma_rel": [0,0,0], "response_sha256": ""}'
)


FITTING = CARD.replace("TYPE", "aoyagi-3x3").replace("UNIT", "1")


def test_a_missing_network(tmp_path: Path) -> None:
    """The file is named."""
    config = robot(tmp_path, more="model: nowhere.onnx\n")
    line = one_line_error(footsense("run", "--config", config, "--duration", "1"), 4)
    assert "nowhere.onnx: no such network" in line


def test_a_corrupt_network(tmp_path: Path) -> None:
    """Bytes that are no ONNX file."""
    (tmp_path / "network.onnx").write_bytes(b"this is no network")
    config = robot(tmp_path, more="model: network.onnx\n")
    assert "not a readable ONNX network" in one_line_error(
        footsense("run", "--config", config, "--duration", "1"), 4
    )


@pytest.mark.parametrize(
    ("n_inputs", "card", "says"),
    [
        (9, None, "no footsense_card inside"),
        (9, "{", "the card does not fit"),
        (9, CARD.replace("TYPE", "other-foot").replace("UNIT", "1"), "made for foot type 'other-foot'"),
        (9, CARD.replace("TYPE", "aoyagi-3x3").replace("UNIT", "um"), "is in 'um', the daemon needs '1'"),
        (8, FITTING, "input is tensor(float) of shape ['n', 8], the daemon needs float32 of shape [n, 9]"),
        (8, FITTING.replace("[0,0,0,0,0,0,0,0,0]", "[0,0,0,0,0,0,0,0]"), "of shape ['n', 8]"),
        (9, FITTING.replace("column 0 leftmost", "column 0 rightmost"), "is in the order 'flat index"),
        (
            9,
            FITTING.replace("x y z", "z y x"),
            "is in the order 'z y x, foot frame', the daemon needs 'x y z",
        ),
        (
            9,
            FITTING.replace('"sigma_rel": [0,', '"sigma_rel": [-0.1,'),
            "Expected `float` >= 0.0 - at `$.sigma_rel[0]`",
        ),
        (9, FITTING.replace('"sigma_rel": [0,', '"sigma_rel": [NaN,'), "the card does not fit"),
        (9, FITTING.replace('max": [1,1,', 'max": [1,0,'), "element 1 is trained from closure 0 to 0"),
        (9, FITTING.replace('"closure_rel"', '"other"'), "the card names 'other'"),
        (9, CARD.replace('"format": 1', '"format": 7'), "card format 7, this version reads format 1"),
    ],
)
def test_a_network_whose_card_does_not_fit(
    tmp_path: Path, n_inputs: int, card: str | None, says: str
) -> None:
    """Shape, unit, format and foot type are checked before anything runs."""
    network_file(tmp_path, n_inputs=n_inputs, card=card)
    config = robot(tmp_path, more="model: network.onnx\n")
    assert says in one_line_error(footsense("run", "--config", config, "--duration", "1"), 4)


def test_a_network_that_gives_no_number_is_not_used(tmp_path: Path) -> None:
    """Corrupt weights are found before the robot walks: `check-config` and `run` say the same line."""
    network_file(tmp_path, card=FITTING, weight=math.nan)
    config = robot(tmp_path, more="model: network.onnx\n")
    line = one_line_error(footsense("check-config", config), 4)
    assert line.endswith(
        "network.onnx: gives [nan, nan, nan] N inside its trained range; its weights are corrupt"
    )
    assert one_line_error(footsense("run", "--config", config, "--duration", "1"), 4) == line


def test_a_network_whose_weights_do_not_fit_its_input_is_told_with_the_reason(tmp_path: Path) -> None:
    """What ONNX Runtime has against it is in the line."""
    file = network_file(tmp_path, card=FITTING)
    model = onnx.load(str(file))
    model.graph.input[0].type.tensor_type.shape.dim[1].dim_value = 8
    onnx.save(model, str(file))
    config = robot(tmp_path, more="model: network.onnx\n")
    line = one_line_error(footsense("check-config", config), 4)
    assert "not a readable ONNX network (" in line
    assert "ncompatible dimensions" in line


def test_a_folder_is_no_network(tmp_path: Path) -> None:
    """It is there, so `no such` would be wrong."""
    config = robot(tmp_path, more="model: .\n")
    assert "not a file, but a directory" in one_line_error(footsense("check-config", config), 4)


def test_an_i2c_adapter_that_is_not_there(tmp_path: Path) -> None:
    """Exit 5, and neither a recording nor a log is left behind."""
    config = robot(tmp_path, device="/dev/i2c-77")
    result = footsense(
        *("run", "--config", config, "--record", tmp_path / "a.mcap", "--can-log", tmp_path / "a.log")
    )
    assert "/dev/i2c-77: no such I2C adapter" in one_line_error(result, 5)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["robot.yaml"]


def test_a_can_channel_that_is_down(tmp_path: Path) -> None:
    """Exit 6, what to try, and nothing half-written."""
    config = robot(tmp_path, interface="socketcan", channel="can77")
    result = footsense(
        *("run", "--config", config, "--record", tmp_path / "a.mcap", "--can-log", tmp_path / "a.log")
    )
    assert "CAN channel can77 (socketcan)" in one_line_error(result, 6)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["robot.yaml"]


CLASH = """
buses:
  - device: sim
    legs: {lf: 0}
    mux: {address: 0x70}
    other_devices: [{name: pca9685, address: 0x40}]
can: {interface: virtual}
"""


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("buses: [{device: sim, legs: {lf: 0, rf: 0}}]\ncan: {interface: virtual}\n", "buses[0].legs"),
        ("buses: [{device: sim, legs: {lf: 0}}]\ncan: {interface: virtual}\nscna: {}\n", "did you mean scan"),
        ("buses: [{device: sim, legs: {lf: 9}}]\ncan: {interface: virtual}\n", "buses[0].legs.lf"),
        (CLASH, "0x70"),
    ],
)
def test_a_configuration_that_contradicts_itself(tmp_path: Path, text: str, says: str) -> None:
    """`check-config` and `run` say the same line: file, line, path, remedy; exit 2."""
    file = tmp_path / "robot.yaml"
    file.write_text(text)
    line = one_line_error(footsense("check-config", file), 2)
    assert says in line
    assert str(file) in line
    assert one_line_error(footsense("run", "--config", file), 2) == line


def test_a_scene_that_does_not_exist() -> None:
    """The scenes that do exist are named."""
    line = one_line_error(footsense("run", "--scene", "moonwalk"), 2)
    assert "no scene 'moonwalk': there are hanging, measured_walk, tripod" in line


def test_a_scene_with_a_typo(tmp_path: Path) -> None:
    """Scenes are as strict as configurations."""
    scene = tmp_path / "scene.yaml"
    scene.write_text("description: x\nload: {kind: tripod, perod_s: 1}\n")
    assert "did you mean period_s" in one_line_error(footsense("run", "--scene", scene), 2)


def test_an_existing_recording_is_not_overwritten(tmp_path: Path) -> None:
    """The file stays as it is."""
    file = tmp_path / "walk.mcap"
    file.write_bytes(b"precious")
    line = one_line_error(footsense("run", "--duration", "1", "--fast", "--record", file), 3)
    assert "exists and is not overwritten" in line
    assert file.read_bytes() == b"precious"


def test_a_file_that_is_no_recording(tmp_path: Path) -> None:
    """Exit 3, one line."""
    file = tmp_path / "walk.mcap"
    file.write_bytes(b"precious")
    one_line_error(footsense("replay", file), 3)


def test_a_log_of_an_unknown_kind(tmp_path: Path) -> None:
    """The suffixes that are known are named."""
    line = one_line_error(footsense("run", "--duration", "1", "--can-log", tmp_path / "walk.txt"), 2)
    assert ".log, .asc, .blf" in line
