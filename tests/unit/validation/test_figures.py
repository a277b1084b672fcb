"""Figures of walks with a fault or a disturbance, against walks of which they are known."""

from typing import Any

import numpy as np
import pytest

from footsense.frames import Cause, State, Vector
from footsense.validation import disturbance_table
from footsense.validation.fault_trial import FAULTY_LEG, PublishedWalk, fault_figures

OTHER_LEG = "lf"
#: Frames of a walk, each tenth of a second [s].
T_S: Vector = np.round(0.1 * np.arange(1, 27), 1)


def walk(t_s: Vector = T_S, **by_leg: Any) -> PublishedWalk:
    """Return a walk of two legs whose forces are right and valid; `by_leg` replaces a field, shape (frames, 2)."""
    shape = len(t_s), 2
    t_ns = np.rint(1e9 * t_s).astype(np.int64)
    values: dict[str, Any] = {
        "t_ns": np.tile(t_ns[:, None], 2),
        "state": np.full(shape, State.VALID, np.uint8),
        "cause": np.full(shape, Cause.NONE, np.uint8),
        "flags": np.zeros(shape, np.uint8),
        "fault_mask": np.zeros(shape, np.uint16),
        "force_n": np.zeros((*shape, 3)),
        "sigma_n": np.full((*shape, 3), 0.1),
        "true_force_n": np.zeros((*shape, 3)),
        **by_leg,
    }
    return PublishedWalk(legs=(FAULTY_LEG, OTHER_LEG), t_sent_ns=t_ns, events=[], **values)


def test_a_fault_is_detected_and_over_with_the_first_frames_that_say_so() -> None:
    """A leg that is absent from a tenth of a second after the fault on, and valid again 0.3 s after its end."""
    state, cause, force_n = walk().state, walk().cause, walk().force_n
    absent = (T_S > 0.75) & (T_S < 1.45)
    state[absent, 0], cause[absent, 0] = State.ABSENT, Cause.NO_ANSWER
    force_n[absent, 0] = np.nan
    state[(T_S > 1.45) & (T_S < 1.65), 0] = State.DEGRADED
    force_n[T_S > 1.45, 0, 2] = 0.25
    found = fault_figures(walk(state=state, cause=cause, force_n=force_n), walk(), 0.7, 1.2)
    assert (found.state, found.cause) == (State.ABSENT, Cause.NO_ANSWER)
    assert found.detection_s == pytest.approx(0.1)
    assert found.recovery_s == pytest.approx(0.5)
    assert found.max_error_sigmas == pytest.approx(2.5)
    assert found.longest_gap_s == pytest.approx(0.1)
    assert found.other_legs_max_error_n == 0.0
    assert fault_figures(walk(), walk(), 0.7, 1.2).detection_s is None


def test_a_leg_that_is_silent_to_the_end_has_its_gap() -> None:
    state = walk().state
    state[T_S > 2.15, 1] = State.STALE
    found = fault_figures(walk(state=state), walk(), 0.7, None)
    assert found.longest_gap_s == pytest.approx(0.5)
    assert found.recovery_s is None


def test_a_disturbance_has_the_figures_of_its_own_time() -> None:
    """Whatever was wrong before it; forces that may not be used are none."""
    t_s = np.round(0.1 * np.arange(1, 61), 1)
    disturbed = t_s > disturbance_table.BEGINS_S + 0.05
    force_n, state = walk(t_s).force_n, walk(t_s).state
    force_n[~disturbed] = 5.0
    force_n[disturbed, :, 0] = 0.1
    force_n[disturbed, :, 2] = 0.3
    state[disturbed, 1] = State.OUT_OF_RANGE
    found = disturbance_table.figures(walk(t_s, force_n=force_n, state=state))
    assert found.error_n == pytest.approx(np.hypot(0.1, 0.3))
    assert found.within == pytest.approx(2 / 3)
    assert found.usable == pytest.approx(0.5)
