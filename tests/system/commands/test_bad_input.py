"""Whatever is handed to the command line: one clear line, the right exit code, no traceback, no half-written file."""

from pathlib import Path

import pytest

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
