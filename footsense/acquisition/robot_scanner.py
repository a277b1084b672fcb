"""The scans of all I2C buses of the robot in one frame.

Several buses scan at the same time, each in a thread of its own: the adapter's system call releases the interpreter. A
frame is complete when the slowest bus is.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import repeat

import numpy as np

from footsense.acquisition.bus_scanner import BusScanner
from footsense.frames import ELEMENTS, CapFrame, Vector


class RobotScanner:
    """The frame source of a robot with chips on one or more I2C buses.

    Args:
        buses: One scanner a bus; the rows of a frame are the legs of the first bus, then of the second, and so on.
        element_wise: Whether `read` returns after every element instead of after every scan.
    """

    def __init__(self, buses: Sequence[BusScanner], *, element_wise: bool = False) -> None:
        self._buses = tuple(buses)
        self._element_wise = element_wise
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
        """Read every element of every leg, or the next one alone beside the latest readings of the others.

        The first frame is always a whole scan.
        """
        read_all = map if self._pool is None else self._pool.map
        n_steps = 1 if self._element_wise and self._sequence else ELEMENTS
        scans = read_all(BusScanner.read, self._buses, repeat(n_steps))
        t_ns, capacitance_pf, reading = map(np.concatenate, zip(*scans, strict=True))
        frame = CapFrame(self._sequence, t_ns, capacitance_pf, reading)
        self._sequence += 1
        return frame

    def close(self) -> None:
        """Stop the scans and release all buses."""
        if self._pool is not None:
            self._pool.shutdown()
        for bus in self._buses:
            bus.stop()
