"""The serial link: C and Python write the same records, and whatever becomes of the bytes, no wrong one is read."""

import ctypes
import json
import re
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_interface.serial_decoder import SerialDecoder
from firmware_interface.serial_frames import (
    FRAME_BYTES,
    MAX_STUFFED_BLOCK,
    NoValue,
    Record,
    RecordFlag,
    Sending,
    encode_record,
    encode_sending,
    pack_values,
    stuff,
)
from footsense.frames import Reading
from tests.contract import serial_vectors
from tests.contract.c_decoder import SOURCES, library

VECTORS = json.loads(serial_vectors.PATH.read_text())

records = st.builds(
    Record,
    leg=st.integers(1, 8),
    seq=st.integers(0, 0xFFFF),
    flags=st.builds(
        lambda flags, place: RecordFlag(flags | place << 4), st.integers(0, 3), st.integers(0, 8)
    ),
    step_us=st.integers(0, 0xFFFF),
    t_us=st.integers(0, 0xFFFFFFFF),
    values=st.lists(
        st.sampled_from([0, 1, 256, -1]) | st.integers(-(2**31), 2**31 - 1), min_size=9, max_size=9
    ).map(pack_values),
)


class _Record(ctypes.Structure):
    _fields_ = (
        ("leg", ctypes.c_uint8),
        ("flags", ctypes.c_uint8),
        ("seq", ctypes.c_uint16),
        ("step_us", ctypes.c_uint16),
        ("t_us", ctypes.c_uint32),
        ("value_af", ctypes.c_int32 * 9),
    )


def c_encodes(record: Record) -> bytes:
    """Return a record as C writes it; nothing if it refuses to."""
    values = (ctypes.c_int32 * 9)(*record.values_af())
    given = _Record(record.leg, record.flags, record.seq, record.step_us, record.t_us, values)
    out = ctypes.create_string_buffer(FRAME_BYTES)
    n_bytes: int = library().footsense_encode_record(ctypes.byref(given), out)
    return out.raw[:n_bytes]


def test_the_vectors_are_those_that_the_script_makes() -> None:
    """Nobody changed one without the other."""
    assert serial_vectors.document() == serial_vectors.PATH.read_text(encoding="utf-8")


@pytest.mark.parametrize("vector", VECTORS["records"], ids=lambda vector: vector["name"])
def test_both_write_the_vectors(vector: dict[str, Any]) -> None:
    """Byte for byte, and Python reads them again."""
    leg, seq, flags, step_us, t_us, values = vector["fields"]
    record = Record(leg, seq, RecordFlag(flags), step_us, t_us, pack_values(values))
    line = bytes.fromhex(vector["line"])
    assert encode_record(record) == c_encodes(record) == line
    assert SerialDecoder().feed(line) == [record]


@pytest.mark.parametrize("vector", VECTORS["streams"], ids=lambda vector: vector["name"])
@pytest.mark.parametrize("piece", [1, 7, 10_000])
def test_what_is_read_of_a_stream_and_what_is_counted(vector: dict[str, Any], piece: int) -> None:
    """However the bytes are cut into pieces."""
    decoder, line = SerialDecoder(), bytes.fromhex(vector["line"])
    read = [r for at in range(0, len(line), piece) for r in decoder.feed(line[at : at + piece])]
    assert [r.seq for r in read if isinstance(r, Record)] == vector["seqs"]
    assert decoder.losses == vector["losses"]


@given(st.integers(0, 2**32 - 1), st.text(st.characters(max_codepoint=127, min_codepoint=32), max_size=60))
def test_c_says_when_it_sends_as_python_does(t_us: int, text: str) -> None:
    """With any text; Python reads it."""
    line = encode_sending(Sending(t_us, text))
    out = ctypes.create_string_buffer(76)
    n_bytes: int = library().footsense_encode_sending(t_us, text.encode(), out)
    assert out.raw[:n_bytes] == line
    assert SerialDecoder().feed(b"\0" + line) == [Sending(t_us, text)]
    assert library().footsense_encode_sending(t_us, b"x" * 61, out) == 0


