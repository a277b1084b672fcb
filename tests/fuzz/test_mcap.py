"""Recordings cut short, damaged, or forged with checksums that are right."""

import json
import random
import struct
import zlib
from pathlib import Path
from typing import Any

import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer

from footsense.daemon.recording_header import recorded_config
from footsense.errors import RecordingError
from footsense.frames import CommandResult, Result
from footsense.recording import messages
from footsense.recording.mcap_writer import HEADER_CRC_KEY, MCAP_PROFILE, METADATA_NAME, header_crc
from footsense.recording.replay import MAX_UNPACKED_REL, Replay
from tests.fuzz.outcome import NO_MESSAGE, TRIED, anything, judged_with_little_memory, refusal
from tests.support.cycles import LEGS, TARE, cycle, read_until_damage, same, write

CYCLES = [cycle(number, n_samples=2) for number in range(12)]
HEADER = {"legs": ",".join(LEGS)}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Return a recording of three chunks."""
    return write(tmp_path_factory.mktemp("mcap") / "walk.mcap", CYCLES, every=4).read_bytes()


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "walk.mcap"


def judge(path: Path) -> None:
    """Read a file: what comes is what was recorded, what does not come is said."""

    def read() -> None:
        found, damage = read_until_damage(path)
        assert all(same(a, b) for a, b in zip(CYCLES, found, strict=False))
        assert damage is not None or len(found) == len(CYCLES)

    refusal(read)


@given(data=st.data())
@TRIED
def test_damaged_anywhere(file: Path, whole: bytes, data: st.DataObject) -> None:
    """Flipped bits, bytes set, pieces repeated or left out, and any of it, or the whole, cut short."""
    damaged = bytearray(whole)
    for _ in range(data.draw(st.integers(0, 3))):
        at = data.draw(st.integers(0, len(damaged) - 1))
        length = data.draw(st.integers(1, 200))
        match data.draw(st.integers(0, 3)):
            case 0:
                damaged[at] ^= 1 << data.draw(st.integers(0, 7))
            case 1:
                number = data.draw(st.sampled_from([0, 1, 2**31, 2**40, 2**64 - 1]))
                damaged[at : at + 8] = struct.pack("<Q", number)
            case 2:
                del damaged[at : at + length]
            case _:
                damaged[at:at] = damaged[at : at + length]
    for cut in (len(damaged), data.draw(st.integers(0, len(damaged)))):
        file.write_bytes(damaged[:cut])
        judge(file)


def forged(path: Path, records: list[tuple[str, bytes]], header: dict[str, str] | None = None) -> Path:
    """Write a recording whose checksums are right, whatever its messages say."""
    header = HEADER if header is None else header
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD, enable_data_crcs=True)
        writer.start(profile=MCAP_PROFILE)
        writer.add_metadata(METADATA_NAME, {**header, HEADER_CRC_KEY: header_crc(header)})
        channels = {topic: writer.register_channel(topic, "json", 0) for topic in (*messages.ENCODERS, "/x")}
        for topic, data in records:
            writer.add_message(channels[topic], log_time=0, publish_time=0, sequence=0, data=data)
        writer.finish()
    return path


def good_messages() -> list[tuple[str, Any]]:
    """Return topic and content of each message of a cycle that has every kind of them."""
    outcome = CommandResult(TARE, Result.DONE, "0.1 pF")
    shown = cycle(31, n_samples=1, warm=True, outcomes=(outcome,))
    return [
        (topic, json.loads(data))
        for topic, encode in messages.ENCODERS.items()
        for _, data in encode(shown, LEGS)
    ]


@given(data=st.data())
@TRIED
def test_forged_messages(file: Path, data: st.DataObject) -> None:
    """One value of a good scan, force, sample or event replaced by any other, then a whole message."""
    good = good_messages()
    which, value = data.draw(st.integers(0, len(good) - 1)), data.draw(anything)
    topic, message = good[which]
    inner = data.draw(st.sampled_from([None, *message]))
    if inner is None:
        message = value
    elif isinstance(message[inner], dict):
        message[inner][data.draw(st.sampled_from(sorted(message[inner])))] = value
    else:
        message[inner] = value
    good[which] = topic, message
    forged(file, [(topic, json.dumps(message).encode()) for topic, message in good])
    refusal(lambda: list(Replay(file)))


@pytest.mark.parametrize("topic", [*messages.ENCODERS, "/x"])
def test_forged_json(file: Path, topic: str) -> None:
    """Nesting and numbers without end, and JSON that is no message."""
    for data in ("\xff", *NO_MESSAGE):
        forged(file, [(topic, data.encode("latin-1"))])
        refusal(lambda: list(Replay(file)))


@given(st.dictionaries(st.sampled_from(["legs", "config", "flags", "x"]), st.text(max_size=20), max_size=4))
@TRIED
def test_forged_headers(file: Path, header: dict[str, str]) -> None:
    """Legs that do not exist, twice or not at all."""
    said = refusal(lambda: Replay(forged(file, [], header)))
    assert said is None or "legs" in said


def test_a_chunk_that_unpacks_to_gigabytes(file: Path, whole: bytes) -> None:
    """Refused by its sizes, under a limit of memory, whichever of them lies."""
    packer = zstandard.ZstdCompressor(level=1).compressobj(size=1 << 31)
    million = bytes(1 << 20)
    bomb = b"".join(packer.compress(million) for _ in range(1 << 11)) + packer.flush()
    for declared, says in ((100, "not packed as it says"), (1 << 31, "larger than any")):
        file.write_bytes(with_chunk(whole, bomb, declared))
        (line,) = judged_with_little_memory(200, file)
        assert f"refused: {file}" in line
        assert says in line


def test_an_error_that_quotes_a_recorded_configuration_is_short(file: Path) -> None:
    """Whoever sends a recording does not fill a terminal: 70 kB of a name that nobody knows."""
    config = json.dumps({"board": 70_000 * "z", "can": {"interface": "virtual"}})
    with pytest.raises(RecordingError) as caught:
        recorded_config(Replay(forged(file, [], HEADER | {"config": config})))
    said = str(caught.value)
    assert len(said) < 1000
    assert said.startswith(f"{file}: no configuration that this version reads: ")
    assert said.endswith("zzz' - at `$.board`")


def test_a_file_that_unpacks_to_a_thousand_times_its_size(file: Path, whole: bytes) -> None:
    """Refused at its first such chunk: a file of 250 kB would be read for 40 s."""
    event = record(5, struct.pack("<HIQQ", 1, 0, 0, 0) + b"{}" + b" " * 1_000_000)
    file.write_bytes(with_chunk(whole, zstandard.ZstdCompressor().compress(event), len(event)))
    said = refusal(lambda: list(Replay(file)))
    assert said is not None
    assert "a chunk is packed closer than any that is written" in said


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def channel(number: int, topic: str) -> bytes:
    return record(4, struct.pack("<HHI", number, 0, len(topic)) + topic.encode() + struct.pack("<II", 0, 0))


def message(channel_number: int, data: bytes) -> bytes:
    return record(5, struct.pack("<HIQQ", channel_number, 0, 0, 0) + data)


REFERENCE = channel(1, messages.REFERENCE)
#: Chunks of few bytes that take much memory or time, how often each comes, and what is said of it.
BOMBS = {
    "spaces around a gait": (
        [channel(1, messages.GAIT) + message(1, b" " * 1_000_000)],
        6,
        "a cycle is larger",
    ),
    "samples": ([REFERENCE + 4000 * message(1, b"{}")], 6, "a cycle is larger"),
    "channels": ([40_000 * channel(1, "")], 1, "more records"),
    "records of no kind": ([110_000 * record(0x80, b"")], 1, "more records"),
    "topics": ((channel(n, f"{n}" * 180_000) for n in range(100, 140)), 1, "0 cycles are whole"),
    "a chunk": ([bytes(2 << 20)], 1, "a chunk is larger"),
}


@pytest.mark.parametrize("kind", BOMBS)
def test_a_few_bytes_do_not_take_memory(file: Path, whole: bytes, kind: str) -> None:
    """Packed as well as may be: refused, in the memory that any recording may take."""
    chunks, n, says = BOMBS[kind]
    head, packed = whole[: first_chunk(whole)], []
    for bomb in chunks:
        padding = random.Random(0).randbytes(len(bomb) // (MAX_UNPACKED_REL - 4))
        data = bomb + record(0x80, padding)
        compressed = zstandard.compress(data)
        content = struct.pack("<QQQII", 0, 1, len(data), zlib.crc32(data), 4) + b"zstd"
        packed.append(record(6, content + struct.pack("<Q", len(compressed)) + compressed))
    file.write_bytes(head + n * b"".join(packed))
    assert file.stat().st_size < 500_000
    (line,) = judged_with_little_memory(100, file)
    assert says in line


def test_a_time_that_no_run_reaches_is_damage(file: Path) -> None:
    """A clock that jumps by years, goes back, or stands where its sum with the time since 1970 has no 64 bits."""
    for t_ns, n_whole in ((2**59, 3), (0, 3), (2**61, 3)):
        late = [*CYCLES[:3], CYCLES[3]._replace(forces=CYCLES[3].forces._replace(t_sent_ns=t_ns))]
        found, damage = read_until_damage(write(file, late))
        assert (len(found), "3 cycles are whole" in str(damage)) == (n_whole, True)


def first_chunk(whole: bytes) -> int:
    """Return where the first chunk of a recording begins."""
    at = 8
    while whole[at] != 0x06:  # opcode, length, content
        at += 9 + struct.unpack_from("<Q", whole, at + 1)[0]
    return at


def with_chunk(whole: bytes, packed: bytes, declared: int) -> bytes:
    """Return a recording whose first chunk is replaced."""
    at = first_chunk(whole)
    name = b"zstd"
    content = struct.pack("<QQQII", 0, 1, declared, 0xDEADBEEF, len(name)) + name
    return whole[:at] + record(6, content + struct.pack("<Q", len(packed)) + packed)
