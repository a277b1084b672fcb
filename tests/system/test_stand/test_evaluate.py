"""`footsense test-stand evaluate` on a simulated stand: before and after, what it draws, and what it refuses."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from footsense.cli.test_stand.calibration import evaluate
from footsense.errors import CalibrationError, ConfigError, FootsenseError, ModelError, RecordingError
from footsense.foot.calibration_files import Manifest
from tests.support.calibrations import calibration
from tests.system.simulated_test_stand import record, true_parameters

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def stand(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a session of foot-0007, and the calibration that a perfect calibration makes of it."""
    folder = tmp_path_factory.mktemp("stand")
    record(folder / "session.mcap", n=22)
    calibration(folder / "feet", parameters=true_parameters())
    return folder


def invoke(*arguments: str | Path) -> Result:
    return CliRunner().invoke(evaluate, [str(argument) for argument in arguments])


def refusal(*arguments: str | Path, kind: type[FootsenseError] = CalibrationError) -> str:
    """Return the one line by which a command refuses."""
    error = invoke(*arguments).exception
    assert isinstance(error, kind), error
    assert "\n" not in str(error)
    return str(error)


def test_before_and_after(stand: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The calibration is found in the default folder; it takes most of the errors off a badly made foot."""
    monkeypatch.chdir(stand)
    found: dict[str, Any] = json.loads(invoke("session.mcap", "--foot", "foot-0007", "--json").stdout)
    before, after = found["bands"]["all"].values()
    assert (found["n_loads"], found["n_compared"], after["loads"]) == (22, 22, 22)
    assert before["direction_deg"] > 5.0
    assert before["magnitude_mn"] > 100.0
    assert after["direction_deg"] < 1.5
    assert after["magnitude_mn"] < 12.0
    assert (
        sum(band["with calibration"]["loads"] for name, band in found["bands"].items() if name != "all") == 22
    )
    text = invoke("session.mcap", "--foot", "foot-0007").stdout
    assert "made 2026-03-01T12:00:00Z" in text
    assert "with calibration     22" in text


@pytest.mark.lab
def test_the_map(stand: Path, tmp_path: Path) -> None:
    """A picture of the errors; without a calibration, the network alone, and that is said."""
    calibrated = invoke(
        stand / "session.mcap",
        "--foot",
        "foot-0007",
        "--calibration",
        stand / "feet" / "foot-0007",
        "--map",
        tmp_path / "errors.png",
    )
    assert calibrated.exit_code == 0, calibrated.exception
    assert (tmp_path / "errors.png").read_bytes().startswith(b"\x89PNG")
    alone = invoke(stand / "session.mcap", "--foot", "foot-0007")
    assert "no calibration at feet/foot-0007: the network of the design alone" in alone.stderr
    assert "with calibration" not in alone.stdout


def test_an_evaluation_on_fitted_recordings_is_marked(stand: Path, tmp_path: Path) -> None:
    """Not without saying so; the hashes of the recordings tell, whatever they are called."""
    from footsense.calibration.writer import file_sha256

    shutil.copy(stand / "session.mcap", tmp_path / "renamed.mcap")
    made_of_it = calibration(tmp_path, recordings={"session.mcap": file_sha256(stand / "session.mcap")})
    assert isinstance(made_of_it.manifest, Manifest)
    result = invoke(tmp_path / "renamed.mcap", "--foot", "foot-0007", "--calibration", tmp_path / "foot-0007")
    assert "renamed.mcap: its errors there are smaller than on other loads" in result.stderr


def test_what_cannot_be_evaluated(stand: Path, tmp_path: Path) -> None:
    """One line each, with what would be right."""
    session = stand / "session.mcap"
    assert "a recording of foot-0007, not of foot-0008" in refusal(session, "--foot", "foot-0008")
    assert "the same recording as" in refusal(session, session, "--foot", "foot-0007")
    assert "there is no network.onnx in it; --foot-type names" in refusal(
        session, "--foot", "foot-0007", "--foot-type", tmp_path, kind=ConfigError
    )
    assert "no such calibration" in refusal(
        session, "--foot", "foot-0007", "--calibration", tmp_path / "feet", kind=ModelError
    )
    record(tmp_path / "walk.mcap", n=1, reference=False)
    assert "holds no sample of a reference sensor" in refusal(tmp_path / "walk.mcap", "--foot", "foot-0007")
    record(tmp_path / "short.mcap", n=2)
    assert refusal(tmp_path / "short.mcap", "--foot", "foot-0007").startswith(
        "2 accepted loads in 1 recordings; at"
    )
    (tmp_path / "none.mcap").write_text("no recording")
    refusal(tmp_path / "none.mcap", "--foot", "foot-0007", kind=RecordingError)
