"""The virtual experiment, from the press to the table: one foot, a seventh of the presses."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from footsense.cli import main

pytestmark = [pytest.mark.lab, pytest.mark.slow]


def test_a_badly_made_foot_is_calibrated_through_bytes_and_files(tmp_path: Path) -> None:
    """All ways are judged by the same loads of another session; a calibrated foot beats what knows its design alone."""
    command = ["lab", "experiment", "--quick", "--feet", "1", "--json", "--output", str(tmp_path)]
    done = CliRunner().invoke(main, command, catch_exceptions=False)
    assert done.exit_code == 0
    values = json.loads(done.stdout)
    figures = values["errors_by_estimator"]
    ways = {"design_only", "calibrated_362", "calibrated_20", "linear_per_foot", "network_per_foot"}
    assert ways <= figures.keys()
    for what in ("direction_vs_reference_deg", "magnitude_vs_reference_gf"):
        assert figures["calibrated_362"][what]["mean"] < 0.5 * figures["design_only"][what]["mean"]
        assert figures["calibrated_362"][what]["mean"] < figures["linear_per_foot"][what]["mean"]
    assert values["refusals_by_foot"] == {}
    assert (tmp_path / "experiment.md").read_text(encoding="utf-8").startswith("## The experiment")
    assert (tmp_path / "experiment.png").stat().st_size > 10_000
