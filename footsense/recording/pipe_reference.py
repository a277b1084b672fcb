"""What a bench's force sensor said, at the end of the cycle's record on the pipe.

    n samples u32 | n x t_ns i64 | n x 3 force_n f64 | n x saturated u8

All little-endian. It stands in the record of its cycle, so that none is there without the other.
"""

import struct

import numpy as np

from footsense.frames import Reference

__all__ = ["pack_reference", "unpack_reference"]

_COUNT = struct.Struct("<I")
_SAMPLE_BYTES = 8 + 3 * 8 + 1


def pack_reference(reference: Reference) -> bytes:
    """Return samples as bytes, none of them too."""
    return b"".join(
        (
            _COUNT.pack(len(reference.t_ns)),
            reference.t_ns.astype("<i8").tobytes(),
            reference.force_n.astype("<f8").tobytes(),
            reference.saturated.astype("u1").tobytes(),
        )
    )


def unpack_reference(record: bytes, at: int) -> tuple[Reference, int]:
    """Return the samples at a place of a record, and the place behind them.

    Raises:
        ValueError: They are not what `pack_reference` writes.
    """
    n = _COUNT.unpack_from(record, at)[0]
    at += _COUNT.size
    if at + n * _SAMPLE_BYTES > len(record):
        raise ValueError(f"{n} samples of the reference in a record of {len(record)} bytes")
    t_ns = np.frombuffer(record, "<i8", n, at)
    force_n = np.frombuffer(record, "<f8", 3 * n, at + 8 * n).reshape(n, 3)
    saturated = np.frombuffer(record, "u1", n, at + 32 * n)
    if n and (t_ns.min() < 0 or saturated.max() > 1):
        raise ValueError("a sample of the reference has no such time or mark")
    return Reference(t_ns, force_n, saturated.astype(np.bool_)), at + n * _SAMPLE_BYTES
