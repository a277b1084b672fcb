"""A serial line in virtual time, from a simulated microcontroller to the daemon.

Bytes arrive a record's length at a time, as on the wire. Faults: lost bytes, wrong bits, resets of the controller, a
plug that is out. Not simulated: delays of a USB adapter.
"""

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from firmware_interface.serial_frames import FRAME_BYTES, RECORD_BITS
from footsense.ports import Clock
from footsense.sim.chips.mcu import SimulatedMcu
from footsense.sim.faults.schedule import Span, during


class LineFaults(NamedTuple):
    """Faults of a simulated serial line: lost and corrupt bytes, controller resets, unplugged spans.

    Attributes:
        lost_rel: Share of the bytes that are lost [1].
        corrupt_rel: Share of the bytes with one wrong bit [1].
        resets_ns: Times at which the controller is reset, in the middle of a record [ns].
        unplugged_ns: Spans in which the plug is out [ns].
    """

    lost_rel: float = 0.0
    corrupt_rel: float = 0.0
    resets_ns: Sequence[int] = ()
    unplugged_ns: Sequence[Span] = ()


class SimulatedLine:
    """The serial port at the daemon's end.

    Args:
        mcu: The controller at the other end.
        clock: Virtual clock: a wait for bytes moves it.
        rate_hz: Scans per second.
        baud: Bits per second.
        faults: Faults of the line.
        seed: Seed of the random ones.

    Attributes:
        opened: Times that it has been opened.
    """

    def __init__(
        self,
        mcu: SimulatedMcu,
        clock: Clock,
        *,
        rate_hz: float,
        baud: int,
        faults: LineFaults = LineFaults(),  # noqa: B008 - a tuple
        seed: int = 0,
    ) -> None:
        self.opened = 1
        self._mcu = mcu
        self._clock = clock
        self._period_ns = round(1e9 / rate_hz)
        self._byte_ns = RECORD_BITS * 1_000_000_000 // (FRAME_BYTES * baud)
        self._due: deque[tuple[int, bytes]] = deque()
        self._faults = faults
        self._resets_ns = deque(sorted(faults.resets_ns))
        self._random = np.random.default_rng(seed)
        self._next_ns = clock.now_ns() + self._period_ns  # first conversion of the scan that comes next
        self._is_out = False

    def read(self) -> bytes:
        """Return the bytes that have arrived."""
        now_ns = self._clock.now_ns()
        while self._next_ns + self._mcu.converts_ns <= now_ns:
            self._send(self._next_ns)
            self._next_ns += self._period_ns
        arrived = b""
        while self._due and self._due[0][0] <= now_ns:
            arrived += self._due.popleft()[1]
        return arrived

    def wait_until_ns(self, t_ns: int) -> None:
        """Move the clock to the next arrival, or to `t_ns`."""
        sends_ns = self._next_ns + self._mcu.converts_ns
        self._clock.sleep_until_ns(min(t_ns, self._due[0][0] if self._due else sends_ns))

    def write(self, data: bytes) -> None:
        """Discard bytes: the controller does not listen."""

    def close(self) -> None:
        """Do nothing: there is nothing to release."""

    def _send(self, t_ns: int) -> None:
        """Put the bytes of a scan on the line that get through, a record's length at a time."""
        data = self._mcu.scan(t_ns)
        while self._resets_ns and self._resets_ns[0] <= t_ns:
            data = data[: len(data) // 2 + 20]
            self._mcu.restart(self._resets_ns.popleft())
        was_out, self._is_out = self._is_out, during(list(self._faults.unplugged_ns), t_ns)
        if self._is_out:
            return
        self.opened += was_out
        data, sends_ns = self._harmed(data), t_ns + self._mcu.converts_ns
        for end in range(FRAME_BYTES, len(data) + FRAME_BYTES, FRAME_BYTES):
            piece = data[end - FRAME_BYTES : end]
            self._due.append((sends_ns + min(end, len(data)) * self._byte_ns, piece))

    def _harmed(self, data: bytes) -> bytes:
        lost_rel, corrupt_rel, *_ = self._faults
        if not (lost_rel or corrupt_rel):
            return data
        line = np.frombuffer(data, np.uint8)
        kept = self._random.random(len(line)) >= lost_rel
        wrong = self._random.random(len(line)) < corrupt_rel
        bits = np.left_shift(1, self._random.integers(0, 8, len(line))).astype(np.uint8)
        return np.where(wrong, line ^ bits, line)[kept].tobytes()
