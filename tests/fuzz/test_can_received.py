"""What the service receives from CAN, and from the loopback in place of it: frames of any content."""

import os
import socket
from collections.abc import Iterator

import can
import msgpack
import pytest
from can.interfaces.udp_multicast.utils import pack_message
from hypothesis import example, given
from hypothesis import strategies as st

from firmware_interface.can.codes import NODE_IDS, CommandKind, StepPhase
from firmware_interface.can.commands import encode_command
from firmware_interface.can.crc8 import protect
from firmware_interface.can.socketcan import (
    EXTENDED,
    FRAME_BYTES,
    pack_frame,
    unpack_frame,
)
from footsense.can.interface import Can
from footsense.can.sink import CanSink
from footsense.ports import CanWire
from footsense.wires.address import CanAddress
from footsense.wires.opening import open_wire
from footsense.wires.python_can import keep_multicast_local
from footsense.wires.socket_wire import SocketWire
from tests.fuzz.outcome import TRIED, nested
from tests.support.can_robot import FakeClock

LEGS = tuple(NODE_IDS)
_SECOND_NS = 1_000_000_000

any_ids = (
    st.integers(0x110, 0x118) | st.integers(0x130, 0x138) | st.integers(0, 0x7FF) | st.integers(0, 2**32 - 1)
)
commands = st.builds(
    lambda node, counter, kind: pack_frame(0x110 + node, encode_command(node, counter, kind)),
    st.integers(1, 6),
    st.integers(0, 14),
    st.sampled_from(CommandKind),
)
protected = st.builds(
    lambda can_id, data: pack_frame(can_id, protect(can_id, data)),
    st.integers(0x111, 0x116) | st.integers(0x131, 0x136),
    st.binary(max_size=7),
)
classic = st.binary(min_size=FRAME_BYTES, max_size=FRAME_BYTES)
plain = st.builds(pack_frame, any_ids, st.binary(max_size=8))
any_frames = commands | protected | plain | classic


@given(st.lists(st.tuples(any_frames, st.integers(0, 3 * _SECOND_NS // 10)), max_size=60))
@TRIED
def test_any_frames_to_the_service(frames: list[tuple[bytes, int]]) -> None:
    """None stops it; commands name legs that it has, ten a second of each at most, and each frame is counted."""
    there, here = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    clock, executed = FakeClock(), [0] * len(LEGS)
    sink = CanSink(Can(interface="socketcan"), LEGS, clock, connect=lambda: SocketWire(here))
    for frame, step_ns in frames:
        before_ns, clock.t_ns = clock.t_ns, clock.t_ns + step_ns
        if clock.t_ns // _SECOND_NS != before_ns // _SECOND_NS:
            executed = [0] * len(LEGS)
        there.send(frame)
        for command in sink.commands():
            executed[command.leg] += 1
            assert executed[command.leg] <= 10
        motion = sink.new_motion()
        assert motion is None or (motion.phase <= max(StepPhase)).all()
    stats = sink.stats
    assert stats.received_commands + stats.received_motions + stats.bus_errors <= len(frames)
    assert stats.rejected_commands <= stats.received_commands
    assert stats.rejected_motions <= stats.received_motions
    sink.close()
    there.close()


def test_padding_of_a_frame_is_not_taken_for_its_kind() -> None:
    """A program on this computer may leave anything in the unused bytes; the frame behind it is still received."""
    there, here = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    wire = SocketWire(here)
    stop = pack_frame(0x111, encode_command(1, 0, CommandKind.STOP))
    for _ in range(2):
        there.send(stop[:5] + b"\xff\xff\xff" + stop[8:])
    assert [unpack_frame(frame)[1] for frame in wire.receive()] == [stop[8:]] * 2
    wire.close()
    there.close()


GROUP, PORT = "239.74.163.78", 43113


@pytest.fixture(scope="module")
def loopback() -> Iterator[tuple[CanWire, socket.socket]]:
    """Yield an interface on the loopback, and a socket of another program there."""
    wire = open_wire(CanAddress("udp_multicast", GROUP))
    with can.Bus(interface="udp_multicast", channel=GROUP, hop_limit=0, fd=False) as other:
        keep_multicast_local(other.fileno(), GROUP)
        with socket.socket(fileno=os.dup(other.fileno())) as raw:
            yield wire, raw
    wire.close()


packable = nested(
    st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.binary(max_size=70)
)
_FIELDS = msgpack.unpackb(
    pack_message(can.Message(arbitration_id=0x111, data=bytes(8), is_extended_id=False))
)
messages = st.builds(
    lambda name, value, size: msgpack.packb({**_FIELDS, "dlc": size, "data": bytes(size), name: value}),
    st.sampled_from(sorted(_FIELDS)),
    packable | st.integers(-1, 2**32),
    st.integers(0, 70),
)


@example(datagrams=[msgpack.packb({**_FIELDS, "arbitration_id": 1.5})])
@given(datagrams=st.lists(st.binary(max_size=200) | messages | packable.map(msgpack.packb), max_size=8))
@TRIED
def test_any_datagram_on_the_loopback(
    loopback: tuple[CanWire, socket.socket], datagrams: list[bytes]
) -> None:
    """Whatever is no frame is dropped, and whatever is one comes out with data of a length that frames have."""
    wire, raw = loopback
    for datagram in datagrams:
        raw.sendto(datagram, (GROUP, PORT))
    for frame in wire.receive():
        can_id, data = unpack_frame(frame)
        assert len(data) <= 8
        assert can_id < EXTENDED << 1
