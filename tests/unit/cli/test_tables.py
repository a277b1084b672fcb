"""One list of columns is JSON and table: the same names, and what is not known in both."""

import json
import math
from typing import NamedTuple

import pytest
from rich.console import Console

from firmware_interface.can.codes import State
from footsense.cli.tables import Column, echo_json, figures_table, json_row, state_column, table


class Leg(NamedTuple):
    state: State | None
    force_n: tuple[float, float]
    drift_ff: float


COLUMNS: list[Column[Leg]] = [
    state_column(lambda leg: leg.state),
    Column("force_n", lambda leg: leg.force_n, ">+z7.2f", ("fx [N]", "fz [N]")),
    Column("baseline.drift_ff", lambda leg: leg.drift_ff, ">5.1f"),
    Column("hidden", len),
]
KNOWN = Leg(State.NO_BASELINE, (-0.0004, 1.23456789), 0.25)
UNKNOWN = Leg(None, (math.nan, math.nan), math.nan)


def lines(shown: object) -> list[str]:
    """Return what a terminal of 60 columns shows."""
    console = Console(width=60, force_terminal=True, color_system=None)
    with console.capture() as capture:
        console.print(shown)
    return [line.rstrip() for line in capture.get().splitlines()]


def test_names_and_values_are_the_same_in_json_and_table(capsys: pytest.CaptureFixture[str]) -> None:
    """Units are in the headings, codes are words; NaN is null and a dash, and a group of nothing is null."""
    echo_json([json_row(COLUMNS, leg) for leg in (KNOWN, UNKNOWN)])
    assert json.loads(capsys.readouterr().out) == [
        {"state": "no_baseline", "force_n": [-0.0004, 1.23457], "baseline": {"drift_ff": 0.25}, "hidden": 3},
        {"state": None, "force_n": [None, None], "baseline": None, "hidden": 3},
    ]
    assert [line.split() for line in lines(table(COLUMNS, (KNOWN, UNKNOWN)))] == [
        ["state", "fx", "[N]", "fz", "[N]", "drift", "[fF]"],
        ["no", "baseline", "+0.00", "+1.23", "0.2"],
        ["-", "-", "-", "-"],
    ]


def test_figures_stand_after_their_names() -> None:
    """Groups in one line, groups of groups in several; what is unknown or empty is left out, brackets are shown."""
    figures = {
        "n_cycles": 7,
        "age_ms": {"p50": 3.14159, "p99": math.nan},
        "states": {"lf": {"stale": 2}, "rf": {}},
        "where": "legs[0]",
        "corrected": True,
        "lost": None,
    }
    assert lines(figures_table(figures)) == [
        "cycles      7",
        "age [ms]    p50 3.142",
        "states, lf  stale 2",
        "where       legs[0]",
        "corrected   yes",
    ]
