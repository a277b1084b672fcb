"""The real time: the only file that calls `time`."""

import time


class MonotonicClock:
    """The machine's monotonic clock."""

    def now_ns(self) -> int:
        """Return the time since an arbitrary start [ns]; steps of the wall clock do not touch it."""
        return time.monotonic_ns()

    def sleep_until_ns(self, t_ns: int) -> None:
        """Sleep until `t_ns`; returns late by the scheduler's latency, never early."""
        while (remaining_ns := t_ns - time.monotonic_ns()) > 0:
            time.sleep(remaining_ns * 1e-9)


def stopwatch_ns() -> int:
    """Return a time for measuring durations in benchmarks [ns]."""
    return time.perf_counter_ns()


def wall_time_iso() -> str:
    """Return the date and time in UTC, for the header of a recording."""
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())


def process_age_ns() -> int:
    """Return how long ago this process was started, interpreter start included [ns]. Linux only."""
    with open("/proc/self/stat", encoding="ascii") as stat:  # noqa: PTH123 - no path arithmetic here
        started_ticks = int(stat.read().rpartition(")")[2].split()[19])
    ticks_per_s = 100  # USER_HZ, part of the kernel's interface
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME) - started_ticks * (1_000_000_000 // ticks_per_s)


def resident_mib() -> float:
    """Return the memory of this process that is in RAM [MiB]. Linux only."""
    with open("/proc/self/status", encoding="ascii") as status:  # noqa: PTH123
        kib = next(int(line.split()[1]) for line in status if line.startswith("VmRSS"))
    return kib / 1024
