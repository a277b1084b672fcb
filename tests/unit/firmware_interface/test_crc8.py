from itertools import combinations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_interface.can.crc8 import FrameError, check_frame_and_get_counter, crc8, next_counter, protect


def test_the_published_vectors_hold() -> None:
    """The check string of the polynomial 0x1D with start 0, and the profile's vector for data id 0x0123."""
    assert crc8(b"123456789") == 0x37
    assert protect(0x0123, bytes(7)) == bytes([0xCC]) + bytes(7)


def test_one_or_two_wrong_bits_are_always_found() -> None:
    """No frame differs from a right one in one or two of its 64 bits."""
    frame = int.from_bytes(protect(0x109, bytes.fromhex("17 e8 03 01 80 ff 7f")), "little")
    flips = [1 << bit for bit in range(64)]
    for flip in flips + [first | second for first, second in combinations(flips, 2)]:
        with pytest.raises(FrameError, match="crc"):
            check_frame_and_get_counter(0x109, (frame ^ flip).to_bytes(8, "little"), 8)


@given(st.binary(min_size=7, max_size=7), st.integers(0, 48), st.integers(1, 0xFF))
def test_a_burst_of_eight_bits_is_always_found(payload: bytes, shift: int, burst: int) -> None:
    """Any change within eight bits in a row behind the crc, in the order of the wire, makes it wrong."""
    frame = int.from_bytes(protect(0x119, payload), "big") ^ burst << shift
    with pytest.raises(FrameError, match="crc"):
        check_frame_and_get_counter(0x119, frame.to_bytes(8, "big"), 8)


@given(st.binary(min_size=7, max_size=7))
def test_a_frame_under_another_legs_id_is_wrong(payload: bytes) -> None:
    """The id is part of the crc: no leg's frame passes for another leg's."""
    for node, other in combinations(range(1, 9), 2):
        with pytest.raises(FrameError, match="crc"):
            check_frame_and_get_counter(0x108 + other, protect(0x108 + node, payload), 8)


def test_the_counter_runs_from_0_to_14_and_15_is_refused() -> None:
    """After 14 comes 0; 15 means a fault of the sender."""
    assert [next_counter(counter) for counter in (0, 13, 14)] == [1, 14, 0]
    assert check_frame_and_get_counter(0x109, protect(0x109, bytes([14])), 2) == 14
    with pytest.raises(FrameError, match="counter 15"):
        check_frame_and_get_counter(0x109, protect(0x109, bytes([15])), 2)


def test_a_frame_of_another_length_is_refused() -> None:
    """A frame cut short or made longer is not looked into."""
    with pytest.raises(FrameError, match="2 bytes instead of 8"):
        check_frame_and_get_counter(0x109, b"ab", 8)
