"""Gait events received on CAN, without repetitions; in C: `firmware_interface/c/footsense_gait.h`."""

from typing import NamedTuple

from firmware_interface.can.codes import NODE_IDS, GaitEventKind
from firmware_interface.can.crc8 import FrameError
from firmware_interface.can.gait import GAIT_EVENT, GAIT_EVENT_ID

#: CAN ids of the accepted frames.
GAIT_EVENT_IDS = tuple(GAIT_EVENT_ID + node for node in NODE_IDS.values())

#: The same event with the same counter within this time is a repetition; later, it comes from a restarted service [ns].
_REPETITION_WITHIN_NS = 1_000_000_000


class LegEvent(NamedTuple):
    """Gait event of one leg as received: type and time.

    Attributes:
        node: CAN node id of the leg, 1..8.
        kind: What happened.
        t_ns: Time at which it happened, in the time of `feed` [ns]; None: not known.
        sigma_s: Standard deviation of that time [s], NaN if not known.
        all_in_air: Whether every leg was known to be without contact then.
    """

    node: int
    kind: GaitEventKind
    t_ns: int | None
    sigma_s: float
    all_in_air: bool


class GaitEvents:
    """Decoder of the legs' gait events, which removes repeated frames; the caller supplies the times."""

    def __init__(self) -> None:
        self._last: dict[int, tuple[int, GaitEventKind, int]] = {}

    def feed(self, can_id: int, data: bytes, now_ns: int) -> LegEvent | None:
        """Process any CAN frame; return a new gait event, None for repeated, damaged and other frames.

        Args:
            can_id: Its 11-bit id.
            data: Its bytes.
            now_ns: Time of arrival [ns].
        """
        if can_id not in GAIT_EVENT_IDS:
            return None
        try:
            event = GAIT_EVENT.decode(can_id, data)
        except FrameError:
            return None
        counter, kind, last_ns = self._last.get(event.node, (None, None, 0))
        self._last[event.node] = event.counter, event.kind, now_ns
        if (event.counter, event.kind) == (counter, kind) and 0 <= now_ns - last_ns < _REPETITION_WITHIN_NS:
            return None
        t_ns = None if event.age_ns is None else now_ns - event.age_ns
        return LegEvent(event.node, event.kind, t_ns, event.sigma_s, event.all_in_air)