def test_the_check_of_the_crc_and_the_golden_bytes_of_the_stuffing() -> None:
    """The catalogue's check value, and the examples of the paper's kind."""
    assert library().footsense_crc16(b"123456789", 9) == 0x29B1
    for plain, stuffed in (("00", "0101"), ("1122", "031122"), ("110000", "02110101"), ("", "01")):
        assert stuff(bytes.fromhex(plain)).hex() == stuffed


@given(records)
def test_c_writes_what_python_writes(record: Record) -> None:
    """Any record; and Python reads it."""
    line = encode_record(record)
    assert c_encodes(record) == line
    assert len(line) == FRAME_BYTES
    assert line.index(0) == FRAME_BYTES - 1
    assert SerialDecoder().feed(line) == [record]


@pytest.mark.parametrize(("leg", "flags"), [(0, 0), (9, 0), (1, 4), (1, 8), (1, 0x90)])
def test_what_no_record_has_is_written_by_nobody_and_read_by_nobody(leg: int, flags: int) -> None:
    """C refuses; bytes that say so all the same are counted as another version's."""
    record = serial_vectors.record()._replace(leg=leg, flags=RecordFlag(flags))
    assert c_encodes(record) == b""
    decoder = SerialDecoder()
    assert decoder.feed(b"\0" + encode_record(record)) == []
    assert decoder.losses == {"version": 1}


@given(
    st.lists(records, min_size=1, max_size=6),
    st.data(),
)
def test_harm_never_makes_a_record_and_ends_at_the_next_zero(sent: list[Record], data: st.DataObject) -> None:
    """Bytes cut out, changed or added, in any pieces: what is read was sent, and behind the harm all of it is."""
    legs: dict[int, int] = {}
    for number, record in enumerate(sent):  # numbers in order, so that none is lost but by harm
        legs[record.leg] = legs.get(record.leg, -1) + 1
        sent[number] = record._replace(seq=legs[record.leg], flags=RecordFlag(0))
    line = b"".join(map(encode_record, sent))
    start = data.draw(st.integers(0, len(line)))
    end = data.draw(st.integers(start, min(start + 60, len(line))))
    put_in = data.draw(st.binary(max_size=2 * MAX_STUFFED_BLOCK))
    harmed = b"\0" + line[:start] + put_in + line[end:]
    decoder = SerialDecoder()
    read: list[Record | Sending] = []
    at = 0
    while at < len(harmed):
        size = data.draw(st.integers(1, len(harmed)))
        read += decoder.feed(harmed[at : at + size])
        at += size
    assert all(record in sent for record in read)
    n_touched = end // FRAME_BYTES + 1  # the last of them may have been joined by what was put in before it
    behind = sent[n_touched:]
    assert read[len(read) - len(behind) :] == behind


@given(st.lists(st.binary(max_size=600), max_size=8))
def test_garbage_is_never_held_nor_read(pieces: list[bytes]) -> None:
    """No crash, no record, and never more than a frame in memory."""
    decoder = SerialDecoder()
    for piece in pieces:
        assert decoder.feed(piece) == []
        assert len(decoder._rest) <= MAX_STUFFED_BLOCK


def test_a_line_that_was_interrupted_begins_anew() -> None:
    """Half a record from before and half a one from after are none."""
    line = encode_record(serial_vectors.record())
    decoder = SerialDecoder()
    assert len(decoder.feed(line + line[:30])) == 1
    decoder.reset()
    assert decoder.feed(line[20:]) == []
    assert not decoder.losses


def test_codes_mean_here_what_they_mean_there() -> None:
    """The codes of a record are those of a reading, and the names of C are those of Python."""
    assert {code.name: code.value for code in NoValue}.items() <= {r.name: r.value for r in Reading}.items()
    header = (SOURCES / "footsense_serial.h").read_text()
    named = {name: int(code) for name, code in re.findall(r"FOOTSENSE_(\w+) = (\d+)", header)}
    flags = {"LO_SHU": RecordFlag.LO_SHU.value, "RECORD_STARTING": RecordFlag.STARTING.value}
    assert named == flags | {code.name: code.value for code in NoValue}
