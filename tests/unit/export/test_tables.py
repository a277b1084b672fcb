"""A recording's tables hold its values, and nothing where nothing is known."""

import csv
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from footsense.cli import main
from footsense.export.tables import COLUMN_NAMES
from footsense.frames import USABLE, Cycle, GaitEventKind, State
from footsense.recording.replay import Replay

GOLDEN = Path(__file__).parents[2] / "golden" / "measured_walk.mcap"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the golden walk as a table."""
    folder = tmp_path_factory.mktemp("export")
    options = ["--csv", str(folder / "walk.csv")]
    result = CliRunner().invoke(main, ["export", str(GOLDEN), *options], catch_exceptions=False)
    assert "585 cycles" in result.output
    return folder


@pytest.fixture(scope="module")
def cycles() -> list[Cycle]:
    return list(Replay(GOLDEN))


def test_csv_has_every_value(folder: Path, cycles: list[Cycle]) -> None:
    """Floats come back bit for bit; an empty cell is a value that is not known."""
    with (folder / "walk.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMN_NAMES
    for at, leg in ((0, "lf"), (4, "rm")):
        of_leg = rows[at::6]
        assert {row["leg"] for row in of_leg} == {leg}
        force_n = [[float(row[key] or "nan") for key in ("fx_n", "fy_n", "fz_n")] for row in of_leg]
        assert np.array_equal(force_n, [cycle.forces.force_n[at] for cycle in cycles], equal_nan=True)
        assert [row["state"] for row in of_leg] == [State(cycle.forces.state[at]).name for cycle in cycles]
        pf = [float(row["capacitance_pf_8"]) for row in of_leg]
        assert pf == [cycle.scan.capacitance_pf[at, 8] for cycle in cycles]
        told = [row["contact"] for row, cycle in zip(of_leg, cycles, strict=True) if cycle.forces.gait]
        meant = [
            str(int(cycle.forces.gait.contact[at])) if cycle.forces.state[at] in USABLE else ""
            for cycle in cycles
            if cycle.forces.gait
        ]
        assert told == meant
    assert "" in {row["fz_n"] for row in rows}
    events = " ".join(row["event"] for row in rows).split()
    gaits = [cycle.forces.gait for cycle in cycles if cycle.forces.gait]
    assert sorted(events) == sorted(GaitEventKind(e.kind).name for gait in gaits for e in gait.events)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["export", str(GOLDEN)], "say what to write"),
        (["export", str(GOLDEN), "--csv", str(GOLDEN)], "is not overwritten"),
        (["export", str(GOLDEN), "--csv", "/nowhere/walk.csv"], "there is no directory /nowhere"),
        (["export", "missing.mcap", "--csv", "walk.csv"], "missing.mcap"),
    ],
)
def test_a_wrong_call_is_one_line(
    arguments: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code
    assert message in result.output
    assert not list(tmp_path.iterdir())


def test_a_package_that_is_missing_is_named_before_anything_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else the other forms would be there already, and the command could not be repeated."""
    monkeypatch.setitem(sys.modules, "rosbags", None)
    words = ["export", str(GOLDEN), "--csv", str(tmp_path / "walk.csv"), "--ros2", str(tmp_path / "bag")]
    result = CliRunner().invoke(main, words)
    assert "--ros2 needs " in f"{result.output}{result.exception}"
    assert list(tmp_path.iterdir()) == []
