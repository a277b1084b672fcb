"""The real time, and the scheduling that makes it reliable: the only file that calls `time`, and that asks for a place.

What a loop in Python needs of the kernel, and what each costs where it is missing (p99.9 of the wake-up, two busy
cores): SCHED_FIFO 6 ms instead of 0.1; locked memory 4 ms where its pages were pushed out; the collector of garbage
off, 45 ms where it meets a large heap. None of it is had without a right that a user lacks: what is not granted is
said, one line each.
"""

import ctypes
import gc
import os
import resource
import sys
import time
from array import array
from bisect import bisect_left
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = [
    "LATENESS_BOUNDS_S",
    "MonotonicClock",
    "Wakeups",
    "foremost",
    "process_age_ns",
    "request_realtime",
    "resident_mib",
    "stopwatch_ns",
    "undisturbed",
    "wall_time_iso",
]

#: Bounds of the histogram of lateness [s]: FIFO wakes within 0.2 ms, a busy machine without it within some 10 ms.
LATENESS_BOUNDS_S = (
    *(5e-6, 1e-5, 2e-5, 3e-5, 5e-5, 7e-5, 1e-4, 1.5e-4, 2e-4, 3e-4, 5e-4),
    *(1e-3, 2e-3, 5e-3, 1e-2, 5e-2),
)

# Linux, <sys/mman.h> and <linux/prctl.h>; the same on every processor that Python's wheels are built for.
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
_PR_SET_TIMERSLACK = 29
_CAP_IPC_LOCK = 14

#: How long a thread may keep the interpreter from another that wants it [s]; Python's own 5 ms are two conversions.
_SWITCH_INTERVAL_S = 1e-4


class Wakeups:
    """What became of the deadlines of one thread.

    Attributes:
        bounds_s: Bounds of the histogram [s].
        lateness: Wake-ups in each bucket, those above the last bound, and the sum of their lateness [s].
        overruns: Deadlines that had passed before they were waited for.
    """

    bounds_s = LATENESS_BOUNDS_S

    def __init__(self) -> None:
        self.lateness = array("d", [0.0]) * (len(LATENESS_BOUNDS_S) + 2)
        self.overruns = 0


class MonotonicClock:
    """The machine's monotonic clock.

    Attributes:
        wakeups: How late it woke its sleepers. It counts for one thread: each has a clock of its own.
    """

    def __init__(self) -> None:
        self.wakeups = Wakeups()

    def now_ns(self) -> int:
        """Return the time since an arbitrary start [ns]; steps of the wall clock do not touch it."""
        return time.monotonic_ns()

    def sleep_until_ns(self, t_ns: int) -> None:
        """Sleep until `t_ns`; returns late by the scheduler's latency, never early."""
        remaining_ns = t_ns - time.monotonic_ns()
        if remaining_ns <= 0:
            self.wakeups.overruns += 1
            return
        while remaining_ns > 0:
            time.sleep(remaining_ns * 1e-9)
            remaining_ns = t_ns - time.monotonic_ns()
        lateness, late_s = self.wakeups.lateness, remaining_ns * -1e-9
        lateness[bisect_left(LATENESS_BOUNDS_S, late_s)] += 1.0
        lateness[-1] += late_s


def request_realtime(priority: int, cpu: int | None) -> tuple[str, ...]:
    """Ask for SCHED_FIFO, one processor and memory that stays, for this thread and those that it starts from now on.

    Args:
        priority: Of SCHED_FIFO, 1 to 99.
        cpu: Number of the processor to stay on; None leaves it to the kernel.

    Returns:
        What was not granted and what would help, one line each; empty if all was.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    # Only counts where FIFO is not granted: 50 us less of lateness for a right that nobody is refused.
    libc.prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
    refusals = (_stay_on(cpu), _come_first(priority), _stay_in_memory(libc))
    return tuple(refusal for refusal in refusals if refusal is not None)


@contextmanager
def undisturbed() -> Iterator[None]:
    """Keep the interpreter out of the loop's way.

    Nothing is collected meanwhile, so the loop must not make cycles of references; a test counts them. Where several
    threads share the interpreter, one that wants it waits for less than a conversion.
    """
    interval_s, collecting = sys.getswitchinterval(), gc.isenabled()
    gc.collect()
    gc.freeze()
    gc.disable()
    sys.setswitchinterval(_SWITCH_INTERVAL_S)
    try:
        yield
    finally:
        sys.setswitchinterval(interval_s)
        gc.unfreeze()
        if collecting:
            gc.enable()


@contextmanager
def foremost(priority: int) -> Iterator[None]:
    """Come before all ordinary processes for a while, where that is granted: to measure where others are busy.

    Args:
        priority: Of SCHED_FIFO, 1 to 99.
    """
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    _come_first(priority)
    try:
        yield
    finally:
        os.sched_setscheduler(0, *before)


def _stay_on(cpu: int | None) -> str | None:
    try:
        if cpu is not None:
            os.sched_setaffinity(0, {cpu})
    except OSError:
        there = ", ".join(map(str, sorted(os.sched_getaffinity(0))))
        return f"processor {cpu} was not granted: this process may use {there}"
    return None


def _come_first(priority: int) -> str | None:
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        return f"SCHED_FIFO {priority} was not granted: raise LimitRTPRIO of the service, or `ulimit -r`"
    except OSError as error:
        return f"SCHED_FIFO {priority} was not granted: {error.strerror}"
    return None


def _stay_in_memory(libc: ctypes.CDLL) -> str | None:
    # Under a limit that is not reached yet the lock would be granted, and the next allocation would fail instead.
    limited = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] != resource.RLIM_INFINITY
    if limited and not int(_status("CapEff"), 16) >> _CAP_IPC_LOCK & 1:
        return "memory was not locked: LimitMEMLOCK of the service, or `ulimit -l`, has to be unlimited"
    # ONFAULT: a page stays from its first use on. Else every thread's stack would be there at once, all 8 MiB of it.
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT):
        return f"memory was not locked: {os.strerror(ctypes.get_errno())}"
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
    return int(_status("VmRSS").split()[0]) / 1024


def _status(key: str) -> str:
    """Return what the kernel says of this process under a key."""
    with open("/proc/self/status", encoding="ascii", errors="replace") as status:  # noqa: PTH123
        return next(line for line in status if line.startswith(f"{key}:")).partition(":")[2].strip()
