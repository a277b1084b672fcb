"""What the service tells of a leg beside its force: why it is in its state, where its zero stands, that it lives."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from firmware_interface.can_codes import NODE_IDS, Cause, NmtState, State, ZeroStatus
from firmware_interface.can_events import (
    FAULT_ID,
    HEARTBEAT_ID,
    Fault,
    Heartbeat,
    decode_fault,
    decode_heartbeat,
)
from firmware_interface.can_zero import ZERO_ID, Zero, decode_zero
from firmware_interface.crc8 import FrameError

__all__ = ["REPORT_IDS", "Report", "Reports"]

#: A heartbeat comes every 200 ms, a zero every second; what has not come three times in a row is not known any more.
_BEAT_LIMIT_NS = 600_000_000
_ZERO_LIMIT_NS = 3_000_000_000

_DECODERS: dict[int, Callable[[int, bytes], Fault | Zero | Heartbeat]] = {
    FAULT_ID: decode_fault,
    ZERO_ID: decode_zero,
    HEARTBEAT_ID: decode_heartbeat,
}

#: CAN ids of the frames that are taken.
REPORT_IDS = tuple(base + node for base in _DECODERS for node in NODE_IDS.values())


class Report(NamedTuple):
    """What was told of a leg; None, or NaN, wherever that is not known at the moment.

    Attributes:
        cause: What lies behind its state. It is told on change: who came later does not know it.
        cause_state: The state that the cause was told with.
        zero: What the tracking of its zero does.
        mean_pf: Mean over the elements of how far the zero has moved since the last tare [pF].
        worst_pf: The same of the element that moved farthest [pF].
        moved_ago_ns: Since the zero last moved [ns].
        node_state: What its heartbeat says; None also when it has stopped beating.
        degraded_timing: Whether the service runs without the scheduling that it asked for.
    """

    cause: Cause | None
    cause_state: State | None
    zero: ZeroStatus | None
    mean_pf: float
    worst_pf: float
    moved_ago_ns: int | None
    node_state: NmtState | None
    degraded_timing: bool | None


@dataclass(slots=True)
class _Last:
    """The last frame of each kind, and when it came [ns]."""

    fault: Fault | None = None
    zero: Zero | None = None
    zero_ns: int = 0
    beat: Heartbeat | None = None
    beat_ns: int = 0


class Reports:
    """The legs of a robot, as they report. It has no clock of its own.

    Attributes:
        n_wrong: Reports that failed their check.
    """

    def __init__(self) -> None:
        self._legs = {node: _Last() for node in NODE_IDS.values()}
        self.n_wrong = 0

    def feed(self, can_id: int, data: bytes, now_ns: int) -> bool:
        """Take a frame of any id, and return whether it was a report of a leg, good or not."""
        node = can_id & 0xF
        decode = _DECODERS.get(can_id - node)
        if decode is None or node not in self._legs:
            return False
        try:
            self._take(self._legs[node], decode(can_id, data), now_ns)
        except FrameError:
            self.n_wrong += 1
        return True

    def look(self, node: int, now_ns: int) -> Report:
        """Return what is known of a leg.

        Args:
            node: Its CAN node id, 1..6.
            now_ns: The time to judge it at [ns].
        """
        last = self._legs[node]
        fault = last.fault
        zero = last.zero if now_ns - last.zero_ns <= _ZERO_LIMIT_NS else None
        beat = last.beat if now_ns - last.beat_ns <= _BEAT_LIMIT_NS else None
        return Report(
            cause=fault.cause if fault else None,
            cause_state=fault.state if fault else None,
            zero=zero.status if zero else None,
            mean_pf=zero.mean_pf if zero else float("nan"),
            worst_pf=zero.worst_pf if zero else float("nan"),
            moved_ago_ns=None if zero is None or zero.age_ns is None else zero.age_ns + now_ns - last.zero_ns,
            node_state=beat.state if beat else None,
            degraded_timing=beat.degraded_timing if beat else None,
        )

    @staticmethod
    def _take(last: _Last, report: Fault | Zero | Heartbeat, now_ns: int) -> None:
        if isinstance(report, Fault):
            last.fault = report
        elif isinstance(report, Zero):
            last.zero, last.zero_ns = report, now_ns
        else:
            last.beat, last.beat_ns = report, now_ns
