"""The real time, and the scheduling that makes it reliable: the only file that calls `time`."""

import os
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


def request_realtime(priority: int, cpu: int | None) -> str | None:
    """Ask for SCHED_FIFO and one processor for this thread and those that it starts from now on.

    Args:
        priority: Of SCHED_FIFO, 1 to 99.
        cpu: Number of the processor to stay on; None leaves it to the kernel.

    Returns:
        None if all was granted, else why not, in one line.
    """
    try:
        if cpu is not None:
            os.sched_setaffinity(0, {cpu})
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        return f"SCHED_FIFO {priority} was not granted: raise LimitRTPRIO of the service, or `ulimit -r`"
    except OSError as error:
        return f"processor {cpu} was not granted: {error.strerror}"
    return None


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
