"""Slow reports of the legs on CAN: cause of the state, baseline, heartbeat, ground, calibration."""

from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple

from firmware_interface.can.codes import NODE_IDS
from firmware_interface.can.crc8 import FrameError, kind_and_node
from firmware_interface.can.gait import GROUND, Ground
from firmware_interface.can.reports import (
    BASELINE,
    CALIBRATION,
    FAULT,
    HEARTBEAT_ID,
    Baseline,
    CalibrationFrame,
    Fault,
    Heartbeat,
    decode_heartbeat,
)

#: Of each kind of frame, by its CAN id without the node: field of `LegReport`, decoder, and the age from which its
#: content is unknown [ns]: three periods of fault, baseline and calibration (1 s), heartbeat (200 ms), ground (100 ms).
_KINDS: dict[int, tuple[str, Callable[[int, bytes], Any], int]] = {
    FAULT.can_id: ("fault", FAULT.decode, 3_000_000_000),
    BASELINE.can_id: ("baseline", BASELINE.decode, 3_000_000_000),
    HEARTBEAT_ID: ("heartbeat", decode_heartbeat, 600_000_000),
    GROUND.can_id: ("ground", GROUND.decode, 300_000_000),
    CALIBRATION.can_id: ("calibration", CALIBRATION.decode, 3_000_000_000),
}

#: CAN ids of the accepted frames.
REPORT_IDS = tuple(base + node for base in _KINDS for node in NODE_IDS.values())


class LegReport(NamedTuple):
    """Latest reports of one leg; None where none arrived lately.

    Attributes:
        fault: Its state with the cause and the elements that are out.
        baseline: Its baseline; `age_ns` is that of the present.
        heartbeat: State of its node.
        ground: The ground below its foot.
        ground_ago_ns: Time since that arrived [ns].
        calibration: How its foot is calibrated.
    """

    fault: Fault | None = None
    baseline: Baseline | None = None
    heartbeat: Heartbeat | None = None
    ground: Ground | None = None
    ground_ago_ns: int | None = None
    calibration: CalibrationFrame | None = None


class Reports:
    """Receiver of the legs' slow reports; the caller supplies the times."""

    def __init__(self) -> None:
        self._last: dict[int, tuple[Any, int]] = {}  # by CAN id: content, and when it arrived

    def feed(self, can_id: int, data: bytes, now_ns: int) -> bool:
        """Process any CAN frame; return whether its id is that of a leg's report, even if the frame is invalid.

        Args:
            can_id: Its 11-bit id.
            data: Its bytes.
            now_ns: Time of arrival [ns].
        """
        if can_id not in REPORT_IDS:
            return False
        _, decode, _ = _KINDS[kind_and_node(can_id)[0]]
        with suppress(FrameError):  # the next one comes soon
            self._last[can_id] = decode(can_id, data), now_ns
        return True

    def leg(self, node: int, now_ns: int) -> LegReport:
        """Return the latest reports of a leg, without outdated ones.

        Args:
            node: Its CAN node id, 1..8.
            now_ns: The present time [ns].
        """
        latest: dict[str, Any] = {}
        for base, (name, _, max_age_ns) in _KINDS.items():
            report, arrived_ns = self._last.get(base + node, (None, now_ns))
            if now_ns - arrived_ns <= max_age_ns:
                latest[name] = report
                if isinstance(report, Ground):
                    latest["ground_ago_ns"] = now_ns - arrived_ns
                if isinstance(report, Baseline) and report.age_ns is not None:
                    latest[name] = report._replace(age_ns=report.age_ns + now_ns - arrived_ns)
        return LegReport(**latest)
