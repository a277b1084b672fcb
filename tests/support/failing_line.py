"""A serial line of a microcontroller that fails: lost or corrupt bytes, restarts, a plug that is out."""

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from footsense.ports import Clock
from footsense.sim.faults.scene_faults import Span, in_any_span
from footsense.sim.robot_on_mcu import SimulatedRobotMcu, SimulatedSerialPort


class LineFaults(NamedTuple):
    """Faults of a simulated serial line.

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


class FailingLine(SimulatedSerialPort):
    """A simulated line with faults.

    Args:
        mcu: The controller at the other end.
        clock: Virtual clock.
        rate_hz: Scans per second.
        bits_per_s: Bits per second.
        faults: Faults of the line.
    """

    def __init__(
        self, mcu: SimulatedRobotMcu, clock: Clock, *, rate_hz: float, bits_per_s: int, faults: LineFaults
    ) -> None:
        super().__init__(mcu, clock, rate_hz=rate_hz, bits_per_s=bits_per_s)
        self._faults = faults
        self._controller = mcu
        self._resets_ns = deque(sorted(faults.resets_ns))
        self._random = np.random.default_rng(0)
        self._lead = b""
        self._is_out = False

    def schedule_arrival(self, data: bytes, t_ns: int) -> None:
        """Put the bytes of a scan on the line that get through."""
        data, self._lead = self._lead + data, b""
        while self._resets_ns and self._resets_ns[0] <= t_ns:
            data = data[: len(data) // 2 + 20]
            self._controller.started_ns, self._controller.n_scans = self._resets_ns.popleft(), 0
            self._lead = b"\0"  # ends the interrupted record
        was_out, self._is_out = self._is_out, in_any_span(list(self._faults.unplugged_ns), t_ns)
        if not self._is_out:
            self.n_opened += was_out
            super().schedule_arrival(self._harmed(data), t_ns)

    def _harmed(self, data: bytes) -> bytes:
        lost_rel, corrupt_rel, *_ = self._faults
        if not (lost_rel or corrupt_rel):
            return data
        line = np.frombuffer(data, np.uint8)
        kept = self._random.random(len(line)) >= lost_rel
        wrong = self._random.random(len(line)) < corrupt_rel
        bits = np.left_shift(1, self._random.integers(0, 8, len(line))).astype(np.uint8)
        return np.where(wrong, line ^ bits, line)[kept].tobytes()
