"""Cycles as bytes on the pipe between the loop and the writer: fixed-size, so that packing is copying.

    head    length u32 | commands u16 | outcomes u16 | kind u64        16 bytes, every record
    header  head, JSON                                                 once, first
    cycle   head, counter u64, arrays of both frames, commands, outcomes
    loss    head, counter u64, t_ns i64, n_cycles u64                  before the cycle that got through

The length counts the whole record. All little-endian. The counter numbers the cycles that were observed.
"""

import json
import struct
from collections.abc import Iterator, Mapping
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from footsense.errors import RecordingError
from footsense.frames import (
    ELEMENTS,
    CapFrame,
    Command,
    CommandKind,
    Cycle,
    ForceFrame,
    Outcome,
    Result,
    Zero,
)

__all__ = ["CyclePacker", "Loss", "Numbered", "pack_header", "pack_loss", "unpack"]

_HEAD = struct.Struct("<IHHQ")
_CYCLE_HEAD = struct.Struct("<IHHQQqqq")
_LOSS = struct.Struct("<IHHQQqQ")
_COMMAND = struct.Struct("<BB")
_OUTCOME = struct.Struct("<BBBH")
_MAX_REASON = 65_535

#: Longest record [bytes]: a cycle with more outcomes than there are commands to obey.
_MAX_RECORD = 1 << 24


class _Kind(IntEnum):
    HEADER = 0
    CYCLE = 1
    LOSS = 2


class Numbered(NamedTuple):
    """A cycle and its place in the recording.

    Attributes:
        counter: Number of the cycle since the recording began, lost ones counted.
        cycle: What happened in it.
    """

    counter: int
    cycle: Cycle


class Loss(NamedTuple):
    """Cycles that found the pipe full.

    Attributes:
        counter: Number of the next cycle that was recorded.
        t_ns: When that was sent [ns].
        n_cycles: How many were lost before it.
    """

    counter: int
    t_ns: int
    n_cycles: int


def _cycle_type(n_legs: int) -> np.dtype[np.void]:
    # The wide entries come first so that all are aligned.
    return np.dtype(
        [
            ("head", "V16"),
            ("counter", "<u8"),
            ("scan_sequence", "<i8"),
            ("force_sequence", "<i8"),
            ("t_sent_ns", "<i8"),
            ("scan_t_ns", "<i8", (n_legs, ELEMENTS)),
            ("capacitance_pf", "<f8", (n_legs, ELEMENTS)),
            ("force_t_ns", "<i8", (n_legs,)),
            ("force_n", "<f8", (n_legs, 3)),
            ("sigma_n", "<f8", (n_legs, 3)),
            ("zero_mean_pf", "<f8", (n_legs,)),
            ("zero_worst_pf", "<f8", (n_legs,)),
            ("zero_moved_ns", "<i8", (n_legs,)),
            ("fault_mask", "<u2", (n_legs,)),
            ("reading", "u1", (n_legs, ELEMENTS)),
            ("state", "u1", (n_legs,)),
            ("flags", "u1", (n_legs,)),
            ("cause", "u1", (n_legs,)),
            ("zero_status", "u1", (n_legs,)),
        ]
    )


class CyclePacker:
    """Packs cycles of one number of legs, always into the same buffer."""

    def __init__(self, n_legs: int) -> None:
        kind = _cycle_type(n_legs)
        self._buffer = bytearray(kind.itemsize)
        entry = np.frombuffer(self._buffer, dtype=kind)[0]
        self._arrays = {name: entry[name] for name in kind.names or () if isinstance(entry[name], np.ndarray)}

    def pack(self, counter: int, cycle: Cycle) -> bytes | bytearray:
        """Return one cycle as bytes, valid until the next call."""
        scan, commands, forces, outcomes = cycle
        zero = forces.zero
        arrays = self._arrays
        arrays["scan_t_ns"][...] = scan.t_ns
        arrays["capacitance_pf"][...] = scan.capacitance_pf
        arrays["reading"][...] = scan.reading
        arrays["force_t_ns"][...] = forces.t_ns
        arrays["force_n"][...] = forces.force_n
        arrays["sigma_n"][...] = forces.sigma_n
        arrays["state"][...] = forces.state
        arrays["fault_mask"][...] = forces.fault_mask
        arrays["flags"][...] = forces.flags
        arrays["cause"][...] = forces.cause
        arrays["zero_status"][...] = zero.status
        arrays["zero_mean_pf"][...] = zero.mean_pf
        arrays["zero_worst_pf"][...] = zero.worst_pf
        arrays["zero_moved_ns"][...] = zero.moved_ns
        tail = _pack_tail(commands, outcomes) if commands or outcomes else b""
        _CYCLE_HEAD.pack_into(
            self._buffer,
            0,
            len(self._buffer) + len(tail),
            len(commands),
            len(outcomes),
            _Kind.CYCLE,
            counter,
            scan.sequence,
            forces.sequence,
            forces.t_sent_ns,
        )
        return self._buffer + tail if tail else self._buffer


