"""CAN frames of any content, damaged on the wire or made by someone else."""

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_interface.can.commands import ANSWER, ANSWER_ID, COMMAND, COMMAND_ID
from firmware_interface.can.crc8 import FrameError, protect
from firmware_interface.can.force import FORCE, FORCE_ID, QUALITY, QUALITY_ID
from firmware_interface.can.gait import (
    GAIT_EVENT,
    GAIT_EVENT_ID,
    GROUND,
    GROUND_ID,
    LEG_MOTION,
    LEG_MOTION_ID,
)
from firmware_interface.can.reports import (
    BASELINE,
    BASELINE_ID,
    CALIBRATION,
    CALIBRATION_ID,
    FAULT,
    FAULT_ID,
    HEARTBEAT_ID,
    decode_heartbeat,
)
from footsense.client.gait_events import GaitEvents
from footsense.client.link import Link
from footsense.client.reports import Reports
from tests.fuzz.outcome import TRIED, refusal

DECODERS: list[tuple[int, int, Callable[[int, bytes], object]]] = [
    (FORCE_ID, 8, FORCE.decode),
    (QUALITY_ID, 8, QUALITY.decode),
    (FAULT_ID, 6, FAULT.decode),
    (COMMAND_ID, 8, COMMAND.decode),
    (ANSWER_ID, 4, ANSWER.decode),
    (HEARTBEAT_ID, 1, decode_heartbeat),
    (BASELINE_ID, 8, BASELINE.decode),
    (GAIT_EVENT_ID, 6, GAIT_EVENT.decode),
    (CALIBRATION_ID, 6, CALIBRATION.decode),
    (LEG_MOTION_ID, 8, LEG_MOTION.decode),
    (GROUND_ID, 8, GROUND.decode),
]


@pytest.mark.parametrize(
    ("base", "length", "decode"), DECODERS, ids=lambda value: getattr(value, "__name__", "")
)
@given(data=st.data())
@TRIED
def test_any_payload(
    base: int, length: int, decode: Callable[[int, bytes], object], data: st.DataObject
) -> None:
    """Any id, any length, and right crcs around any content: a value or a `FrameError`."""
    can_id = base + data.draw(st.integers(-2, 9))
    payload = data.draw(st.binary(max_size=12) | st.binary(min_size=length, max_size=length))
    refusal(lambda: decode(can_id, payload), FrameError)
    sealed = protect(can_id, payload[:7])
    if refusal(lambda: decode(can_id, sealed), FrameError) is None:
        flipped = bytearray(sealed)
        flipped[data.draw(st.integers(0, len(sealed) - 1))] ^= 1 << data.draw(st.integers(0, 7))
        if len(sealed) > 1:  # a heartbeat has no crc
            assert refusal(lambda: decode(can_id, bytes(flipped)), FrameError)


frames = st.tuples(st.integers(0, 0x7FF), st.binary(max_size=9), st.booleans(), st.integers(-(10**6), 10**9))


@given(st.lists(frames, max_size=40))
@TRIED
def test_any_traffic(traffic: list[tuple[int, bytes, bool, int]]) -> None:
    """The client takes whatever comes at whatever time, and shows every leg all the while."""
    link, reports, events, now_ns = Link(), Reports(), GaitEvents(), 0
    for can_id, payload, sealed, step_ns in traffic:
        now_ns += step_ns
        data = protect(can_id, payload[:7]) if sealed else payload
        link.feed(can_id, data, now_ns)
        reports.feed(can_id, data, now_ns)
        events.feed(can_id, data, now_ns)
        for node in range(1, 7):
            link.leg(node, now_ns)
            reports.leg(node, now_ns)
