"""Frame source of a robot with several I2C buses, each of which has a scanner of its own.

The buses convert at the same time, each in a thread: the adapter's system call releases the interpreter. A frame is
complete when the slowest bus is. A bus that is later than the first one by a whole conversion, such as one on which a
line is held low, does not delay the others: they go on with its last readings, until it is there again.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from queue import Empty, SimpleQueue

import numpy as np

from footsense.acquisition.free_scanner import FreeScanner
from footsense.acquisition.leg_connection import LegConnection
from footsense.acquisition.scanner import BusScanner
from footsense.frames import CapFrame


class RobotScanner:
    """Frame source of a robot whose chips are on several I2C buses.

    Args:
        buses: One scanner a bus; the rows of a frame are the legs of the first bus, then of the second, and so on.
        threads: Whether each bus gets a thread; without, they are read in turn, as in virtual time.
    """

    def __init__(self, buses: Sequence[BusScanner | FreeScanner], *, threads: bool = False) -> None:
        self._buses = tuple(buses)
        self._sequence = 0
        self._pool = ThreadPoolExecutor(len(buses), thread_name_prefix="i2c") if threads else None
        # Numbers of the buses whose readings are on their way, those that have arrived, and the last that were taken.
        self._pending = set[int]()
        self._arrived = SimpleQueue[tuple[int, CapFrame | Exception]]()
        self._ready = dict[int, CapFrame | Exception]()
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
        if self._pool is None:
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
        buses, ready = self._buses, self._ready
        fresh = [n for n in range(len(buses)) if n not in self._pending]
        self._pending.update(fresh)
        for n in fresh:
            if self._pool is None:
                self._read_bus(n)
            else:
                self._pool.submit(self._read_bus, n)
        n_awaited, timeout_s = len(fresh), None
        while n_awaited:
            try:
                n, readings = self._arrived.get(timeout=timeout_s)
            except Empty:
                break
            ready[n] = readings
            if n in fresh:
                n_awaited -= 1
                timeout_s = self._grace_ns * 1e-9 if self._sequence else None
        ready_ns = {n: buses[n].complete_ns for n in ready}
        fresh_ns = [t_ns for n, t_ns in ready_ns.items() if n in fresh]
        limit_ns = min(fresh_ns) + self._grace_ns if self._sequence else max(fresh_ns)
        now_ns = max(t_ns for t_ns in fresh_ns if t_ns <= limit_ns)
        for n, t_ns in ready_ns.items():
            if t_ns <= now_ns:
                readings = ready.pop(n)
                self._pending.discard(n)
                if isinstance(readings, Exception):
                    raise readings
                self._latest[n] = readings

    def _read_bus(self, n: int) -> None:
        """Read a bus, and tell what came of it."""
        readings: CapFrame | Exception
        try:
            readings = self._buses[n].read()
        except Exception as error:  # noqa: BLE001 - the loop's thread raises it
            readings = error
        self._arrived.put((n, readings))

    def close(self) -> None:
        """End the threads of the buses, and disconnect all legs."""
        if self._pool is not None:
            self._pool.shutdown()
        for bus in self._buses:
            bus.close()