def _pack_tail(commands: tuple[Command, ...], outcomes: tuple[Outcome, ...]) -> bytes:
    parts = [_COMMAND.pack(*command) for command in commands]
    for command, result, words in outcomes:
        reason = words.encode(errors="backslashreplace")[:_MAX_REASON]
        parts += [_OUTCOME.pack(*command, result, len(reason)), reason]
    return b"".join(parts)


def pack_header(header: Mapping[str, str]) -> bytes:
    """Return the header as the first record."""
    data = json.dumps(dict(header)).encode()
    return _HEAD.pack(_HEAD.size + len(data), 0, 0, _Kind.HEADER) + data


def pack_loss(loss: Loss) -> bytes:
    """Return the record that says that cycles are missing here."""
    return _LOSS.pack(_LOSS.size, 0, 0, _Kind.LOSS, loss.counter, loss.t_ns, loss.n_cycles)


def unpack(buffer: bytearray, n_legs: int | None) -> Iterator[dict[str, str] | Numbered | Loss]:
    """Take every whole record out of the front of a buffer.

    Args:
        buffer: Bytes as they arrived; what is yielded is removed, an unfinished record stays.
        n_legs: Legs of the recording; None where only the header can come.

    Yields:
        The header, cycles and losses, in the order of the pipe.

    Raises:
        RecordingError: What arrived is not what this module writes.
    """
    try:
        while record := _next_record(buffer):
            _, n_commands, n_outcomes, kind = _HEAD.unpack_from(record)
            match _Kind(kind):
                case _Kind.HEADER:
                    header = json.loads(record[_HEAD.size :])
                    n_legs = len(header["legs"].split(","))
                    yield header
                case _Kind.LOSS:
                    yield Loss(*_LOSS.unpack(record)[4:])
                case _Kind.CYCLE:
                    yield _unpack_cycle(record, n_legs or 0, n_commands, n_outcomes)
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError, struct.error) as error:
        raise RecordingError(f"the cycles of the loop arrive damaged ({error})") from None


def _next_record(buffer: bytearray) -> bytes:
    """Take the first record out of a buffer.

    Returns:
        The record; nothing as long as it is not whole.

    Raises:
        ValueError: It has a length that no record has.
    """
    if len(buffer) < _HEAD.size:
        return b""
    length = _HEAD.unpack_from(buffer)[0]
    if not _HEAD.size <= length <= _MAX_RECORD:
        raise ValueError(f"a record of {length} bytes")
    if len(buffer) < length:
        return b""
    record = bytes(buffer[:length])
    del buffer[:length]
    return record


def _unpack_cycle(record: bytes, n_legs: int, n_commands: int, n_outcomes: int) -> Numbered:
    if n_legs == 0:
        raise ValueError("no header before the first cycle")
    kind = _cycle_type(n_legs)
    entry = np.frombuffer(record, dtype=kind, count=1)[0]
    scan = CapFrame(
        int(entry["scan_sequence"]), entry["scan_t_ns"], entry["capacitance_pf"], entry["reading"]
    )
    forces = ForceFrame(
        int(entry["force_sequence"]),
        int(entry["t_sent_ns"]),
        entry["force_t_ns"],
        entry["force_n"],
        entry["sigma_n"],
        entry["state"],
        entry["fault_mask"],
        entry["flags"],
        entry["cause"],
        Zero(entry["zero_status"], entry["zero_mean_pf"], entry["zero_worst_pf"], entry["zero_moved_ns"]),
    )
    at = kind.itemsize
    commands = []
    for _ in range(n_commands):
        which, leg = _COMMAND.unpack_from(record, at)
        commands.append(_command(which, leg, n_legs))
        at += _COMMAND.size
    outcomes = []
    for _ in range(n_outcomes):
        which, leg, result, length = _OUTCOME.unpack_from(record, at)
        at += _OUTCOME.size
        reason = record[at : at + length].decode(errors="replace")
        outcomes.append(Outcome(_command(which, leg, n_legs), Result(result), reason))
        at += length
    if at != len(record):
        raise ValueError(f"a cycle of {len(record)} bytes instead of {at}")
    return Numbered(int(entry["counter"]), Cycle(scan, tuple(commands), forces, tuple(outcomes)))


def _command(which: int, leg: int, n_legs: int) -> Command:
    if leg >= n_legs:
        raise ValueError(f"a command for leg {leg} of {n_legs}")
    return Command(CommandKind(which), leg)
