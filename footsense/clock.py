"""Real time and real-time scheduling; no other file calls `time` or the scheduler.

A Python loop needs three settings of the kernel and the interpreter. Latency without each (p99.9 of the wake-up, two
busy cores): SCHED_FIFO, 6 ms instead of 0.1 ms; locked memory, 4 ms where its pages were reclaimed; garbage collection
off, 45 ms where the heap is large. An ordinary user has none of the rights: what is refused is reported, one line each.
"""

import ctypes
import gc
import os
import resource
import sys
import time
from bisect import bisect_left
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated

from msgspec import Meta, Struct

from footsense.ports import WAKEUP_LATENCY_BUCKET_BOUNDS_S, WakeupLatency

# Linux, <sys/mman.h> and <linux/prctl.h>; the same on every processor that Python's wheels are built for.
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
_PR_SET_TIMERSLACK = 29
_CAP_IPC_LOCK = 14

#: Longest time that a thread keeps the interpreter from a waiting one [s]; Python's default of 5 ms is two conversions.
_SWITCH_INTERVAL_S = 1e-4


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


class Realtime(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Section `realtime` of a configuration: scheduling that the main loop requests from the kernel.

    Attributes:
        priority: SCHED_FIFO priority; below 50, that of the kernel's interrupt threads, for which the loop waits.
        required: Whether the service refuses to start if a request is denied; else its frames say degraded_timing.
    """

    priority: Annotated[int, Meta(ge=1, le=99)] = 40
    required: bool = False


def request_realtime(asked: Realtime) -> tuple[str, ...]:
    """Request SCHED_FIFO and locked memory for this thread and its future threads; return what failed.

    Args:
        asked: The scheduling.

    Returns:
        Each refused request and its remedy, one line each.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    # Without FIFO this saves 50 us of latency, and needs no right.
    libc.prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
    return tuple(filter(None, (_set_fifo(asked.priority), _lock_memory(libc))))


@contextmanager
def low_latency_interpreter() -> Iterator[None]:
    """Disable garbage collection and shorten the thread switch interval, within a `with` block.

    Reference cycles are not freed meanwhile, so the loop must not make any; a test counts them.
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
def fifo_priority(priority: int) -> Iterator[None]:
    """Run a `with` block with SCHED_FIFO, if permitted; for measurements on a busy machine.

    Args:
        priority: Priority of SCHED_FIFO, 1 to 99.
    """
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    _set_fifo(priority)
    try:
        yield
    finally:
        os.sched_setscheduler(0, *before)


def _set_fifo(priority: int) -> str | None:
    """Set SCHED_FIFO for this thread; return an error message if that is refused."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        return f"SCHED_FIFO {priority} was not granted: raise LimitRTPRIO of the service, or `ulimit -r`"
    except OSError as error:
        return f"SCHED_FIFO {priority} was not granted: {error.strerror}"
    return None


def _lock_memory(libc: ctypes.CDLL) -> str | None:
    """Lock this process's memory; return an error message if that is refused."""
    # Under a limit that is not reached yet the lock succeeds, and the next allocation fails instead.
    limited = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] != resource.RLIM_INFINITY
    if limited and not int(_process_status("CapEff"), 16) >> _CAP_IPC_LOCK & 1:
        return "memory was not locked: LimitMEMLOCK of the service, or `ulimit -l`, has to be unlimited"
    # ONFAULT locks a page at its first use; without it every thread's stack of 8 MiB is resident at once.
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT):
        return f"memory was not locked: {os.strerror(ctypes.get_errno())}"
    return None


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


def resident_mib() -> float:
    """Return the resident memory of this process [MiB]. Linux only."""
    return int(_process_status("VmRSS").split()[0]) / 1024


def _process_status(key: str) -> str:
    """Return the value of a key of /proc/self/status."""
    with open("/proc/self/status", encoding="ascii", errors="replace") as status:  # noqa: PTH123
        return next(line for line in status if line.startswith(f"{key}:")).partition(":")[2].strip()
