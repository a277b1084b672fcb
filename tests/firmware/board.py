"""A microcontroller with the reference firmware: its port to simulated chips, and its line to the service.

The firmware itself runs as a library in this process (`native.py`), or in an emulated Cortex-M (`emulated.py`).
"""

from collections import deque
from collections.abc import Callable, Sequence

from firmware_interface.serial_frames import IDENTIFY
from footsense.errors import I2cError, I2cTimeoutError
from footsense.ports import Clock, I2cBus, Transaction
from footsense.sim.clock import JoinedClock, VirtualClock

__all__ = ["ADDRESS", "BAUD", "Board", "Line"]

ADDRESS, BAUD = 0x2C, 2_000_000
#: Error of its crystal [1], and its time at the start [us]: it wraps soon.
CLOCK_ERROR_REL, STARTS_US = 40e-6, 2**32 - 700_000
_BYTE_NS = 10 * 1_000_000_000 / BAUD


class Board:
    """What the firmware's port does, in virtual time: the buses of the legs, a clock, a serial line.

    Args:
        buses: Bus of each leg.
        clocks: Their clocks.

    Attributes:
        n_transfers: Transactions so far; those of several legs at once are one.
        sent: What is on the line: time of arrival [ns] of the bytes of each frame.
        received: Bytes that the firmware has not taken yet.
        cpu_ns: Time that the processor takes from a scan's results to its first byte on the line [ns].
    """

    def __init__(self, buses: Sequence[I2cBus], clocks: Sequence[VirtualClock]) -> None:
        self.n_transfers = 0
        self.sent: deque[tuple[int, bytes]] = deque()
        self.received: deque[int] = deque()
        self.cpu_ns = 0
        self._buses = buses
        self._clock = JoinedClock(clocks)

    def now_ns(self) -> int:
        """Return the true time [ns]."""
        return self._clock.now_ns()

    def transfer(self, legs: int, out: bytes, n_in: int) -> tuple[int, int, list[bytes]]:
        """Do a transaction with each leg of a mask at once; return masks of answers and stuck lines, and the bytes."""
        self.n_transfers += 1
        self._clock.now_ns()  # all of them begin together
        answered = stuck = 0
        read = [bytes(n_in)] * len(self._buses)
        for leg, bus in enumerate(self._buses):
            if legs >> leg & 1:
                try:
                    read[leg] = bus.transfer(Transaction(ADDRESS, out, n_in))
                    answered |= 1 << leg
                except I2cTimeoutError:
                    stuck |= 1 << leg
                except I2cError:
                    pass
        self._clock.now_ns()
        return answered, stuck, read

    def now_us(self) -> int:
        """Return the time by the controller's clock [us]."""
        return (STARTS_US + round(self.now_ns() * (1 + CLOCK_ERROR_REL)) // 1000) % 2**32

    def wait_until_us(self, t_us: int) -> None:
        """Wait until that clock shows a time [us]; not at all if it has passed."""
        ahead_us = (t_us - self.now_us() + 2**31) % 2**32 - 2**31
        if ahead_us > 0:
            self._clock.sleep_until_ns(self.now_ns() + 1000 * ahead_us)

    def send(self, data: bytes) -> None:
        """Put bytes on the line."""
        begin_ns, n = self.now_ns(), 0
        for frame in data.split(b"\0")[:-1]:
            n += len(frame) + 1
            self.sent.append((round(begin_ns + n * _BYTE_NS), frame + b"\0"))

    def receive(self) -> int:
        """Return the next byte for the firmware, or -1, once in a scan, before it says when it sends."""
        if self.received:
            return self.received.popleft()
        self._clock.sleep_until_ns(self.now_ns() + self.cpu_ns)
        return -1


class Line:
    """The service's end of a board's serial line, in the service's own time.

    Args:
        board: The board.
        boot: Starts the firmware on the board; returns what lets it do its next scan.
        clock: The service's time.

    Attributes:
        n_opened: As of a serial port.
    """

    def __init__(self, board: Board, boot: Callable[[Board], Callable[[], None]], clock: Clock) -> None:
        self.n_opened = 1
        self._board, self._boot, self._clock = board, boot, clock
        self.scan: Callable[[], None] = lambda: None

    def start(self) -> None:
        """Start the firmware, or start it again."""
        self.scan = self._boot(self._board)

    def read(self) -> bytes:
        """Return what has arrived."""
        arrived = b""
        while self._board.sent and self._board.sent[0][0] <= self._clock.now_ns():
            arrived += self._board.sent.popleft()[1]
        return arrived

    def wait_for_bytes_until_ns(self, t_ns: int) -> None:
        """Let the firmware scan until bytes arrive or a time has come."""
        while not self._board.sent and self._board.now_ns() < t_ns:
            self.scan()
        self._clock.sleep_until_ns(min(t_ns, self._board.sent[0][0] if self._board.sent else t_ns))

    def write(self, data: bytes) -> None:
        """Send bytes to the firmware."""
        assert data == IDENTIFY
        self._board.received.extend(data)

    def close(self) -> None:
        """Do nothing."""
