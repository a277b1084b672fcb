"""Cycles out of the bytes of the pipe, checked: the loop's process may have gone wrong, the writer must not.

What is not what `pipe_format` writes ends the recording in one line.
"""

import json
import struct
from collections.abc import Iterator

import numpy as np

from footsense.errors import RecordingError
from footsense.frames import (
    ELEMENTS,
    BaselineDrift,
    CapFrame,
    Cause,
    Command,
    CommandKind,
    CommandResult,
    ContactFrame,
    Cycle,
    Reading,
    Reference,
    Result,
    State,
    ZeroStatus,
)
from footsense.recording.pipe_format import (
    COMMAND,
    HEAD,
    LOSS,
    OUTCOME,
    Extra,
    Kind,
    Loss,
    Numbered,
    cycle_type,
)
from footsense.recording.pipe_reference import unpack_reference

__all__ = ["unpack"]

#: Longest record [bytes]: a cycle with more outcomes than there are commands to obey.
_MAX_RECORD = 1 << 24

#: Largest code of each kind.
_CODES = {
    "state": max(State),
    "cause": max(Cause),
    "zero_status": max(ZeroStatus),
    "reading": max(Reading),
    "fault_mask": (1 << ELEMENTS) - 1,
}


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
            _, n_commands, n_outcomes, kind, extras = HEAD.unpack_from(record)
            match Kind(kind):
                case Kind.HEADER:
                    header = json.loads(record[HEAD.size :])
                    n_legs = len(header["legs"].split(","))
                    yield header
                case Kind.LOSS:
                    counter, t_ns, n_cycles = LOSS.unpack(record)[5:]
                    yield Loss(counter, _time(t_ns), n_cycles)
                case Kind.CYCLE:
                    yield _unpack_cycle(record, n_legs or 0, n_commands, n_outcomes, Extra(extras))
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError, struct.error) as error:
        raise RecordingError(f"the cycles of the loop arrive damaged ({error})") from None


def _next_record(buffer: bytearray) -> bytes:
    """Take the first record out of a buffer.

    Returns:
        The record; nothing as long as it is not whole.

    Raises:
        ValueError: It has a length that no record has.
    """
    if len(buffer) < HEAD.size:
        return b""
    length = HEAD.unpack_from(buffer)[0]
    if not HEAD.size <= length <= _MAX_RECORD:
        raise ValueError(f"a record of {length} bytes")
    if len(buffer) < length:
        return b""
    record = bytes(buffer[:length])
    del buffer[:length]
    return record


def _unpack_cycle(record: bytes, n_legs: int, n_commands: int, n_outcomes: int, extras: Extra) -> Numbered:
    if n_legs == 0:
        raise ValueError("no header before the first cycle")
    kind = cycle_type(n_legs)
    entry = np.frombuffer(record, dtype=kind, count=1)[0]
    for name, most in _CODES.items():
        if entry[name].max() > most:
            raise ValueError(f"{name} {entry[name].max()}, at most {most} has a meaning")
    scan = CapFrame(
        int(entry["scan_sequence"]), entry["scan_t_ns"], entry["capacitance_pf"], entry["reading"]
    )
    forces = ContactFrame(
        int(entry["force_sequence"]),
        _time(int(entry["t_sent_ns"])),
        entry["force_t_ns"],
        entry["force_n"],
        entry["sigma_n"],
        entry["state"],
        entry["fault_mask"],
        entry["flags"],
        entry["cause"],
        BaselineDrift(
            entry["zero_status"], entry["zero_mean_pf"], entry["zero_worst_pf"], entry["zero_moved_ns"]
        ),
    )
    at = kind.itemsize
    commands = []
    for _ in range(n_commands):
        which, leg = COMMAND.unpack_from(record, at)
        commands.append(_command(which, leg, n_legs))
        at += COMMAND.size
    outcomes = []
    for _ in range(n_outcomes):
        which, leg, result, length = OUTCOME.unpack_from(record, at)
        at += OUTCOME.size
        reason = record[at : at + length].decode(errors="replace")
        outcomes.append(CommandResult(_command(which, leg, n_legs), Result(result), reason))
        at += length
    reference: Reference | None = None
    if Extra.REFERENCE in extras:
        reference, at = unpack_reference(record, at)
    warm = n_legs if Extra.TEMPERATURE in extras else 0
    temperature_c = np.frombuffer(record, "<f8", warm, at) if warm else None
    at += 8 * warm
    if at != len(record):
        raise ValueError(f"a cycle of {len(record)} bytes instead of {at}")
    cycle = Cycle(scan, tuple(commands), forces, tuple(outcomes), reference, temperature_c)
    return Numbered(int(entry["counter"]), cycle)


def _time(t_ns: int) -> int:
    if t_ns < 0:
        raise ValueError(f"a time of {t_ns} ns")
    return t_ns


def _command(which: int, leg: int, n_legs: int) -> Command:
    if leg >= n_legs:
        raise ValueError(f"a command for leg {leg} of {n_legs}")
    return Command(CommandKind(which), leg)
