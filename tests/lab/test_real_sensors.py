"""The measured insole's figures, from its reduced table, and sensors whose gains and memory are known."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from footsense.errors import FootsenseError
from footsense.lab.measured.insole import (
    Session,
    fit_reading,
    memory_states,
    pressure_on_clock,
    read_sessions,
)
from footsense.lab.report import StudyContext
from footsense.lab.studies import real_sensors

pytestmark = pytest.mark.lab

DATA = Path(__file__).parent / "data"
MODELS = Path(__file__).parents[2] / "models" / "aoyagi-3x3"


@pytest.fixture(scope="module")
def figures() -> dict[str, Any]:
    context = StudyContext(MODELS, quick=True, data=DATA, report_progress=lambda _: None)
    return real_sensors.compute(context)


@pytest.mark.slow
def test_the_insole_is_what_was_measured(figures: dict[str, Any]) -> None:
    """Its loop is twice that of the assumed rubber, whose form explains two thirds of what a cubic does not."""
    loops, form = figures["loops"], figures["forms"]["calibration"]
    assert loops["the insole"]["largest"] == pytest.approx(0.053, abs=0.004)
    assert loops["`sim/rubber.py`"]["largest"] == pytest.approx(0.020, abs=0.002)
    assert form["memory"] < 0.4 * form["clock"] < 0.4 * form["static"]
    assert 0.1 < form["creep"] < 0.25
    deviations = [one["deviation"] for one in figures["gains"].values()]
    assert 0.008 < min(deviations) < max(deviations) < 0.035
    assert all(one["by_chance"] < 0.4 * one["deviation"] for one in figures["gains"].values())


def test_a_known_sensor_is_found_again() -> None:
    """Its memory and the pressure's clock."""
    pressure = np.clip(
        np.convolve(np.repeat([0.1, 0.4, 0.7, 1.0, 0.6, 0.3, 0.1], 40), np.ones(9) / 9, "same"), 0, 1
    )
    session = Session(0.66, pressure, pressure[:, None])
    clock = np.array([1.5, 0.0])
    at = pressure_on_clock(session, clock)
    memory = np.array([0.0, 0.0, 0.15, 0.16])
    reading = 40.0 * (at + memory_states(at, session.step_s) @ memory) ** 0.8
    found = fit_reading(session, reading)
    np.testing.assert_allclose(found.memory[-2:], memory[-2:], atol=0.03)
    np.testing.assert_allclose(found.clock[0], clock[0], atol=0.1)


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(FootsenseError, match="has no calibration_dataset"):
        read_sessions(tmp_path)
    with pytest.raises(FootsenseError, match="needs --data"):
        real_sensors.compute(StudyContext(MODELS))
