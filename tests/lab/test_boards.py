"""Figures of a board: what has no force is not left out of a row that looks good."""

from pathlib import Path

import numpy as np
import pytest

from footsense.frames import State
from footsense.lab.report import StudyContext
from footsense.lab.studies.boards.force_figures import force_figures
from footsense.lab.studies.boards.many_feet import missing_figures, step_figures

pytestmark = pytest.mark.lab

CONTEXT = StudyContext(Path(__file__).parents[2] / "models" / "aoyagi-3x3", quick=True)


def test_errors_count_of_loaded_feet_and_a_missing_force_is_said() -> None:
    true_n = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.01]])
    force_n = np.array([[0.0, 1.1, 1.1], [np.nan] * 3, [1.0, 0.0, 0.0]])
    state = np.array([State.VALID, State.OUT_OF_RANGE, State.VALID], np.uint8)
    found = force_figures(force_n, np.full((3, 3), 0.1), state, true_n)
    assert found["direction_deg"] == pytest.approx(45.0)
    assert found["magnitude_rel"] == pytest.approx(1.1 * np.sqrt(2.0) - 1.0)
    assert found["within_2_sigma"] == pytest.approx(2 / 3)
    assert found["no_force_share"] == pytest.approx(0.5)


def test_a_foot_does_without_an_element_a_row_or_a_column() -> None:
    """The rest of the foot gives a force at any time, worse by what is missing."""
    found = missing_figures(CONTEXT, "ad7147")
    assert all(one["no_force_share"] == 0.0 for one in found.values())
    assert 0.5 < found["element"]["direction_deg"] < found["row"]["direction_deg"] < 3.0


def test_a_step_has_settled_when_the_window_is_of_it() -> None:
    """The window holds three scans of 6.9 ms; the last reading of them is sent some 3 ms after its middle."""
    found = step_figures(CONTEXT, "ad7147")
    assert 15.0 < found["settled_p50_ms"] <= found["settled_worst_ms"] < 35.0
