"""The conversions of all I2C buses of the robot in one frame.

Several buses convert at the same time, each in a thread of its own: the adapter's system call releases the interpreter.
A frame is complete when the slowest bus is.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from footsense.acquisition.bus_scanner import BusScanner
from footsense.frames import ELEMENTS, CapFrame, Vector


class RobotScanner:
    """The frame source of a robot with chips on one or more I2C buses.

    Args:
        buses: One scanner a bus; the rows of a frame are the legs of the first bus, then of the second, and so on.
    """

    def __init__(self, buses: Sequence[BusScanner]) -> None:
        self._buses = tuple(buses)
        self._sequence = 0
        self._pool = (
            ThreadPoolExecutor(len(self._buses), thread_name_prefix="i2c") if len(self._buses) > 1 else None
        )

    @property
    def missed_deadlines(self) -> int:
        """Number of times that conversions were discarded because the loop was delayed."""
        return sum(bus.missed_deadlines for bus in self._buses)

    def temperature_c(self) -> Vector:
        """Return the temperature of each leg's converter [degC], shape (legs,), at most ten seconds old.

        NaN for a board without a sensor, and for a leg that is out of the scan.
        """
        return np.array([leg.temperature_c for bus in self._buses for leg in bus.legs])

    def start(self) -> None:
        """Find and set up the chips of every bus.

        Raises:
            HardwareError: A bus has no mux.
        """
        for bus in self._buses:
            bus.start()

    def read(self) -> CapFrame:
        """Read the next element of every leg, and return it beside the latest readings of the others.

        The first frame is a whole scan.
        """
        read_all = map if self._pool is None else self._pool.map
        for _ in range(1 if self._sequence else ELEMENTS):
            readings = list(read_all(BusScanner.read, self._buses))
        t_ns, capacitance_pf, reading = map(np.concatenate, zip(*readings, strict=True))
        frame = CapFrame(self._sequence, t_ns, capacitance_pf, reading)
        self._sequence += 1
        return frame

    def close(self) -> None:
        """Stop the scans and release all buses."""
        if self._pool is not None:
            self._pool.shutdown()
        for bus in self._buses:
            bus.stop()
