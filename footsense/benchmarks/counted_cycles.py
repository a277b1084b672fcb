"""Cycles of the service on a recorded walk, with a mark at each boundary of its parts: the process that is counted.

    python -m footsense.benchmarks.counted_cycles WALK MARKS [--perf]

At a mark the process reads the counter of the kernel, or calls `getppid`, at which valgrind writes its counts. Marks
are on calls of few functions, so that no part is changed in order to be counted. The walk is of one thread, with forces
on CAN as often as the robot sends them.
"""

import logging
import os
import subprocess
import sys
from collections import deque
from collections.abc import Callable
from functools import wraps
from pathlib import Path

import msgspec

from footsense.acquisition.robot_scanner import RobotScanner
from footsense.benchmarks.cycle import open_service_cycle
from footsense.benchmarks.perf_event import open_instruction_counter
from footsense.benchmarks.recorded_walk import ROBOT, RecordedWalk, replay_walk
from footsense.can.sink import CanSink
from footsense.daemon.scheduling import low_latency_interpreter
from footsense.errors import FootsenseError
from footsense.estimation.network import Network
from footsense.estimation.pipeline import Pipeline
from footsense.estimation.walking.contact import ContactDetector
from footsense.estimation.walking.gait import GaitTracker
from footsense.ring.cycle_ring import CycleRing

#: Functions whose calls are a part of a cycle, less the parts that they call; the rest of a cycle is the loop.
_PARTS: tuple[tuple[type, str, str], ...] = (
    (RobotScanner, "read", "acquisition"),
    (Pipeline, "process", "estimation"),
    (Network, "estimate", "network"),
    (ContactDetector, "observe", "contact"),
    (GaitTracker, "observe", "contact"),
    (CanSink, "commands", "can"),
    (CanSink, "publish", "can"),
    (CycleRing, "observe", "ring"),
)
#: Calls at the end, of an empty function and of what stands for the kernel, which show what to leave out.
_N_CALLS_LEFT_OUT = 20


class Marks(msgspec.Struct):
    """What the counted process leaves.

    Attributes:
        names: Begin ("+part") or end ("-part") of a call, for each mark.
        counts: Instructions until each mark; empty where another program counts them.
    """

    names: list[str]
    counts: list[int]


class _Marker:
    """Keeps the marks of functions.

    Args:
        count: Called at each mark; returns the instructions so far, if it is known here.
    """

    def __init__(self, count: Callable[[], int]) -> None:
        self._count = count
        self._is_counting = False
        # Appending to one takes the same at any length.
        self._marks: deque[tuple[str, int]] = deque()

    def begin(self) -> None:
        """Forget all marks, and count from now on."""
        self._marks.clear()
        self._is_counting = True

    def mark(self, name: str) -> None:
        """Set a mark."""
        self._marks.append((name, self._count() if self._is_counting else 0))

    def around(self, part: str, inner: Callable[..., object]) -> Callable[..., object]:
        """Return a function with a mark before and after it."""
        mark, begin, end = self.mark, f"+{part}", f"-{part}"

        @wraps(inner)
        def marked(*args: object) -> object:
            mark(begin)
            try:
                return inner(*args)
            finally:
                mark(end)

        return marked

    def marks(self) -> Marks:
        """Return all marks."""
        names, counts = zip(*self._marks, strict=True)
        return Marks(list(names), list(counts))


def run_counted_cycles(walk: RecordedWalk, count: Callable[[], int], start: Callable[[], object]) -> Marks:
    """Run the cycles of a walk, and return the marks of those that count.

    Args:
        walk: The walk.
        count: Called at each mark; returns the instructions so far, if it is known here.
        start: Called before the first mark that counts.

    Raises:
        FootsenseError: The scanner did other transactions than those of the walk.
    """
    logging.disable()  # the faults are on purpose
    marker = _Marker(count)
    scanner, clock, answer = replay_walk(walk)
    with open_service_cycle(ROBOT, publish_every=ROBOT.effective_publish_every) as cycle:
        for owner, name, part in _PARTS:
            setattr(owner, name, marker.around(part, getattr(owner, name)))

        def run() -> None:
            cycle.run(scanner.read(), clock.now_ns())

        run_marked = marker.around("loop", run)
        with low_latency_interpreter():
            for _ in range(walk.n_warm_up):
                run_marked()
                cycle.drain()
            start()
            marker.begin()
            for _ in range(walk.n_healthy + walk.n_faulty):
                run_marked()
                cycle.drain()
            if clock.now_ns() != walk.end_ns:
                raise FootsenseError("the scanner did other transactions than the recorded ones")
            marker.around("empty", _call_repeatedly)(marker.around("nothing", lambda: None))
            marker.around("empty", _call_repeatedly)(marker.around("answer", answer))
    return marker.marks()


def _call_repeatedly(function: Callable[[], object]) -> None:
    for _ in range(_N_CALLS_LEFT_OUT):
        function()


def _start_callgrind() -> None:
    """Let the valgrind that runs this process count its instructions from now on.

    Raises:
        FootsenseError: It is not heard.
    """
    command = ["vgdb", "--max-invoke-ms=0", f"--pid={os.getpid()}", "instrumentation", "on"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as control:  # noqa: S603 - our own words
        while control.poll() is None:  # it is heard between two instructions, and not in a system call
            pass
    if control.returncode:
        raise FootsenseError("valgrind's vgdb did not reach valgrind")


def main(walk: str, marks: str, *options: str) -> None:
    """Run the cycles of a recorded walk, and write their marks into a file."""
    count = open_instruction_counter() if options else os.getppid
    start = (lambda: None) if options else _start_callgrind
    found = run_counted_cycles(
        msgspec.msgpack.decode(Path(walk).read_bytes(), type=RecordedWalk), count, start
    )
    if not options:
        found.counts = []
    Path(marks).write_bytes(msgspec.json.encode(found))


if __name__ == "__main__":
    main(*sys.argv[1:])
