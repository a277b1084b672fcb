"""What a replay takes from the header of a recording, and what it refuses."""

import json
from pathlib import Path

import pytest

from footsense.daemon.recording_header import recorded_config
from footsense.errors import RecordingError
from footsense.recording.replay import Replay
from tests.support.cycles import write


@pytest.mark.parametrize(("board", "commit"), [("ad7746", "27dcc809"), ("fdc1004_columns", "0e63fae9")])
def test_a_recording_of_a_board_that_is_gone_names_the_last_commit_that_reads_it(
    board: str, commit: str, tmp_path: Path
) -> None:
    header = {"legs": "lf", "config": json.dumps({"board": board, "scan": {"rate_sps": 91}})}
    recording = Replay(write(tmp_path / "walk.mcap", (), header=header))
    with pytest.raises(RecordingError) as refused:
        recorded_config(recording)
    assert str(refused.value) == (
        f"{recording.path}: the board {board} is gone; the last commit that knows it is {commit}"
    )
