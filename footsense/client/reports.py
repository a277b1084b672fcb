"""Slow reports of the legs on CAN: cause of the state, baseline, heartbeat, contact, ground."""

import math
from collections.abc import Callable
from typing import NamedTuple, TypeVar

from firmware_interface.can.codes import NODE_IDS, BaselineStatus, Cause, NmtState, State
from firmware_interface.can.crc8 import FrameError
from firmware_interface.can.gait import GAIT, GROUND, Gait, Ground
from firmware_interface.can.reports import (
    BASELINE,
    FAULT,
    HEARTBEAT_ID,
    Baseline,
    Fault,
    Heartbeat,
    decode_heartbeat,
)

#: Age from which the content of a frame is unknown [ns]: three periods of baseline (1 s), heartbeat (200 ms), and
#: contact and ground (100 ms).
_MAX_REPORT_AGE_NS = {
    Fault: math.inf,
    Baseline: 3_000_000_000,
    Heartbeat: 600_000_000,
    Gait: 300_000_000,
    Ground: 300_000_000,
}

Report = TypeVar("Report", Fault, Baseline, Heartbeat, Gait, Ground)

_DECODERS: dict[int, Callable[[int, bytes], Fault | Baseline | Heartbeat | Gait | Ground]] = {
    FAULT.can_id: FAULT.decode,
    BASELINE.can_id: BASELINE.decode,
    GAIT.can_id: GAIT.decode,
    GROUND.can_id: GROUND.decode,
    HEARTBEAT_ID: decode_heartbeat,
}

#: CAN ids of the accepted frames.
REPORT_IDS = tuple(base + node for base in _DECODERS for node in NODE_IDS.values())


class LegReport(NamedTuple):
    """Latest reports of one leg; None or NaN where the present value is unknown.

    Attributes:
        cause: Cause of its state. Sent on change alone, so unknown to a client that started later.
        cause_state: The state sent with the cause.
        baseline: Status of the baseline tracking.
        baseline_mean_offset_pf: Offset of the baseline since the last tare, mean over the elements [pF].
        baseline_worst_offset_pf: Offset of the element with the largest [pF].
        baseline_moved_ago_ns: Time since the baseline last moved [ns].
        node_state: NMT state of the heartbeat; None also without heartbeats.
        degraded_timing: Whether the service runs without the scheduling that it asked for.
        gait: Its contact.
        ground: The ground below its foot.
    """

    cause: Cause | None
    cause_state: State | None
    baseline: BaselineStatus | None
    baseline_mean_offset_pf: float
    baseline_worst_offset_pf: float
    baseline_moved_ago_ns: int | None
    node_state: NmtState | None
    degraded_timing: bool | None
    gait: Gait | None = None
    ground: Ground | None = None


class Reports:
    """Receiver of the legs' slow reports; the caller supplies the times.

    Attributes:
        n_wrong: Reports that failed their check.
    """

    def __init__(self) -> None:
        self._last: dict[tuple[int, type], tuple[Fault | Baseline | Heartbeat | Gait | Ground, int]] = {}
        self.n_wrong = 0

    def feed(self, can_id: int, data: bytes, now_ns: int) -> bool:
        """Process any CAN frame; return whether its id is that of a leg's report, even if the frame is invalid.

        Args:
            can_id: Its 11-bit id.
            data: Its bytes.
            now_ns: Time of arrival [ns].
        """
        if can_id not in REPORT_IDS:
            return False
        node = can_id & 0xF
        try:
            report = _DECODERS[can_id - node](can_id, data)
        except FrameError:
            self.n_wrong += 1
        else:
            self._last[node, type(report)] = report, now_ns
        return True

    def leg(self, node: int, now_ns: int) -> LegReport:
        """Return the latest reports of a leg, without outdated ones.

        Args:
            node: Its CAN node id, 1..8.
            now_ns: The present time [ns].
        """
        fault, _ = self._latest_and_age_ns(node, Fault, now_ns)
        baseline, since_ns = self._latest_and_age_ns(node, Baseline, now_ns)
        beat, _ = self._latest_and_age_ns(node, Heartbeat, now_ns)
        gait, _ = self._latest_and_age_ns(node, Gait, now_ns)
        ground, _ = self._latest_and_age_ns(node, Ground, now_ns)
        baseline_moved_ago_ns = None
        if baseline is not None and baseline.age_ns is not None:
            baseline_moved_ago_ns = baseline.age_ns + since_ns
        return LegReport(
            cause=fault.cause if fault else None,
            cause_state=fault.state if fault else None,
            baseline=baseline.status if baseline else None,
            baseline_mean_offset_pf=baseline.mean_pf if baseline else float("nan"),
            baseline_worst_offset_pf=baseline.worst_pf if baseline else float("nan"),
            baseline_moved_ago_ns=baseline_moved_ago_ns,
            node_state=beat.state if beat else None,
            degraded_timing=beat.degraded_timing if beat else None,
            gait=gait,
            ground=ground,
        )

    def _latest_and_age_ns(self, node: int, kind: type[Report], now_ns: int) -> tuple[Report | None, int]:
        """Return the latest report of a type and its age [ns]; None if there is none, or it is too old."""
        report, arrived_ns = self._last.get((node, kind), (None, now_ns))
        since_ns = now_ns - arrived_ns
        return (
            report if isinstance(report, kind) and since_ns <= _MAX_REPORT_AGE_NS[kind] else None
        ), since_ns
