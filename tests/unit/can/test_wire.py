"""Frames through a socket, over a socket pair that keeps the bounds of messages as a CAN socket does."""

import errno
import socket
from collections.abc import Iterator

import pytest

from firmware_interface.can.socketcan import pack_frame
from footsense.wires.socket_wire import SocketWire

Pair = tuple[SocketWire, socket.socket]


@pytest.fixture
def pair() -> Iterator[Pair]:
    """A wire and the socket at its other end."""
    here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    there.setblocking(False)
    wire = SocketWire(here)
    yield wire, there
    wire.close()
    there.close()


def frames(n: int) -> list[bytes]:
    """Return frames whose data tell their place."""
    return [pack_frame(0x109, bytes([k])) for k in range(n)]


def test_a_full_queue_takes_the_first_frames_and_the_next_call_none(pair: Pair) -> None:
    """It neither waits nor raises, and what was taken is whole; with room again it takes all."""
    wire, there = pair
    taken = [wire.send(frames(50)) for _ in range(40)]
    first_cut = next(n for n, k in enumerate(taken) if k < 50)
    assert taken[first_cut + 1 :] == [0] * (39 - first_cut)
    arrived = [there.recv(64) for _ in range(sum(taken))]
    assert arrived == [frame for n in taken for frame in frames(n)]
    assert wire.send(frames(2)) == 2


def test_a_dead_socket_is_told_with_its_errno(pair: Pair) -> None:
    """The channel decides by it what to do."""
    wire, there = pair
    there.close()
    with pytest.raises(OSError) as caught:
        wire.send(frames(1))
    assert caught.value.errno == errno.EPIPE
    assert wire.receive() == []


def test_all_that_has_arrived_is_received_and_then_nothing(pair: Pair) -> None:
    """Frames come as they were sent, and an empty socket is no error."""
    wire, there = pair
    for frame in frames(3):
        there.send(frame)
    assert wire.receive() == frames(3)
    assert wire.receive() == []
