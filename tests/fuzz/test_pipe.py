"""The pipe between loop and writer, should either end go wrong."""

import json
import struct
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from footsense.errors import RecordingError
from footsense.frames import CommandResult, Result
from footsense.recording.pipe_format import Loss, Numbered, pack_cycle, pack_header, pack_loss
from footsense.recording.pipe_unpack import unpack
from footsense.recording.writer import PipeWriter
from tests.fuzz.outcome import TRIED, refusal
from tests.support.cycles import LEGS, TARE, cycle, same

SHOWN = cycle(3, outcomes=(CommandResult(TARE, Result.LOADED, "0.2 pF"),), n_samples=2, warm=True)
HEADER = pack_header({"legs": ",".join(LEGS)})
STREAM = HEADER + pack_cycle(0, SHOWN) + pack_loss(Loss(3, 5, 2))
heads = st.builds(
    struct.Struct("<IHHII").pack,
    st.sampled_from([0, 1, 15, 16, 40, 1486, 2**24, 2**32 - 1]),
    st.integers(0, 3) | st.just(65_535),
    st.integers(0, 3) | st.just(65_535),
    st.integers(0, 4),
    st.integers(0, 4),
)


@given(st.lists(heads | st.binary(max_size=60) | st.just(STREAM), max_size=6), st.none() | st.integers(1, 6))
@TRIED
def test_any_bytes(parts: list[bytes], n_legs: int | None) -> None:
    """They are records, or are refused; none is read twice, and a record that never ends waits."""
    buffer = bytearray(b"".join(parts))
    refusal(lambda: list(unpack(buffer, n_legs)), RecordingError)


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


def write(stream: bytes, fd: int) -> None:
    """Write a recording of what stands on the pipe."""
    writer = PipeWriter(fd)
    writer.feed(stream)
    writer.finish()


@given(st.dictionaries(st.text(max_size=5), st.text(max_size=9)) | st.text(max_size=9) | st.none())
@TRIED
def test_any_header(header: object) -> None:
    """Whatever JSON stands in its place."""
    data = json.dumps(header).encode()
    record = struct.pack("<IHHII", 16 + len(data), 0, 0, 0, 0) + data
    refusal(lambda: list(unpack(bytearray(record), None)), RecordingError)


def test_what_is_right_is_read() -> None:
    """What the tests above damage is right as it is."""
    _, numbered, loss = unpack(bytearray(STREAM), None)
    assert isinstance(numbered, Numbered)
    assert same(numbered.cycle, SHOWN)
    assert loss == Loss(3, 5, 2)
