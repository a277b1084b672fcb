"""Real-time scheduling of the loop, and the memory of the process; no other file calls the scheduler.

A Python loop needs three settings of the kernel and the interpreter. Latency without each (p99.9 of the wake-up, two
busy cores): SCHED_FIFO, 6 ms instead of 0.1 ms; locked memory, 4 ms where its pages were reclaimed; garbage collection
off, 45 ms where the heap is large. An ordinary user has none of the rights: what is refused is reported, one line each.
"""

import ctypes
import gc
import os
import resource
import sys
from collections.abc import Iterator
from contextlib import contextmanager

# Linux, <sys/mman.h> and <linux/prctl.h>; the same on every processor that Python's wheels are built for.
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
_PR_SET_TIMERSLACK = 29
_CAP_IPC_LOCK = 14

#: Longest time that a thread keeps the interpreter from a waiting one [s]; Python's default of 5 ms is two conversions.
_SWITCH_INTERVAL_S = 1e-4


def request_realtime(priority: int) -> tuple[str, ...]:
    """Request SCHED_FIFO and locked memory for this thread and its future threads; return what failed.

    Args:
        priority: Priority of SCHED_FIFO, 1 to 99.

    Returns:
        Each refused request and its remedy, one line each.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    # Without FIFO this saves 50 us of latency, and needs no right.
    libc.prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
    return tuple(filter(None, (_set_fifo(priority), _lock_memory(libc))))


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


def resident_mib() -> float:
    """Return the resident memory of this process [MiB]. Linux only."""
    return int(_process_status("VmRSS").split()[0]) / 1024


def _process_status(key: str) -> str:
    """Return the value of a key of /proc/self/status."""
    with open("/proc/self/status", encoding="ascii", errors="replace") as status:  # noqa: PTH123
        return next(line for line in status if line.startswith(f"{key}:")).partition(":")[2].strip()
