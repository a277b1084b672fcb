"""The tally of a run: rate, age and errors against what was felt at the time of sending."""

import numpy as np
import pytest

from footsense.frames import Cycle, State
from footsense.telemetry.run_statistics import RunStatistics
from tests.support.cycles import plain_cycle

MS = 1_000_000


def cycle(sequence: int, force_n: list[float], state: State = State.VALID) -> Cycle:
    """Return a cycle of one leg, sent 14 ms after its reading."""
    t_ns = 25 * MS * sequence
    return plain_cycle(t_ns + 14 * MS, [state], t_ns=np.array([t_ns]), force_n=np.array([force_n]))


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


@pytest.mark.parametrize(
    ("state", "force_n", "rmse_n", "age_ms"),
    [
        (State.DEGRADED, [0.0, 0.0, 1.5], [0.0, 0.0, 0.5], 14.0),
        (State.SATURATED, [np.nan] * 3, [None] * 3, None),
    ],
)
def test_a_fault_with_a_force_counts_as_an_error_too(
    state: State, force_n: list[float], rmse_n: list[float | None], age_ms: float | None
) -> None:
    """NaN never enters a mean; a run without any value has None for figures, not zero."""
    statistics = RunStatistics(("lf",), lambda t_ns: np.array([[0.0, 0.0, 1.0]]))
    statistics.observe(cycle(0, force_n, state))
    summary = statistics.summary()
    assert (summary["states"], summary["faulty_leg_cycles"]) == ({"lf": {state.name.lower(): 1}}, 1)
    assert summary["force_rmse_n"] == dict(zip("xyz", rmse_n, strict=True))
    p50_ms = summary["age_ms"]["p50"]  # type: ignore[index]
    assert p50_ms == (age_ms and pytest.approx(age_ms, abs=0.06))
