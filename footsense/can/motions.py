"""Motions of the legs received on CAN: checks of which are taken, and when they are over."""

import math
from collections.abc import Sequence

import numpy as np

from firmware_interface.can.crc8 import FrameError
from firmware_interface.can.gait import LEG_MOTION, LEG_MOTION_ID, LegMotionFrame
from footsense.frames import CanStatistics, LegMotion, StepPhase
from footsense.ports import Clock

#: Time after which a motion that no other has followed is unknown [ns]: at 50 Hz one may be lost.
TIMEOUT_NS = 50_000_000
#: Longest horizontal part of `up` [1]: that of a foot that lies level, with its rounding.
_MAX_HORIZONTAL = 1.001

_NO_VECTOR = (math.nan, math.nan, math.nan)


class CanMotions:
    """Decodes the motions of the legs of one CAN interface, and keeps the newest of each.

    Rejected are frames with a wrong crc, length or code, those whose `up` is longer than 1, and those that repeat the
    counter of the leg's last one, whose sender hangs. A leg's last motion stays until its time is out. Any other
    counter is taken: the newest counts, and the lost ones are worth nothing.

    Args:
        nodes: CAN node id of each leg.
        clock: The times of arrival.
        stats: Counts the frames.
    """

    def __init__(self, nodes: Sequence[int], clock: Clock, stats: CanStatistics) -> None:
        self._clock, self._stats = clock, stats
        self._row_of_id = {LEG_MOTION_ID + node: row for row, node in enumerate(nodes)}
        # The newest of each leg and when it arrived [ns]; None where there is none, or its time is out.
        self._newest: list[tuple[LegMotionFrame, int] | None] = [None] * len(nodes)
        self._is_heard = self._is_new = False

    def take(self, frames: Sequence[tuple[int, bytes]]) -> None:
        """Take received frames, and count those that are rejected.

        Args:
            frames: CAN id and data of each frame, oldest first.
        """
        now_ns = self._clock.now_ns()
        self._end_overdue(now_ns)
        self._stats.received_motions += len(frames)
        for can_id, data in frames:
            row = self._row_of_id[can_id]
            try:
                frame = LEG_MOTION.decode(can_id, data)
            except FrameError:
                frame = None
            last = self._newest[row]
            repeats = frame is not None and last is not None and frame.counter == last[0].counter
            if frame is None or repeats or math.hypot(*frame.up[:2]) > _MAX_HORIZONTAL:
                self._stats.rejected_motions += 1
                continue
            self._newest[row] = frame, now_ns
            self._is_heard = self._is_new = True

    def pop_new(self) -> LegMotion | None:
        """Return the motions of all legs if one has come, or its time is out, since the last call; else None."""
        if self._is_heard:
            self._end_overdue(self._clock.now_ns())
        if not self._is_new:
            return None
        self._is_new = False
        return self._motion()

    def _end_overdue(self, now_ns: int) -> None:
        for row, newest in enumerate(self._newest):
            if newest is not None and now_ns - newest[1] > TIMEOUT_NS:
                self._newest[row], self._is_new = None, True
        self._is_heard = any(self._newest)

    def _motion(self) -> LegMotion:
        rows = [_row(*newest) if newest else _NO_ROW for newest in self._newest]
        t_ns, acceleration, sigma, up, phase = zip(*rows, strict=True)
        return LegMotion(
            np.array(t_ns, np.int64),
            np.array(acceleration),
            np.array(sigma),
            np.array(up),
            np.array(phase, np.uint8),
        )


_Row = tuple[int, float, float, Sequence[float], int]
_NO_ROW: _Row = (0, math.nan, math.nan, _NO_VECTOR, StepPhase.UNKNOWN)


def _row(frame: LegMotionFrame, arrived_ns: int) -> _Row:
    acceleration, sigma = frame.acceleration_m_per_s2, frame.sigma_m_per_s2
    if math.isnan(acceleration + sigma):  # neither is worth anything without the other
        acceleration = sigma = math.nan
    return arrived_ns, acceleration, sigma, frame.up, frame.phase
