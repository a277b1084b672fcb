"""Frame source of a robot with several I2C buses, each of which has a scanner of its own.

The buses convert at the same time, each in a thread: the adapter's system call releases the interpreter. A frame is
complete when the slowest bus is. A bus that is later than the first one by a whole conversion, such as one on which a
line is held low, does not delay the others: they go on with its last readings, until it is there again.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from typing import Any

import numpy as np

from footsense.acquisition.free_scanner import FreeScanner
from footsense.acquisition.leg_connection import LegConnection
from footsense.acquisition.scanner import BusScanner
from footsense.frames import CapFrame

#: Later than any time [ns].
_NEVER_NS = 1 << 63


class _SequentialExecutor(Executor):
    """Executor that runs each task at once in the calling thread, for simulated buses."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:  # noqa: ANN401 - as its base
        done: Future[Any] = Future()
        done.set_result(fn(*args, **kwargs))
        return done


class RobotScanner:
    """Frame source of a robot whose chips are on several I2C buses.

    Args:
        buses: One scanner a bus; the rows of a frame are the legs of the first bus, then of the second, and so on.
        threads: Whether each bus gets a thread; without, they are read in turn, as in virtual time.
    """

    def __init__(self, buses: Sequence[BusScanner | FreeScanner], *, threads: bool = False) -> None:
        self._buses = tuple(buses)
        self._sequence = 0
        self._threads = threads
        self._pool: Executor = (
            ThreadPoolExecutor(len(buses), thread_name_prefix="i2c") if threads else _SequentialExecutor()
        )
        # Readings on their way, and the last that have arrived.
        self._pending: list[Future[CapFrame] | None] = [None] * len(self._buses)
        self._latest = [bus.latest for bus in self._buses]
        self._grace_ns = max(bus.plan.longest_frame_ns for bus in self._buses)

    @property
    def legs(self) -> list[LegConnection]:
        """Connection states of all legs, in the order of the frame's rows."""
        return [leg for bus in self._buses for leg in bus.legs]

    @property
    def n_late_discards(self) -> int:
        """Number of times that conversions were discarded because the loop was delayed."""
        return sum(bus.n_late_discards for bus in self._buses)

    def start(self) -> None:
        """Find and set up the chips of all buses.

        Raises:
            HardwareError: The mux of a bus does not answer.
        """
        for bus in self._buses:
            bus.start()
        if not self._threads:
            ready_ns = max(bus.clock.now_ns() for bus in self._buses)
            for bus in self._buses:
                bus.clock.sleep_until_ns(ready_ns)

    def read(self) -> CapFrame:
        """Make the next conversion of every leg; return its readings with the latest ones of all other elements.

        The first frame is a whole scan.
        """
        self._read_buses()
        _, *of_buses = zip(*self._latest, strict=True)
        t_ns, capacitance_pf, reading = map(np.concatenate, of_buses)
        frame = CapFrame(self._sequence, t_ns, capacitance_pf, reading)
        self._sequence += 1
        return frame

    def _read_buses(self) -> None:
        """Start reading all buses that are not busy, and take the readings that are complete."""
        fresh = dict[int, Future[CapFrame]]()
        for n, bus in enumerate(self._buses):
            if self._pending[n] is None:
                self._pending[n] = fresh[n] = self._pool.submit(bus.read)
        _, others = wait(fresh.values(), return_when=FIRST_COMPLETED)
        wait(others, timeout=self._grace_ns * 1e-9 if self._sequence else None)
        ready_ns, first_ns = dict[int, int](), _NEVER_NS
        for n, each in enumerate(self._pending):
            if each is not None and each.done():
                ready_ns[n] = self._buses[n].complete_ns
                if n in fresh:
                    first_ns = min(first_ns, ready_ns[n])
        now_ns = first_ns
        for n in fresh:
            t_ns = ready_ns.get(n, first_ns)
            if t_ns <= first_ns + self._grace_ns or not self._sequence:
                now_ns = max(now_ns, t_ns)
        for n, t_ns in ready_ns.items():
            pending = self._pending[n]
            if t_ns <= now_ns and pending is not None:
                self._latest[n] = pending.result()
                self._pending[n] = None

    def close(self) -> None:
        """End the threads of the buses, and disconnect all legs."""
        self._pool.shutdown()
        for bus in self._buses:
            bus.close()
