"""Whatever is handed to the command line: one clear line, the right exit code, no traceback, no half-written file."""

import math
from pathlib import Path

import numpy as np
import onnx
import pytest

from footsense.errors import ModelError
from footsense.estimation.network import Network
from footsense.foot.network_card import add_checksum
from tests.support.networks import N_IN, N_OUT, card, network_file
from tests.system.command import footsense, one_line_error, robot


@pytest.mark.parametrize(
    ("wrong", "says", "exit_code"),
    [
        ({"device": "/dev/i2c-77"}, "/dev/i2c-77: no such I2C adapter", 69),
        ({"interface": "socketcan", "channel": "can77"}, "CAN channel can77 (socketcan)", 71),
    ],
)
def test_hardware_that_is_not_there(tmp_path: Path, wrong: dict[str, str], says: str, exit_code: int) -> None:
    """One line, and no recording is left behind."""
    config = robot(tmp_path, **wrong)
    result = footsense("run", "--config", config, "--record", tmp_path / "a.mcap")
    assert says in one_line_error(result, exit_code)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["robot.yaml"]


def test_a_configuration_with_a_typo(tmp_path: Path) -> None:
    """`check-config` and `run` say the same line: file, line, path, remedy; exit 78."""
    file = robot(tmp_path, more="scna: {}\n")
    line = one_line_error(footsense("check-config", file), 78)
    assert line == f"{file}:6: scna: unknown key; did you mean scan?"
    assert one_line_error(footsense("run", "--config", file), 78) == line


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--config", "."), ".: cannot be read: Is a directory"),
        (
            ("--scene", "moonwalk"),
            "no scene 'moonwalk': there are faults, hanging, hexapod_2kg, measured_walk",
        ),
        (("--scene", "scene.yaml"), "did you mean period_s"),
    ],
)
def test_what_a_walk_is_made_of(
    tmp_path: Path, options: tuple[str, ...], says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A configuration that cannot be read, a scene that does not exist or has a typo: one line, and no usage."""
    (tmp_path / "scene.yaml").write_text("description: x\nload: {kind: tripod, perod_s: 1}\n")
    monkeypatch.chdir(tmp_path)
    assert says in one_line_error(footsense("run", *options), 78)


@pytest.mark.parametrize(
    ("options", "says", "code"),
    [
        (("none.mcap",), "none.mcap", 74),
        (("--address", "192.0.2.1"), "the page cannot be served on 192.0.2.1", 78),
    ],
)
def test_a_page_that_cannot_be_served(
    tmp_path: Path, options: tuple[str, ...], says: str, code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One line says what is missing."""
    robot(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert says in one_line_error(footsense("view", "--port", "0", *options), code)


@pytest.mark.parametrize(
    ("weight", "exit_code", "says"),
    [
        (1e3, 78, "contact.threshold_n: 0.03 N are lost in the noise of these feet; use at least"),
        (
            math.nan,
            66,
            "gives [nan, nan, nan] N, sigma [0.0, 0.0, 0.0] N inside its trained range; its weights",
        ),
    ],
)
def test_a_network_that_cannot_be_right(tmp_path: Path, weight: float, exit_code: int, says: str) -> None:
    """A foot that shows no contact, and corrupt weights: `check-config` and `run` say the same line."""
    weights = np.zeros((N_IN, N_OUT))
    weights[:9, :3] = weight
    network_file(tmp_path, card(), weights=weights)
    config = robot(tmp_path, more="model: network.onnx\n")
    line = one_line_error(footsense("check-config", config), exit_code)
    assert says in line
    result = footsense("run", "--config", config, "--duration", "1")
    assert (result.returncode, result.stderr.splitlines()[-1]) == (exit_code, f"footsense: {line}")


def test_what_is_no_network(tmp_path: Path) -> None:
    """A missing file, a folder, bytes that are no ONNX file, and one whose weights do not fit its input."""
    path = tmp_path / "network.onnx"

    def refused(content: bytes | None = None) -> str:
        if content is not None:
            path.write_bytes(content)
        with pytest.raises(ModelError) as caught:
            Network(path, 1)
        return str(caught.value)

    assert "network.onnx: no such network" in refused()
    path.mkdir()
    assert "not a file; name the network itself" in refused()
    path.rmdir()
    assert "no checksum at its end" in refused(b"this is no network")
    assert "not a readable ONNX network" in refused(add_checksum(b"this is no network"))
    model = onnx.load(str(network_file(tmp_path, card())))
    model.graph.input[0].type.tensor_type.shape.dim[1].dim_value = 8
    assert "ncompatible dimensions" in refused(add_checksum(model.SerializeToString()))
