"""Whatever is handed to the command line: one clear line, the right exit code, no traceback, no half-written file."""

from pathlib import Path
from unittest import mock

import pytest
from click.testing import CliRunner

from footsense.cli import main
from tests.system.command import footsense, one_line_error, robot


def test_an_i2c_adapter_that_is_not_there(tmp_path: Path) -> None:
    """Exit 69, and neither a recording nor a log is left behind."""
    config = robot(tmp_path, device="/dev/i2c-77")
    result = footsense(
        *("run", "--config", config, "--record", tmp_path / "a.mcap", "--can-log", tmp_path / "a.log")
    )
    assert "/dev/i2c-77: no such I2C adapter" in one_line_error(result, 69)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["robot.yaml"]


def test_a_configuration_that_may_not_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Exit 78 and one line, as for one that is wrong, and not the usage of the command."""
    config = robot(tmp_path)
    monkeypatch.setattr("os.access", lambda *_, **__: False)
    monkeypatch.setattr(
        "footsense.plain_yaml.Path.open",
        mock.Mock(side_effect=PermissionError(13, "Permission denied")),
    )
    result = CliRunner().invoke(main, ["run", "--config", str(config)])
    assert (result.exit_code, result.stderr) == (
        78,
        f"footsense: {config}: cannot be read: Permission denied\n",
    )


def test_a_can_channel_that_is_down(tmp_path: Path) -> None:
    """Exit 71, what to try, and nothing half-written."""
    config = robot(tmp_path, interface="socketcan", channel="can77")
    result = footsense(
        *("run", "--config", config, "--record", tmp_path / "a.mcap", "--can-log", tmp_path / "a.log")
    )
    assert "CAN channel can77 (socketcan)" in one_line_error(result, 71)
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
    """`check-config` and `run` say the same line: file, line, path, remedy; exit 78."""
    file = tmp_path / "robot.yaml"
    file.write_text(text)
    line = one_line_error(footsense("check-config", file), 78)
    assert says in line
    assert str(file) in line
    assert one_line_error(footsense("run", "--config", file), 78) == line


def test_a_scene_that_does_not_exist() -> None:
    """The scenes that do exist are named."""
    line = one_line_error(footsense("run", "--scene", "moonwalk"), 78)
    assert (
        "no scene 'moonwalk': there are faults, hanging, hexapod_2kg, measured_walk, quadruped_12kg, tripod"
        in line
    )


def test_a_scene_with_a_typo(tmp_path: Path) -> None:
    """Scenes are as strict as configurations."""
    scene = tmp_path / "scene.yaml"
    scene.write_text("description: x\nload: {kind: tripod, perod_s: 1}\n")
    assert "did you mean period_s" in one_line_error(footsense("run", "--scene", scene), 78)


def test_an_existing_recording_is_not_overwritten(tmp_path: Path) -> None:
    """The file stays as it is."""
    file = tmp_path / "walk.mcap"
    file.write_bytes(b"precious")
    line = one_line_error(footsense("run", "--duration", "1", "--fast", "--record", file), 74)
    assert "exists and is not overwritten" in line
    assert file.read_bytes() == b"precious"


def test_a_file_that_is_no_recording(tmp_path: Path) -> None:
    """Exit 3, one line."""
    file = tmp_path / "walk.mcap"
    file.write_bytes(b"precious")
    one_line_error(footsense("replay", file), 74)


def test_a_log_of_an_unknown_kind(tmp_path: Path) -> None:
    """The suffixes that are known are named."""
    line = one_line_error(footsense("run", "--duration", "1", "--can-log", tmp_path / "walk.txt"), 78)
    assert ".log, .asc, .blf" in line


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
