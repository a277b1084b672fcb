"""What every command promises its user: help without internals, one line for what goes wrong, the right exit code."""

import logging
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from click import Context
from click.testing import CliRunner

from footsense.cli import main
from footsense.config import SMALL_BOARD
from footsense.daemon.can_output import can_sink
from footsense.daemon.models import load_models
from footsense.errors import HardwareError
from footsense.recording.mcap_writer import McapFile
from footsense.recording.replay import Replay
from footsense.ring.records import LostCycles, NumberedCycle
from footsense.sim.clock import VirtualClock
from tests.support.cycles import write
from tests.support.other_file import opens_instead
from tests.system.command import TIMEOUT_S, footsense, one_line_error

GOLDEN = Path(__file__).parents[2] / "golden/measured_walk.mcap"
N_BEFORE, N_LOST = 30, 7
COMMANDS = main.list_commands(Context(main))


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a recording of two seconds."""
    path = tmp_path_factory.mktemp("walk") / "walk.mcap"
    result = footsense("run", "--duration", "2", "--fast", "--summary", "json", "--record", path)
    assert result.returncode == 0, result.stderr
    return path


@pytest.fixture
def gapped(walk: Path, tmp_path: Path) -> Path:
    """Return the same recording as a recorder leaves it that was held up for seven cycles."""
    replay = Replay(walk)
    path = tmp_path / "gapped.mcap"
    with path.open("wb") as file:
        recording = McapFile(file.fileno(), replay.header)
        for entry in replay.entries():
            assert isinstance(entry, NumberedCycle)
            if entry.cycle_number == N_BEFORE + N_LOST:
                recording.add_entry(LostCycles(entry.cycle_number, entry.cycle.forces.t_sent_ns, N_LOST))
            if not N_BEFORE <= entry.cycle_number < N_BEFORE + N_LOST:
                recording.add_entry(entry)
        recording.finish()
    return path


@pytest.mark.parametrize("command", [*COMMANDS, "lab build", "lab study"])
def test_help_is_for_its_user(command: str) -> None:
    """Neither the errors of a Python function nor marks for its tools stand in it."""
    result = CliRunner().invoke(main, [*command.split(), "--help"])
    assert result.exit_code == 0
    assert "Raises" not in result.output
    assert "\\f" not in result.output


@pytest.mark.parametrize(
    ("group", "names"),
    [
        ("", COMMANDS),
        ("dev", ["benchmark", "soak", "trace"]),
        (
            "lab",
            [
                "build",
                "couplings",
                "design",
                "fabricate",
                "report",
                "selection",
                "selfcal",
                "study",
                "walk",
            ],
        ),
        ("test-stand", ["record", "calibrate", "evaluate"]),
    ],
)
def test_the_help_is_one_screen_with_a_line_for_each_command(group: str, names: list[str]) -> None:
    """No sentence is cut or folded."""
    lines = CliRunner().invoke(main, [*group.split(), "--help"]).output.splitlines()
    assert len(lines) <= 30
    commands = lines[lines.index("Commands:") + 1 :]
    assert all(len(line) <= 80 and line.endswith(".") and not line.endswith("...") for line in commands)
    assert [line.split()[0] for line in commands] == names
    assert len(names) <= 19


@pytest.mark.parametrize(
    ("typed", "meant"),
    [("rum", "run"), ("calibrate", "test-stand calibrate"), ("benchmark", "dev benchmark")],
)
def test_what_is_no_command_is_answered_with_the_nearest(typed: str, meant: str) -> None:
    assert f"No such command {typed!r}. Did you mean {meant}?" in CliRunner().invoke(main, [typed]).output


@pytest.mark.parametrize("arguments", ["", "-v check-config", "check-config -v", "check-config --verbose"])
def test_the_log_is_asked_for_before_or_behind_a_command(arguments: str) -> None:
    """Without it only faults are logged."""
    root, file = logging.getLogger(), Path(__file__).parents[3] / "deploy/simulated.yaml"
    root.setLevel(logging.WARNING)
    result = CliRunner().invoke(main, [*(arguments or "check-config").split(), str(file)])
    level = root.level
    root.setLevel(logging.WARNING)
    assert result.exit_code == 0, result.output
    assert level == (logging.INFO if arguments else logging.WARNING)


@pytest.mark.parametrize("command", [*COMMANDS, "dev trace", "lab study"])
def test_every_command_takes_verbose(command: str) -> None:
    assert "-v, --verbose" in CliRunner().invoke(main, [*command.split(), "--help"]).output


def test_a_check_of_nothing_fails(tmp_path: Path) -> None:
    """A recording without a cycle is whole, and says nothing about forces."""
    path = write(tmp_path / "none.mcap", [], header=Replay(GOLDEN).header)
    result = CliRunner().invoke(main, ["replay", str(path), "--check"])
    assert result.exit_code == 74
    assert "has no cycle, nothing was compared" in result.output
    assert CliRunner().invoke(main, ["replay", str(path)]).exit_code == 0


@pytest.mark.parametrize("duration", ["nan", "0"])
def test_a_number_out_of_range_is_a_usage_error(tmp_path: Path, duration: str) -> None:
    """Exit 2 before anything is made."""
    result = CliRunner().invoke(main, ["run", "--duration", duration, "--record", str(tmp_path / "a.mcap")])
    assert result.exit_code == 2
    assert "Invalid value for '--duration'" in result.output
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("record", "can_log", "exit_code", "says"),
    [
        ("a.txt", "a.log", 78, "a.txt: the name has to end in .mcap"),
        ("a.mcap", "old.log", 74, "CAN log {folder}/old.log: exists and is not overwritten; choose another"),
        ("old.mcap", "a.log", 74, "old.mcap: exists and is not overwritten"),
    ],
)
def test_outputs_are_checked_before_anything_is_opened(
    tmp_path: Path, record: str, can_log: str, exit_code: int, says: str
) -> None:
    """Nothing is overwritten and nothing half-written is left."""
    for name in ("old.log", "old.mcap"):
        (tmp_path / name).write_text("precious")
    result = footsense(
        *("run", "--duration", "1", "--fast", "--record", tmp_path / record, "--can-log", tmp_path / can_log)
    )
    assert says.format(folder=tmp_path) in one_line_error(result, exit_code)
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {
        "old.log": "precious",
        "old.mcap": "precious",
    }


def test_a_lost_log_does_not_hide_what_came_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first error is the one that is told, whatever the end of the log adds to it."""
    log = tmp_path / "a.log"
    opens_instead(monkeypatch, log, Path("/dev/full"))
    with (
        pytest.raises(HardwareError, match="the bus is gone"),
        can_sink(load_models(SMALL_BOARD), VirtualClock(), log),
    ):
        raise HardwareError("the bus is gone")


