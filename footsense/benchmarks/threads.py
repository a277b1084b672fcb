"""What the thread of each bus adds to a frame: simulated buses are read in turn, real ones side by side.

The scanner reads two buses that answer at once, in turn and in threads. What threads add to a frame does not depend on
what a bus does: to hand over a read to each, and to wait for both.
"""

from typing import TYPE_CHECKING, cast

import numpy as np

from footsense.acquisition.robot_scanner import RobotScanner
from footsense.clock import MonotonicClock, Realtime, fifo_priority, low_latency_interpreter, stopwatch_ns
from footsense.frames import ELEMENTS, CapFrame

if TYPE_CHECKING:
    from footsense.acquisition.free_scanner import FreeScanner

_N_BUSES, _N_WARM_UP = 2, 50
_SHAPE = 3, ELEMENTS


class _ReadyBus:
    """A bus that answers at once."""

    latest = CapFrame(0, np.ones(_SHAPE, np.int64), np.ones(_SHAPE), np.zeros(_SHAPE, np.uint8))
    frame_ns = 7_000_000

    def __init__(self) -> None:
        self._clock, self.complete_ns = MonotonicClock(), 0

    def read(self) -> CapFrame:
        """Return readings."""
        self.complete_ns = self._clock.now_ns()
        return self.latest

    def close(self) -> None:
        """Do nothing."""


def measure_threads(n_frames: int) -> dict[str, float]:
    """Return the median time of a frame of two buses that answer at once [us].

    Args:
        n_frames: Frames to time in each way.

    Returns:
        `in_turn`, `in_threads`, and `added`, their difference.
    """
    in_turn, in_threads = (_frame_us(n_frames, threads=threads) for threads in (False, True))
    return {"in_turn": in_turn, "in_threads": in_threads, "added": in_threads - in_turn}


def _frame_us(n_frames: int, *, threads: bool) -> float:
    buses = cast("list[FreeScanner]", [_ReadyBus() for _ in range(_N_BUSES)])
    with low_latency_interpreter(), fifo_priority(Realtime().priority):
        scanner = RobotScanner(buses, threads=threads)  # its threads inherit the priority
        times_ns = []
        for _ in range(_N_WARM_UP + n_frames):
            start_ns = stopwatch_ns()
            scanner.read()
            times_ns.append(stopwatch_ns() - start_ns)
        scanner.close()
    return 1e-3 * float(np.median(times_ns[_N_WARM_UP:]))
