"""The machine's clock and what it is asked for."""

import os
import resource

import pytest

from footsense.clock import MonotonicClock, process_age_ns, request_realtime, resident_mib


def test_a_time_that_has_passed_is_not_waited_for() -> None:
    """Neither does a near one return early."""
    clock = MonotonicClock()
    start_ns = clock.now_ns()
    clock.sleep_until_ns(start_ns - 1_000_000_000)
    clock.sleep_until_ns(start_ns + 100_000)
    assert clock.now_ns() >= start_ns + 100_000


def test_the_process_knows_its_age_and_size() -> None:
    """Both are positive and not absurd."""
    assert 0 < process_age_ns() < 24 * 3600 * 10**9
    assert 5 < resident_mib() < 10_000


def test_a_processor_that_does_not_exist_is_refused_in_words() -> None:
    """The reason is one line; nothing is changed."""
    before = os.sched_getaffinity(0)
    refusal = request_realtime(40, 1023)
    assert refusal is not None
    assert "processor 1023 was not granted" in refusal
    assert os.sched_getaffinity(0) == before


@pytest.mark.skipif(os.geteuid() == 0, reason="root is refused nothing")
def test_a_priority_without_the_right_is_refused_in_words() -> None:
    """What to raise is part of the reason."""
    soft, hard = resource.getrlimit(resource.RLIMIT_RTPRIO)
    resource.setrlimit(resource.RLIMIT_RTPRIO, (0, hard))
    try:
        assert "LimitRTPRIO" in str(request_realtime(40, None))
    finally:
        resource.setrlimit(resource.RLIMIT_RTPRIO, (soft, hard))
