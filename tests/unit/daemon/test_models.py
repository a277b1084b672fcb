"""The files of a robot's feet."""

import shutil
from pathlib import Path

import pytest
from msgspec.structs import replace

from footsense.config import SMALL_BOARD
from footsense.daemon.foot_types import released_path
from footsense.daemon.models import load_models


def test_a_response_table_that_is_missing_or_another_is_told_in_one_line(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Nothing is refined then; the robot starts all the same."""
    assert load_models(SMALL_BOARD).response is not None
    folder = tmp_path / SMALL_BOARD.foot_type
    folder.mkdir()
    shutil.copy(released_path("network.onnx"), folder)
    models = load_models(replace(SMALL_BOARD, foot_type=str(folder)))
    assert models.response is None
    shutil.copy(released_path("response.npz", "hexapod-2kg"), folder)
    assert load_models(models.config).response is None
    missing, other = (record.getMessage() for record in caplog.records)
    assert missing.startswith("loads at rest are not refined: cannot read")
    assert other.endswith("not the response table that the network was trained on")
