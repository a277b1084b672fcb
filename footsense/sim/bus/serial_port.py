"""Simulated serial port in virtual time, from a simulated microcontroller to the daemon.

Bytes arrive a record's length at a time, as on the wire. Not simulated: delays of a USB adapter.
"""

from collections import deque

from firmware_interface.serial_frames import FRAME_BYTES, RECORD_BITS
from footsense.ports import Clock
from footsense.sim.robot_on_mcu import SimulatedRobotMcu


class SimulatedSerialPort:
    """Serial port at the daemon's end, fed by a simulated microcontroller.

    Args:
        mcu: The controller at the other end.
        clock: Virtual clock: a wait for bytes moves it.
        rate_hz: Scans per second.
        baud: Bits per second.

    Attributes:
        n_opened: Times that it has been opened.
    """

    def __init__(self, mcu: SimulatedRobotMcu, clock: Clock, *, rate_hz: float, baud: int) -> None:
        self.n_opened = 1
        self._mcu = mcu
        self._clock = clock
        self._period_ns = round(1e9 / rate_hz)
        self._byte_ns = RECORD_BITS * 1_000_000_000 // (FRAME_BYTES * baud)
        self._due: deque[tuple[int, bytes]] = deque()
        self._next_ns = clock.now_ns() + self._period_ns  # first conversion of the scan that comes next

    def read(self) -> bytes:
        """Return the bytes that have arrived by the present virtual time, and scan the feet whenever a scan is due."""
        now_ns = self._clock.now_ns()
        while self._next_ns + self._mcu.conversion_span_ns <= now_ns:
            self.schedule_arrival(self._mcu.scan(self._next_ns), self._next_ns)
            self._next_ns += self._period_ns
        arrived = b""
        while self._due and self._due[0][0] <= now_ns:
            arrived += self._due.popleft()[1]
        return arrived

    def wait_for_bytes_until_ns(self, t_ns: int) -> None:
        """Advance the clock to the next arrival of bytes, at the latest to `t_ns` [ns]."""
        sends_ns = self._next_ns + self._mcu.conversion_span_ns
        self._clock.sleep_until_ns(min(t_ns, self._due[0][0] if self._due else sends_ns))

    def write(self, data: bytes) -> None:
        """Discard the bytes: the simulated microcontroller takes no commands."""

    def close(self) -> None:
        """Do nothing: a simulated port holds no resources."""

    def schedule_arrival(self, data: bytes, t_ns: int) -> None:
        """Schedule the arrival of a scan's bytes, record by record; `t_ns` is the scan's first conversion [ns]."""
        sends_ns = t_ns + self._mcu.conversion_span_ns
        for end in range(FRAME_BYTES, len(data) + FRAME_BYTES, FRAME_BYTES):
            piece = data[end - FRAME_BYTES : end]
            self._due.append((sends_ns + min(end, len(data)) * self._byte_ns, piece))
