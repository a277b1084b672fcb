"""Cycles as bytes on the pipe between the loop and the writer: fixed-size, so that packing is copying.

    head    length u32 | commands u16 | outcomes u16 | kind u32 | extras u32        16 bytes, every record
    header  head, JSON                                                 once, first
    cycle   head, counter u64, arrays of both frames, commands, outcomes, extras
    loss    head, counter u64, t_ns i64, n_cycles u64                  before the cycle that got through

Extras are what few cycles have: on a bench the samples of its reference, and the legs' temperatures, f64 each.

The length counts the whole record. All little-endian. The counter numbers the cycles that were observed.
"""

import json
import struct
from collections.abc import Mapping
from enum import STRICT, IntEnum, IntFlag
from typing import NamedTuple

import numpy as np

from footsense.frames import ELEMENTS, Command, CommandResult, Cycle
from footsense.recording.pipe_reference import pack_reference

__all__ = [
    "COMMAND",
    "HEAD",
    "LOSS",
    "OUTCOME",
    "Extra",
    "Kind",
    "Loss",
    "Numbered",
    "cycle_type",
    "pack_cycle",
    "pack_header",
    "pack_loss",
]

HEAD = struct.Struct("<IHHII")
_CYCLE_HEAD = struct.Struct("<IHHIIQqqq")
LOSS = struct.Struct("<IHHIIQqQ")
COMMAND = struct.Struct("<BB")
OUTCOME = struct.Struct("<BBBH")
_MAX_REASON = 65_535


class Kind(IntEnum):
    """What a record is."""

    HEADER = 0
    CYCLE = 1
    LOSS = 2


class Extra(IntFlag, boundary=STRICT):
    """What stands behind a cycle, in this order."""

    REFERENCE = 1  #: the samples of a reference, even if there are none
    TEMPERATURE = 2


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


def cycle_type(n_legs: int) -> np.dtype[np.void]:
    """Return the layout of a cycle up to its commands; the wide entries come first so that all are aligned."""
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


def pack_cycle(counter: int, cycle: Cycle) -> bytes:
    """Return one cycle as bytes: the arrays of its frames behind each other, as `cycle_type` has them."""
    scan, commands, forces, outcomes, reference, temperature_c = cycle
    zero = forces.baseline
    arrays = (
        *(scan.t_ns, scan.capacitance_pf),
        *(forces.t_ns, forces.force_n, forces.sigma_n),
        *(zero.mean_pf, zero.worst_pf, zero.moved_ns),
        *(forces.fault_mask, scan.reading, forces.state, forces.flags, forces.cause, zero.status),
    )
    parts = [array.tobytes() for array in arrays]
    if commands or outcomes:
        parts.append(_pack_tail(commands, outcomes))
    extras = 0
    if reference is not None:
        extras |= Extra.REFERENCE
        parts.append(pack_reference(reference))
    if temperature_c is not None:
        extras |= Extra.TEMPERATURE
        parts.append(temperature_c.astype("<f8").tobytes())
    body = b"".join(parts)
    head = _CYCLE_HEAD.pack(
        _CYCLE_HEAD.size + len(body),
        *(len(commands), len(outcomes), Kind.CYCLE, extras, counter),
        *(scan.sequence, forces.sequence, forces.t_sent_ns),
    )
    return head + body


def _pack_tail(commands: tuple[Command, ...], outcomes: tuple[CommandResult, ...]) -> bytes:
    parts = [COMMAND.pack(*command) for command in commands]
    for command, result, words in outcomes:
        reason = words.encode(errors="backslashreplace")[:_MAX_REASON]
        parts += [OUTCOME.pack(*command, result, len(reason)), reason]
    return b"".join(parts)


def pack_header(header: Mapping[str, str]) -> bytes:
    """Return the header as the first record."""
    data = json.dumps(dict(header)).encode()
    return HEAD.pack(HEAD.size + len(data), 0, 0, Kind.HEADER, 0) + data


def pack_loss(loss: Loss) -> bytes:
    """Return the record that says that cycles are missing here."""
    return LOSS.pack(LOSS.size, 0, 0, Kind.LOSS, 0, loss.counter, loss.t_ns, loss.n_cycles)
