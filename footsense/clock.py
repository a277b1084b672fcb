"""Real time; no other file calls `time`."""

import time
from bisect import bisect_left

from footsense.ports import WAKEUP_LATENCY_BUCKET_BOUNDS_S, WakeupLatency


class MonotonicClock:
    """The operating system's monotonic clock.

    Attributes:
        wakeups: Wake-up latency of its thread: each thread has a clock of its own.
    """

    def __init__(self) -> None:
        self.wakeups = WakeupLatency()

    def now_ns(self) -> int:
        """Return the monotonic time since an arbitrary start [ns], unaffected by wall-clock steps."""
        return time.monotonic_ns()

    def sleep_until_ns(self, t_ns: int) -> None:
        """Sleep until `t_ns` [ns]; returns late by the scheduler's latency, never early."""
        remaining_ns = t_ns - time.monotonic_ns()
        if remaining_ns <= 0:
            self.wakeups.overruns += 1
            return
        while remaining_ns > 0:
            time.sleep(remaining_ns * 1e-9)
            remaining_ns = t_ns - time.monotonic_ns()
        histogram, latency_s = self.wakeups.histogram, remaining_ns * -1e-9
        histogram[bisect_left(WAKEUP_LATENCY_BUCKET_BOUNDS_S, latency_s)] += 1.0
        histogram[-1] += latency_s


def stopwatch_ns() -> int:
    """Return a monotonic time for measuring durations [ns]."""
    return time.perf_counter_ns()


def wall_time_iso() -> str:
    """Return the UTC date and time in ISO format."""
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())


def wall_time_ns() -> int:
    """Return the wall-clock time since 1970 [ns]; it jumps when the clock is set."""
    return time.time_ns()


def process_age_ns() -> int:
    """Return the time since this process was started, interpreter start included [ns]. Linux only."""
    with open("/proc/self/stat", encoding="ascii") as stat:  # noqa: PTH123 - no path arithmetic here
        started_ticks = int(stat.read().rpartition(")")[2].split()[19])
    ticks_per_s = 100  # USER_HZ, part of the kernel's interface
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME) - started_ticks * (1_000_000_000 // ticks_per_s)
