"""Makes `firmware_interface/vectors/serial.json`: records as fields and bytes, and streams with what comes of them.

The bytes of the records come from the encoder, and C has to meet them; what remains of a stream that was harmed is said
here by hand, for a decoder in any language. Make them anew with `python -m tests.contract.serial_vectors`.
"""

import json
from pathlib import Path

from firmware_interface.serial_frames import (
    NO_VALUE_BASE,
    NoValue,
    Record,
    RecordFlag,
    encode_record,
    pack_values,
)

__all__ = ["PATH", "document"]

PATH = Path(__file__).parents[2] / "firmware_interface/vectors/serial.json"

AT_REST_AF = tuple(range(5_387_000, 5_396_000, 1000))
ZEROS_AF = (0, 1, 256, 65_536, 16_777_216, -1, 2**31 - 1, -16_777_216, 0)
BROKEN_AF = tuple(NO_VALUE_BASE + code for code in (*NoValue, NoValue.NO_ANSWER))


def record(seq: int = 0, leg: int = 1, flags: int = 0, values: tuple[int, ...] = AT_REST_AF) -> Record:
    """Return a record, one of a scan at 200 Hz."""
    return Record(leg, seq, RecordFlag(flags), 500, 1_000_000 + 5000 * seq & 0xFFFFFFFF, pack_values(values))


RECORDS = {
    "at rest": record(),
    "every field at its end": Record(
        6, 65_535, RecordFlag(0x83), 65_535, 2**32 - 1, pack_values([2**31 - 1] * 9)
    ),
    "zeros everywhere": Record(1, 0, RecordFlag(0), 0, 0, pack_values([0] * 9)),
    "values with zeros in all their bytes": record(257, 3, RecordFlag.LO_SHU, ZEROS_AF),
    "no value, for every reason": record(5, 4, RecordFlag.STARTING, BROKEN_AF),
    "begun at the eighth place of the order": record(6, 2, RecordFlag.LO_SHU | 7 << 4),
}


def _line(*seqs: int, flags: int = 0) -> bytes:
    return b"".join(encode_record(record(seq, flags=flags)) for seq in seqs)


def _harmed(data: bytes, at: int) -> bytes:
    return data[:at] + bytes((data[at] ^ 0x40 or 1,)) + data[at + 1 :]


STARTING = RecordFlag.STARTING

#: Name, bytes, the numbers of the records that come out, and what is counted.
STREAMS: tuple[tuple[str, bytes, list[int], dict[str, int]], ...] = (
    ("in order", _line(0, 1, 2), [0, 1, 2], {}),
    ("begun in the middle", _line(0)[20:] + _line(1, 2), [1, 2], {}),
    ("idle zeros", b"\0\0" + _line(0) + b"\0\0\0" + _line(1), [0, 1], {}),
    ("the numbers wrap", _line(65_534, 65_535, 0), [65_534, 65_535, 0], {}),
    ("two are missing", _line(0, 3), [0, 3], {"lost": 2}),
    ("one comes twice", _line(0, 1, 1, 2), [0, 1, 2], {"repeated": 1}),
    ("a byte is wrong", _line(0) + _harmed(_line(1), 30) + _line(2), [0, 2], {"crc": 1, "lost": 1}),
    ("a byte is missing", _line(0) + _line(1)[1:] + _line(2), [0, 2], {"length": 1, "lost": 1}),
    ("the zero is missing", _line(0) + _line(1)[:-1] + _line(2, 3), [0, 3], {"length": 1, "lost": 2}),
    ("no zero for long", _line(0) + bytes([7]) * 300 + b"\0" + _line(1), [0, 1], {"overflow": 300}),
    (
        "the controller started again",
        _line(40_000) + _line(0)[:17] + b"\0" + _line(1, 2, flags=STARTING) + _line(256),
        [40_000, 1, 2, 256],
        {"length": 1, "restarts": 1, "lost": 253},
    ),
    (
        "it started twice",
        _line(0, 1, 2, flags=STARTING) + _line(0, 1, flags=STARTING),
        [0, 1, 2, 0, 1],
        {"restarts": 1},
    ),
    ("one comes twice while it starts", _line(0, 1, 1, 2, flags=STARTING), [0, 1, 2], {"repeated": 1}),
    ("one comes three times", _line(5, 5, 5, 6), [5, 6], {"repeated": 2}),
    (
        "the first record after a start has the number of the last before it",
        _line(7) + _line(7, 8, flags=STARTING),
        [7, 7, 8],
        {"restarts": 1},
    ),
    (
        "no zero for long, twice",
        (_line(0) + bytes([7]) * 300 + b"\0") * 2 + _line(1),
        [0, 1],
        {"overflow": 600, "repeated": 1},
    ),
)


def document() -> str:
    """Return the file's text."""
    about = (
        "Records of the serial link as fields (leg, seq, flags, step_us, t_us, nine values in aF) and as bytes on the "
        "line; and streams with the numbers of the records that are to come out of them, and what is to be counted."
    )
    records = [
        json.dumps(
            {"name": name, "fields": [*one[:5], list(one.values_af())], "line": encode_record(one).hex()}
        )
        for name, one in RECORDS.items()
    ]
    streams = [
        json.dumps({"name": name, "line": line.hex(), "seqs": seqs, "losses": losses})
        for name, line, seqs, losses in STREAMS
    ]
    lists = [
        f' "{name}": [\n  ' + ",\n  ".join(entries) + "\n ]"
        for name, entries in (("records", records), ("streams", streams))
    ]
    return f'{{\n "about": {json.dumps(about)},\n' + ",\n".join(lists) + "\n}\n"


if __name__ == "__main__":
    PATH.write_text(document(), encoding="utf-8")
