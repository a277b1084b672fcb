"""The pipe between loop and writer, should either end go wrong."""

from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from footsense.errors import RecordingError
from footsense.frames import CommandResult, Result
from footsense.recording.cycle_pipe import pack_cycle, pack_header, pack_loss
from footsense.recording.cycle_records import LostCycles, NumberedCycle, unpack_records
from footsense.recording.writer import RecordingWriter
from tests.fuzz.outcome import TRIED, refusal
from tests.support.cycles import LEGS, TARE, cycle, same

SHOWN = cycle(3, outcomes=(CommandResult(TARE, Result.LOADED, "0.2 pF"),), n_samples=2, warm=True)
HEADER = pack_header({"legs": ",".join(LEGS)})
STREAM = HEADER + pack_cycle(0, SHOWN) + pack_loss(LostCycles(3, 5, 2))
FIELDS = msgspec.msgpack.decode(pack_cycle(0, SHOWN)[4:])


def framed(record: object) -> bytes:
    """Return any object as a record of the pipe."""
    data = msgspec.msgpack.encode(record)
    return len(data).to_bytes(4, "little") + data


anything = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.binary(max_size=9),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=6,
) | st.text(max_size=9)
lengths = st.sampled_from([0, 1, 15, 1486, 2**24, 2**32 - 1]).map(lambda length: length.to_bytes(4, "little"))
some_legs = st.integers(1, 6).map(lambda n: LEGS[:n])
heads = lengths | st.lists(anything, max_size=4).map(framed)


@given(st.lists(heads | st.binary(max_size=60) | st.just(STREAM), max_size=6), st.none() | some_legs)
@TRIED
def test_any_bytes(parts: list[bytes], legs: tuple[str, ...] | None) -> None:
    """They are records, or are refused; none is read twice, and a record that never ends waits."""
    buffer = bytearray(b"".join(parts))
    refusal(lambda: list(unpack_records(buffer, legs)), RecordingError)


@given(st.data())
@TRIED
def test_a_flipped_byte(tmp_path: Path, data: st.DataObject) -> None:
    """The writer ends with one line, or has written what it understood."""
    damaged = bytearray(STREAM)
    # Most of a cycle are numbers that may be anything; the codes stand behind them.
    at = data.draw(st.integers(0, len(STREAM) - 1) | st.integers(len(STREAM) - 140, len(STREAM) - 1))
    damaged[at] = data.draw(st.integers(0, 255))
    with (tmp_path / "walk.mcap").open("wb") as file:
        refusal(lambda: write(bytes(damaged), file.fileno()), RecordingError)


@pytest.mark.parametrize("legs", ["lf,lf", "lf,", "", "body"])
def test_legs_that_a_recording_cannot_have(legs: str) -> None:
    """Twice, or none of a robot's: a reader would refuse the recording."""
    stream = bytearray(pack_header({"legs": legs}))
    assert refusal(lambda: list(unpack_records(stream, None)), RecordingError)


def write(stream: bytes, fd: int) -> None:
    """Write a recording of what stands on the pipe."""
    writer = RecordingWriter(fd)
    writer.feed(stream)
    writer.finish()


@given(anything)
@TRIED
def test_any_header(header: object) -> None:
    """Whatever stands in its place."""
    refusal(lambda: list(unpack_records(bytearray(framed(["header", header])), None)), RecordingError)


@given(st.integers(1, len(FIELDS) - 1), anything)
@TRIED
def test_any_field_of_a_cycle(place: int, value: object) -> None:
    """Each field in turn is something else: refused, or it may be so."""
    fields = [*FIELDS[:place], value, *FIELDS[place + 1 :]]
    refusal(lambda: list(unpack_records(bytearray(HEADER + framed(fields)), None)), RecordingError)


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (5, bytes(len(FIELDS[5]) - 1)),
        (5, b"\xff" * len(FIELDS[5])),
        (6, [[1, 6]]),
        (6, [[9, 0]]),
        (7, [[[1, -1], 0, ""]]),
        (7, [[[1, 0], 99, ""]]),
        (8, [bytes(8), bytes(24), b""]),
        (8, [bytes(8), bytes(16), bytes(1)]),
        (8, [b"\xff" * 8, bytes(24), bytes(1)]),
        (8, [bytes(8), bytes(24), bytes([2])]),
        (9, bytes(8)),
        (9, bytes(7)),
    ],
)
def test_a_field_without_a_meaning_is_refused(place: int, value: object) -> None:
    """Codes and legs that do not exist, arrays that are too short, times before the start."""
    fields = [*FIELDS[:place], value, *FIELDS[place + 1 :]]
    assert refusal(lambda: list(unpack_records(bytearray(HEADER + framed(fields)), None)), RecordingError)


def test_what_is_right_is_read() -> None:
    """What the tests above damage is right as it is."""
    _, numbered, loss = unpack_records(bytearray(STREAM), None)
    assert isinstance(numbered, NumberedCycle)
    assert same(numbered.cycle, SHOWN)
    assert loss == LostCycles(3, 5, 2)
