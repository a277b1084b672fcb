"""Files larger than memory where a small one is expected: refused in one line, after a bounded part of them."""

import fcntl
from collections.abc import Callable
from pathlib import Path

import pytest

from footsense.calibration.writer import write_calibration
from footsense.config import load_config
from footsense.config.test_stand import load_test_stand
from footsense.daemon.foot_types import DEFAULT_FOOT_TYPE
from footsense.estimation.network import Network
from footsense.foot.calibration_files import HASHED_FILES, MANIFEST, read_calibration
from footsense.foot.response_table import FootResponse
from footsense.recording.replay import Replay
from footsense.ring.cycle_reader import CycleReader
from footsense.sim.scene import load_scene
from tests.fuzz.outcome import refusal
from tests.support.calibrations import content

#: More than any computer has as memory, and no room on the disk: a file of zeros that were never written.
_BYTES = 1 << 42

READERS: dict[str, Callable[[Path], object]] = {
    "configuration": load_config,
    "scene": lambda path: load_scene(str(path)),
    "test stand": load_test_stand,
    "network": lambda path: Network(path, 1),
    "response": FootResponse.load,
    "recording": Replay,
    "ring": CycleReader,
}


@pytest.mark.parametrize("kind", READERS)
def test_a_file_without_end(tmp_path: Path, kind: str) -> None:
    """Any file that a command line or a configuration names."""
    path = tmp_path / "file.yaml"
    path.touch()
    with path.open("r+b") as file:
        file.truncate(_BYTES)
        fcntl.flock(file, fcntl.LOCK_EX)  # as a ring is by a running service
        assert refusal(lambda: READERS[kind](path))


@pytest.mark.parametrize("name", [MANIFEST, *HASHED_FILES])
def test_a_calibration_without_end(tmp_path: Path, name: str) -> None:
    """Each file of a calibration."""
    folder = write_calibration(tmp_path, **content()).folder
    with (folder / name).open("r+b") as file:
        file.truncate(_BYTES)
    assert refusal(lambda: read_calibration(folder, DEFAULT_FOOT_TYPE))
