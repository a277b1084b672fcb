"""`footsense init` as somebody runs it who has no file yet."""

from pathlib import Path

from click.testing import CliRunner

from footsense.cli import main
from footsense.config import load_config
from footsense.daemon.setup.found_feet import devices
from tests.system.command import footsense, one_line_error


def test_from_nothing_to_forces(tmp_path: Path) -> None:
    """What it writes is right and runs; a second one is refused and leaves the first as it is."""
    result = footsense(
        *("init", "--device", "sim", "--legs", "lf,lr,rf,rr", "--foot-type", "quadruped-12kg"), cwd=tmp_path
    )
    assert result.returncode == 0, result.stderr
    file = tmp_path / "robot.yaml"
    written = file.read_text()
    robot = load_config(file)
    assert robot.legs == ("lf", "lr", "rf", "rr")
    assert robot.foot_type == "quadruped-12kg"
    assert robot.can.executes_commands
    assert "robot.yaml is right" in footsense("check-config", "robot.yaml", cwd=tmp_path).stdout
    run = footsense(
        "run", "--config", "robot.yaml", "--duration", "1", "--fast", "--summary", "text", cwd=tmp_path
    )
    assert run.returncode == 0, run.stderr
    line = one_line_error(footsense("init", "--device", "sim", cwd=tmp_path), 78)
    assert line == "robot.yaml: exists and is not overwritten; name another file, or remove it"
    assert file.read_text() == written


def test_simulated_buses_share_the_legs(tmp_path: Path) -> None:
    """Their devices are `sim`, `sim1`, ..., as in a file that is written by hand."""
    result = footsense("init", "--device", "sim", "--device", "sim1", "--legs", "lf lr rf rr", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    robot = load_config(tmp_path / "robot.yaml")
    assert [(bus.device, list(bus.legs)) for bus in robot.buses] == [
        ("sim", ["lf", "lr"]),
        ("sim1", ["rf", "rr"]),
    ]
    assert robot.can.interface == "udp_multicast"


def test_it_asks_what_it_is_not_told(tmp_path: Path) -> None:
    """Enter takes what is offered: without hardware a simulated robot, with the legs of a hexapod."""
    file, n_devices = tmp_path / "robot.yaml", len(devices())
    simulated = n_devices + 1 if n_devices else ""
    result = CliRunner().invoke(main, ["init", str(file)], input=f"{simulated}\n\nhexapod-2kg\n")
    assert result.exit_code == 0, result.output
    robot = load_config(file)
    assert robot.legs == ("lf", "lm", "lr", "rf", "rm", "rr")
    assert robot.foot_type == "hexapod-2kg"


def test_a_wrong_answer_is_asked_again(tmp_path: Path) -> None:
    """Names that are no legs', or one of them twice, do not end the questions."""
    file, n_devices = tmp_path / "robot.yaml", len(devices())
    simulated = n_devices + 1 if n_devices else ""
    result = CliRunner().invoke(main, ["init", str(file)], input=f"{simulated}\nlf xx\nlf lf\nlf rf\n\n")
    assert result.exit_code == 0, result.output
    assert "xx: no leg has this name" in result.output
    assert load_config(file).legs == ("lf", "rf")


def test_what_cannot_be_is_one_line_and_writes_nothing(tmp_path: Path) -> None:
    """No answer, a name that is no leg's, an adapter that is not there."""
    for arguments, exit_code, says in (
        ("", 78, "nothing was written: a question has no answer; `footsense init --device sim`"),
        ("--device sim --legs lf,fl", 78, "fl: no leg has this name; there are lf lm lr rf rm rr l4 r4"),
        (
            "--device sim --device sim",
            78,
            "sim sim: a device is named twice; simulated buses are sim, sim1, ...",
        ),
        ("--device /dev/i2c-77", 69, "/dev/i2c-77: no such I2C adapter"),
        ("--device /dev/ttyACM77", 69, "/dev/ttyACM77"),
    ):
        result = footsense("init", *arguments.split(), cwd=tmp_path)
        assert result.returncode == exit_code
        assert says in result.stderr.splitlines()[-1]
        assert list(tmp_path.iterdir()) == []
