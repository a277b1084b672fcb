"""The machine's clock and what it is asked for.

What is asked of the kernel is asked in a process of its own: this one has to run on as it is.
"""

import contextlib
import gc
import subprocess
import sys

from footsense.clock import MonotonicClock
from footsense.daemon.scheduling import low_latency_interpreter
from footsense.ports import WAKEUP_LATENCY_BUCKET_BOUNDS_S

#: Limits as a user has them, whoever runs the test: neither rights nor what root may do without them.
WITHOUT_RIGHTS = """
import ctypes, resource
from footsense.daemon import scheduling
resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
resource.setrlimit(resource.RLIMIT_MEMLOCK, (1 << 16, 1 << 16))
no_capabilities = (ctypes.c_uint32 * 6)()
ctypes.CDLL(None).capset((ctypes.c_uint32 * 2)(0x20080522, 0), no_capabilities)
"""


def answer(script: str) -> list[str]:
    """Return the lines that a process of its own prints."""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def test_a_near_time_is_slept_for_and_a_past_one_is_an_overrun() -> None:
    """Neither returns early; a deadline that was slept for has a latency, one that had passed has none."""
    clock = MonotonicClock()
    start_ns = clock.now_ns()
    clock.sleep_until_ns(start_ns - 1_000_000_000)
    clock.sleep_until_ns(start_ns + 100_000)
    assert clock.now_ns() >= start_ns + 100_000
    assert len(clock.wakeups.histogram) == len(WAKEUP_LATENCY_BUCKET_BOUNDS_S) + 2
    assert sum(clock.wakeups.histogram[:-1]) == 1
    assert clock.wakeups.histogram[-1] > 0
    assert clock.wakeups.overruns == 1


def test_the_interpreter_is_as_before_when_the_loop_has_ended() -> None:
    """Also when it ended with an error; meanwhile nothing is collected and threads change often."""
    before = sys.getswitchinterval()
    with contextlib.suppress(KeyError), low_latency_interpreter():
        assert not gc.isenabled()
        assert sys.getswitchinterval() < before
        raise KeyError
    assert gc.isenabled()
    assert sys.getswitchinterval() == before
    assert gc.get_freeze_count() == 0


def test_what_is_not_granted_is_said_line_by_line() -> None:
    """Each refusal names what to raise; one does not hide the next."""
    lines = answer(WITHOUT_RIGHTS + "print(*scheduling.request_realtime(40), sep='\\n')")
    priority, memory = lines
    assert "SCHED_FIFO 40 was not granted: raise LimitRTPRIO" in priority
    assert "memory was not locked: LimitMEMLOCK" in memory


def test_a_service_that_requires_its_scheduling_refuses_to_start_without() -> None:
    """One line says what was not granted, and which key asks for it."""
    (line,) = answer(
        WITHOUT_RIGHTS
        + """
from footsense.config.sections import Realtime
from footsense.daemon.service import request_scheduling
from footsense.errors import ConfigError
try:
    request_scheduling(Realtime(required=True))
except ConfigError as error:
    print(error)
"""
    )
    assert line.startswith("realtime.required: SCHED_FIFO 40 was not granted")
