"""`footsense probe` as its user runs it."""

import json
from pathlib import Path

from footsense.config import load_config
from tests.system.command import footsense, robot

FAULTY = """
description: A robot with a wire off.
load: {kind: unloaded}
host_cost_us: 40
faults: [{at_s: 0, fault: broken_column, leg: rf, column: 2}]
"""


def test_its_readings_can_be_pasted_into_the_configuration(tmp_path: Path) -> None:
    """The lines at its end are YAML that the configuration takes; nothing is wrong, so that it ends with 0."""
    config = robot(tmp_path)
    result = footsense("probe", "--config", config)
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    snippet = result.stdout[result.stdout.index("unloaded_pf:") :]
    pasted = load_config(robot(tmp_path, more=snippet))
    assert set(pasted.unloaded_pf) == {"lf", "rf"}


def test_a_fault_is_told_and_ends_with_1(tmp_path: Path) -> None:
    """As JSON for a script, with the line that a person reads."""
    scene, config = tmp_path / "faulty.yaml", robot(tmp_path)
    scene.write_text(FAULTY)
    result = footsense("probe", "--config", config, "--scene", scene, "--json")
    assert result.returncode == 1
    figures = json.loads(result.stdout)
    assert figures["legs"]["rf"]["faults"] == [{"cause": "column_open", "elements": [2, 5, 8]}]
    assert figures["buses"][0]["host_cost_us"] == 40.0
    (diagnosis,) = figures["diagnoses"]
    assert (diagnosis["location"], diagnosis["observation"]) == ("rf", "the line of column 2 is interrupted")
