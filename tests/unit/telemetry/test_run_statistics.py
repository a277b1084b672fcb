"""The tally of a run: rate, age and errors against what was felt at the time of sending."""

import numpy as np
import pytest

from footsense.frames import BaselineDrift, CapFrame, ContactFrame, Cycle, State
from footsense.telemetry.run_statistics import RunStatistics

MS = 1_000_000


def cycle(sequence: int, force_n: list[float], state: State = State.VALID) -> Cycle:
    t_ns = 25 * MS * sequence
    scan = CapFrame(sequence, np.zeros((1, 9), np.int64), np.zeros((1, 9)), np.zeros((1, 9), np.uint8))
    forces = ContactFrame(
        sequence,
        t_ns + 14 * MS,
        np.array([t_ns]),
        np.array([force_n]),
        np.zeros((1, 3)),
        np.array([state], np.uint8),
        np.zeros(1, np.uint16),
        np.zeros(1, np.uint8),
        np.zeros(1, np.uint8),
        BaselineDrift.none(1),
    )
    return Cycle(scan, (), forces, ())


def test_errors_are_against_the_truth_at_the_time_of_sending() -> None:
    """A truth that moves by 1 N/s puts 14 ms of age into the error."""
    statistics = RunStatistics(("lf",), lambda t_ns: np.array([[0.0, 0.0, t_ns * 1e-9]]))
    for n in range(1, 101):
        statistics.observe(cycle(n, [0.0, 0.0, 25 * MS * n * 1e-9]))
    summary = statistics.summary()
    assert summary["force_rmse_n"] == {"x": 0.0, "y": 0.0, "z": pytest.approx(0.014)}
    assert summary["cycle_rate_hz"] == pytest.approx(40.0)
    assert summary["age_ms"] == {"p50": pytest.approx(14, abs=0.06), "p99": pytest.approx(14, abs=0.06)}


def test_the_direction_counts_only_where_the_foot_is_loaded() -> None:
    """45 degrees off in the loaded frames, whatever the unloaded ones say."""
    true_force_n = {True: [0.0, 0.0, 1.0], False: [0.0, 0.0, 0.01]}
    statistics = RunStatistics(("lf",), lambda t_ns: np.array([true_force_n[t_ns % (50 * MS) > 25 * MS]]))
    for n in range(10):
        statistics.observe(cycle(n, [1.0, 0.0, 1.0] if n % 2 else [1.0, 0.0, 0.0]))
    direction = statistics.summary()["direction_error_deg"]
    assert isinstance(direction, dict)
    assert direction["loaded_frames"] == 5
    assert direction["mean"] == pytest.approx(45.0)


def test_a_degraded_force_counts_as_a_value_and_as_a_fault() -> None:
    """Its error is in the mean, and nobody asked for its state."""
    statistics = RunStatistics(("lf",), lambda t_ns: np.array([[0.0, 0.0, 1.0]]))
    statistics.observe(cycle(0, [0.0, 0.0, 1.5], State.DEGRADED))
    summary = statistics.summary()
    assert summary["force_rmse_n"] == {"x": 0.0, "y": 0.0, "z": pytest.approx(0.5)}
    assert (summary["states"], summary["faults"]) == ({"lf": {"degraded": 1}}, 1)


def test_a_frame_without_a_value_counts_as_a_state_and_not_as_an_error() -> None:
    """NaN never enters a mean; a run without any value has None for figures, not zero."""
    statistics = RunStatistics(("lf",), lambda t_ns: np.zeros((1, 3)))
    statistics.observe(cycle(0, [np.nan] * 3, State.SATURATED))
    summary = statistics.summary()
    assert summary["states"] == {"lf": {"saturated": 1}}
    assert summary["faults"] == 1
    assert summary["force_rmse_n"] == {"x": None, "y": None, "z": None}
    assert summary["age_ms"] == {"p50": None, "p99": None}
