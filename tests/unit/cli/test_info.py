"""`footsense info`: what it tells of each kind of file, and of a recording's faults."""

import hashlib
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import footsense
from footsense.calibration.writer import write_calibration
from footsense.cli import main
from footsense.daemon.foot_types import released_path
from footsense.frames import Cause, State
from tests.support.calibrations import content
from tests.support.cycles import HEADER, plain_cycle, write

GOLDEN = Path(__file__).parents[2] / "golden/measured_walk.mcap"
MS = 1_000_000


def told(*arguments: str | Path, exit_code: int = 0) -> dict[str, str]:
    """Return the lines of `footsense info` by their first column: no value is folded where no terminal is."""
    result = CliRunner().invoke(main, ["info", *map(str, arguments)], env={"COLUMNS": "40"})
    assert result.exit_code == exit_code, result.output
    assert not [line for line in result.stdout.splitlines() if line != line.rstrip()]
    lines = (line.split("  ", 1) for line in result.stdout.splitlines())
    return {name: value.strip() for name, value in lines}


def test_without_a_file_it_tells_what_is_installed() -> None:
    found = told()
    assert found["footsense"] == footsense.__version__
    assert found["numpy"] == np.__version__
    assert {"platform", "python", "onnxruntime", "python-can"} <= found.keys()


def test_a_recording_has_its_identity_and_duration() -> None:
    found = told(GOLDEN)
    assert found["kind"] == "recording"
    assert found["sha256"] == hashlib.sha256(GOLDEN.read_bytes()).hexdigest()
    assert found["network sha256"] == told(released_path("network.onnx"))["sha256"]
    assert (found["duration [s]"], found["cycles"]) == ("3.947", "585")
    assert found["legs"] == "lf, lm, lr, rf, rm, rr"
    assert found["faults"] == "none"


def test_the_faults_of_a_recording_are_told_by_leg(tmp_path: Path) -> None:
    """With begin and duration, none behind the last cycle; one that is cut short is told as far as it is whole."""
    bad, good = (State.ABSENT, Cause.NO_ANSWER), (State.VALID, Cause.NONE)
    of_rf = [good, good, bad, bad, good, bad, good, bad]
    cycles = [
        plain_cycle(
            (1 + 100 * n) * MS,
            [State.VALID, state],
            cause=np.array([0, cause], np.uint8),
            flags=np.zeros(2, np.uint8),
        )
        for n, (state, cause) in enumerate(of_rf)
    ]
    path = write(tmp_path / "walk.mcap", cycles, every=1, header=HEADER | {"legs": "lf,rf"})
    assert told(path)["faults of rf"] == "absent (no answer) for 0.30 s, first at 0.20 s"
    assert "faults of lf" not in told(path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert "faults of rf" in told(path, exit_code=74)


@pytest.mark.parametrize("name", ["foot-0007", "foot-0007/manifest.json"])
def test_a_calibration_is_told_in_newtons(tmp_path: Path, name: str) -> None:
    write_calibration(tmp_path, **content())
    found = told(tmp_path / name)
    assert (found["kind"], found["foot"], found["loads"]) == ("calibration", "foot-0007", "362")
    assert found["calibrated"] == "direction 1.5 deg, p95 3.0 deg; magnitude 18 mN, p95 39 mN; of 180 loads"


def test_a_response_table_has_its_type() -> None:
    assert told(released_path("response.npz"))["foot type"] == "aoyagi-3x3"


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("deploy/footsense.yaml", "is a robot's file: footsense check-config "),
        ("deploy/test-stand.yaml", "is a test stand's file: footsense test-stand record --reference "),
        ("footsense/sim/scenes/tripod.yaml", "is a scene: footsense run --scene "),
        ("models/hexapod-2kg/foot.yaml", "is the design of a foot: footsense lab build --foot "),
    ],
)
def test_a_text_of_footsense_is_told_with_the_command_that_reads_it(name: str, says: str) -> None:
    """As are the frames of a candump log."""
    file = Path(__file__).parents[3] / name
    result = CliRunner().invoke(main, ["info", str(file)])
    assert (result.exit_code, result.output) == (1, f"footsense: {file}: {says}{file}\n")


def test_a_log_of_can_frames_and_a_missing_file_are_told(tmp_path: Path) -> None:
    """A missing file has the exit code of the other commands that read recordings."""
    log = tmp_path / "walk.log"
    log.write_text("(0.012345) can0 109#0011223344556677\n")
    result = CliRunner().invoke(main, ["info", str(log)])
    assert "is a log of CAN frames" in result.output
    log.unlink()
    assert CliRunner().invoke(main, ["info", str(log)]).exit_code == 74