@pytest.mark.parametrize(
    "arguments",
    [("--help",), ("run", "--help"), ("run", "--duration", "1", "--fast", "--summary", "json")],
    ids=" ".join,
)
def test_an_output_that_cannot_be_written_is_one_line(arguments: tuple[str, ...]) -> None:
    """Exit 1 and the system's reason where the disk is full; silence where the reader has gone."""
    read_end, write_end = os.pipe()
    os.close(read_end)
    reason = "footsense: the output: No space left on device\n"
    for output, said in ((os.open("/dev/full", os.O_WRONLY), reason), (write_end, "")):
        command = [sys.executable, "-m", "footsense", *arguments]
        result = subprocess.run(
            command, stdout=output, stderr=subprocess.PIPE, text=True, timeout=TIMEOUT_S, check=False
        )
        os.close(output)
        assert (result.returncode, result.stderr) == (1, said)


@pytest.mark.parametrize(
    ("arguments", "lacking"),
    [
        (("-m", "footsense"), "the command line needs click"),
        (("-c", "import footsense; footsense.simulate"), "footsense-client alone lacks"),
    ],
)
def test_without_its_environment_a_clone_says_what_to_activate(
    arguments: tuple[str, ...], lacking: str
) -> None:
    command = [sys.executable, "-S", *arguments]
    result = subprocess.run(
        command, capture_output=True, text=True, timeout=TIMEOUT_S, check=False, cwd=GOLDEN.parents[2]
    )
    last = result.stderr.splitlines()[-1]
    assert lacking in last
    assert last.endswith(
        "in the clone of footsense: activate its environment, or pip install deploy/client ."
    )


def test_ctrl_c_ends_a_command_without_a_traceback(tmp_path: Path) -> None:
    """Exit 130, as shells have it, and no half-written table."""
    signal.signal(
        signal.SIGINT, signal.default_int_handler
    )  # a child of tests in the background would ignore it
    table = tmp_path / "walk.csv"
    with subprocess.Popen(
        [sys.executable, "-m", "footsense", "export", str(GOLDEN), "--csv", str(table)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        while not table.exists() and process.poll() is None:
            os.sched_yield()
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=TIMEOUT_S)
    assert (process.returncode, output, errors) == (130, "", "")
    assert not table.exists()


def test_a_gap_is_replayed_and_not_compared_across(gapped: Path) -> None:
    """With --check the cycles before it are compared and the rest only replayed; both ways the loss is told."""
    checked = footsense("replay", gapped, "--check")
    line = one_line_error(checked, 74)
    assert line == (
        f"{gapped}: {N_LOST} cycles were lost when it was recorded, "
        f"only the {N_BEFORE} cycles before the first of them were compared"
    )
    assert checked.stdout == f"{N_BEFORE} cycles equal bit for bit\n"
    replayed = footsense("replay", gapped)
    assert one_line_error(replayed, 74) == f"{gapped}: {N_LOST} cycles were lost when it was recorded"
    n_cycles = len(list(Replay(gapped)))
    assert n_cycles > N_BEFORE + N_LOST
    assert replayed.stdout == f"{n_cycles} cycles replayed\n"


def test_the_lab_s_commands_are_listed_without_a_truncated_sentence() -> None:
    shown = CliRunner().invoke(main, ["lab", "--help"]).output
    assert not [line for line in shown.partition("Commands:")[2].splitlines() if line.endswith("...")]
    assert len(shown.splitlines()) <= 24
