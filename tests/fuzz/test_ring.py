"""The ring, should its writer go wrong or be somebody else."""

import fcntl
import json
import struct
from contextlib import closing
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from footsense.frames import CommandResult, Result
from footsense.ring.cycle_reader import CycleReader
from footsense.ring.cycle_ring import CycleRing, encode_cycle
from footsense.ring.records import NumberedCycle, decode_record
from footsense.ring.ring_file import MAGIC
from tests.fuzz.outcome import TRIED, anything, nested, refusal
from tests.support.cycles import LEGS, TARE, cycle, status

SHOWN = cycle(3, outcomes=(CommandResult(TARE, Result.LOADED, "0.2 pF"),), n_samples=2, warm=True)
FIELDS = msgspec.msgpack.decode(encode_cycle(0, SHOWN))
STATUS = msgspec.msgpack.decode(msgspec.msgpack.encode(status()))
packable = nested(
    st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.binary(max_size=9)
)


def decoded(fields: object) -> str | None:
    """Decode a record of any fields; return the refusal."""
    return refusal(lambda: decode_record(msgspec.msgpack.encode(fields), len(LEGS)))


@given(st.binary(max_size=200) | packable.map(msgspec.msgpack.encode), st.integers(1, 8))
@TRIED
def test_any_bytes(record: bytes, n_legs: int) -> None:
    refusal(lambda: decode_record(record, n_legs))


@given(st.sampled_from([FIELDS, STATUS]), st.integers(1), packable)
@TRIED
def test_any_field(fields: list[object], place: int, value: object) -> None:
    """Each field of a cycle or a status in turn is something else: refused, or it may be so."""
    place = 1 + place % (len(fields) - 1)
    decoded([*fields[:place], value, *fields[place + 1 :]])


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
    assert decoded([*FIELDS[:place], value, *FIELDS[place + 1 :]])
    assert not decoded(FIELDS)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Return a file with some cycles, as far as they go."""
    path = tmp_path_factory.mktemp("ring") / "ring"
    with closing(CycleRing(path, LEGS, {}, 1.0, status)) as ring:
        for number in range(5):
            ring.observe(cycle(number, warm=True, n_samples=2))
        return path.read_bytes()


def read(path: Path, content: bytes) -> str | None:
    """Read a file as if a service wrote it."""
    path.write_bytes(content)

    def reading() -> None:
        with closing(CycleReader(path)) as reader:
            reader.rewind()
            for number in range(7):
                for entry in reader.read():
                    assert not isinstance(entry, NumberedCycle) or entry.cycle_number < 5
                    assert number < 6

    with path.open("rb") as running:
        fcntl.flock(running, fcntl.LOCK_EX)
        return refusal(reading)


@given(data=st.data())
@TRIED
def test_any_ring(tmp_path: Path, whole: bytes, data: st.DataObject) -> None:
    """Bytes set in counters, header and records, and cuts: refused, or no more cycles than there are."""
    changed = bytearray(whole)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, 60) | st.integers(4096, 12_000))
        if data.draw(st.booleans()):
            changed[at] = data.draw(st.integers(0, 255))
        else:
            number = data.draw(st.sampled_from([0, 1, 511, 3 << 30, 2**63, 2**64 - 1]))
            changed[at // 8 * 8 : at // 8 * 8 + 8] = struct.pack("<Q", number)
    read(tmp_path / "ring", bytes(changed))
    read(tmp_path / "ring", whole[: data.draw(st.integers(0, 12_000))])
    assert read(tmp_path / "ring", whole) is None


@given(anything | st.just({"legs": "lf"}) | st.sampled_from(["lf,lf", "lf,", "", "body"]))
@TRIED
def test_any_header(tmp_path: Path, header: object) -> None:
    """JSON of any kind in its place, and legs that no robot has."""
    text = json.dumps({"legs": header} if isinstance(header, str) else header).encode()
    content = struct.pack("<8s4Q", MAGIC, 0, 0, 0, len(text)) + text
    read(tmp_path / "ring", content + bytes(1 << 17))
