"""Whatever is handed to the command line: one clear line, the right exit code, no traceback, no half-written file."""

import math
import re
from pathlib import Path

import numpy as np
import onnx
import pytest

from footsense.errors import ModelError
from footsense.estimation.network import Network
from footsense.foot.network_card import add_checksum
from tests.support.networks import N_IN, N_OUT, card, network_file
from tests.system.command import footsense, one_line_error, robot, serving

GOLDEN = Path(__file__).parents[2] / "golden/measured_walk.mcap"


@pytest.mark.parametrize(
    ("command", "exit_code", "says"),
    [
        ("run --config i2c/robot.yaml --record a.mcap", 69, "/dev/i2c-77: no such I2C adapter"),
        ("run --config can/robot.yaml --record a.mcap", 71, "CAN channel can77 (socketcan)"),
        ("run --config .", 78, ".: cannot be read: Is a directory"),
        (
            "run --scene moonwalk",
            78,
            "no scene 'moonwalk': there are faults, hanging, hexapod_2kg, measured_walk",
        ),
        ("check-config walk.mcap", 78, "is a recording; what is in it tells: footsense info walk.mcap"),
        ("run --scene scene.yaml", 78, "did you mean period_s"),
        ("install --root .", 1, " has no systemd, which starts the services: take Debian 12 or 13"),
        ("view --port 0 none.mcap", 74, "none.mcap"),
        ("view --port 0 --address 192.0.2.1", 78, "the page cannot be served on 192.0.2.1"),
        ("view --port 0 --address no.invalid", 78, "the page cannot be served on no.invalid:0: "),
    ],
)
def test_what_is_not_there_or_not_right(tmp_path: Path, command: str, exit_code: int, says: str) -> None:
    """One line says what is missing, without usage, and nothing is left behind."""
    (tmp_path / "scene.yaml").write_text("description: x\nload: {kind: tripod, perod_s: 1}\n")
    (tmp_path / "walk.mcap").write_bytes(b"\x89MCAP0\r\n" + bytes(300_000))
    for name, wrong in {
        "i2c": {"device": "/dev/i2c-77"},
        "can": {"interface": "socketcan", "channel": "can77"},
    }.items():
        (tmp_path / name).mkdir()
        robot(tmp_path / name, **wrong)
    assert says in one_line_error(footsense(*command.split(), cwd=tmp_path), exit_code)
    assert {path.name for path in tmp_path.iterdir()} == {"scene.yaml", "walk.mcap", "i2c", "can"}


def test_the_damage_of_a_recording_that_is_served_is_told_on_the_terminal(tmp_path: Path) -> None:
    """Below the address of the page, without words of Python."""
    file = tmp_path / "walk.mcap"
    file.write_bytes(GOLDEN.read_bytes()[:194_348])
    with serving("view", "--port", "0", file) as (process, url):
        assert url.startswith("http://")
        assert process.stderr is not None
        line = process.stderr.readline()
    assert re.match(
        rf"footsense: {re.escape(str(file))}: cut short or damaged at byte 1\d{{5}} of 194348 \(", line
    )


def test_a_configuration_with_a_typo(tmp_path: Path) -> None:
    """`check-config` and `run` say the same line: file, line, path, remedy; exit 78."""
    file = robot(tmp_path, more="scna: {}\n")
    line = one_line_error(footsense("check-config", file), 78)
    assert line == f"{file}:6: scna: unknown key; did you mean scan?"
    assert one_line_error(footsense("run", "--config", file), 78) == line


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
    assert "cannot be read: Is a directory" in refused()
    path.rmdir()
    assert "no checksum at its end" in refused(b"this is no network")
    assert "not a readable ONNX network" in refused(add_checksum(b"this is no network"))
    model = onnx.load(str(network_file(tmp_path, card())))
    model.graph.input[0].type.tensor_type.shape.dim[1].dim_value = 8
    assert "ncompatible dimensions" in refused(add_checksum(model.SerializeToString()))
