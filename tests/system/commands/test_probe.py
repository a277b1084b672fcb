"""`footsense probe` as its user runs it."""

import json
from pathlib import Path

from footsense.config import load_config
from tests.system.command import footsense, one_line_error, robot

FAULTY = """
description: A robot with a wire off.
load: {kind: unloaded}
host_cost_us: 40
faults: [{at_s: 0, fault: broken_column, leg: rf, column: 2}]
"""


def test_its_readings_can_be_pasted_into_the_configuration(tmp_path: Path) -> None:
    """The lines at its end, and what it writes, are YAML that the configuration takes; it ends with 0."""
    config, part = robot(tmp_path), tmp_path / "part.yaml"
    result = footsense("probe", "--config", config, "--write", part)
    assert result.returncode == 0, result.stderr
    assert result.stderr == f"wrote {part}\n"
    snippet = result.stdout[result.stdout.index("unloaded_pf:") :]
    pasted = load_config(robot(tmp_path, more=snippet))
    assert set(pasted.unloaded_pf) == {"lf", "rf"}
    part.write_text(part.read_text() + "can: {interface: virtual}\n")
    assert load_config(part).unloaded_pf == pasted.unloaded_pf
    again = one_line_error(footsense("probe", "--config", config, "--write", part), 78)
    assert again == f"{part}: exists and is not overwritten; name another file, or remove it"


def test_a_fault_is_told_and_ends_with_1(tmp_path: Path) -> None:
    """As JSON for a script, with the line that a person reads."""
    scene, config = tmp_path / "faulty.yaml", robot(tmp_path)
    scene.write_text(FAULTY)
    result = footsense("probe", "--config", config, "--scene", scene, "--json")
    assert result.returncode == 1
    figures = json.loads(result.stdout)
    faults = [{"cause": "element_open", "elements": [element]} for element in (2, 5, 8)]
    assert figures["legs"]["rf"]["faults"] == faults
    assert figures["buses"][0]["host_cost_us"] == 40.0
    told = [(each["location"], each["observation"]) for each in figures["diagnoses"]]
    assert told == [("rf", f"element {element} is open") for element in (2, 5, 8)]
