"""Write end of the pipe that carries cycles from the main loop to the recorder's child process.

In virtual time the loop waits for room and nothing is lost. In real time it never waits: a cycle that finds the pipe
full is lost, counted, and its loss recorded before the next cycle that finds room.
"""

import os
import select
from collections.abc import Callable, Mapping
from operator import attrgetter

import msgspec
import numpy as np

from footsense.frames import Cycle, GaitFrame
from footsense.recording.cycle_records import (
    CYCLE_ARRAY_ORDER,
    GAIT_ARRAY_ORDER,
    LENGTH_PREFIX_BYTES,
    Header,
    LostCycles,
)

#: Longest reason of a command's result [characters].
_MAX_REASON_CHARACTERS = 10_000

#: Integers of numpy become Python's.
_encode = msgspec.msgpack.Encoder(enc_hook=np.generic.item).encode
_arrays_of = attrgetter(*CYCLE_ARRAY_ORDER)
_gait_arrays_of = attrgetter(*(path.partition(".")[2] for path in GAIT_ARRAY_ORDER))


class CyclePipe:
    """Write end of a pipe of cycles; counts the cycles that are lost while the pipe is full.

    Args:
        fd: The descriptor, nothing written to it yet; closed by `close`.
        header: Entries of the recording's header; `legs` names the rows of the frames.
        blocking: Whether a full pipe makes the sender wait.
        on_broken: Called once when the reader has ended.

    Attributes:
        n_cycles: Cycles so far, lost ones counted.
        lost: Cycles that found no room, or no reader.
        broken: Whether the reader has ended.
    """

    def __init__(
        self,
        fd: int,
        header: Mapping[str, str],
        *,
        blocking: bool,
        on_broken: Callable[[], None] = lambda: None,
    ) -> None:
        self._fd = fd
        self._on_broken = on_broken
        self._rest = b""
        self._unreported = 0
        self._t_ns = 0
        self.n_cycles = 0
        self.lost = 0
        self.broken = False
        # Before the pipe stops blocking: the header needs room, whatever its length.
        self._write(pack_header(header))
        os.set_blocking(fd, blocking)

    def send(self, cycle: Cycle) -> None:
        """Write one cycle into the pipe, or count it as lost if there is no room or no reader; never raises.

        Timing:
            3 us for six legs, unless `blocking`.
        """
        self._t_ns = cycle.forces.t_sent_ns
        record = pack_cycle(self.n_cycles, cycle)
        if self._unreported:
            record = self._loss_record() + record
        self.n_cycles += 1
        if self._write(record):
            self._unreported = 0
        else:
            self._unreported += 1
            self.lost += 1

    def _loss_record(self) -> bytes:
        """Return the record that counts the cycles lost since the last one written."""
        return pack_loss(LostCycles(self.n_cycles, self._t_ns, self._unreported))

    def _write(self, record: bytes) -> bool:
        """Write the unsent rest of the previous record, then this one; return whether it was accepted."""
        try:
            if self._rest:
                self._rest = self._rest[os.write(self._fd, self._rest) :]
                if self._rest:
                    return False
            n = os.write(self._fd, record)
        except BlockingIOError:
            return False
        except BrokenPipeError:
            if not self.broken:
                self.broken = True
                self._on_broken()
            return False
        self._rest = record[n:]
        return True

    def close(self, timeout_s: float) -> None:
        """Write the unsent rest and a last loss record within `timeout_s`, and close the pipe."""
        left = memoryview(self._rest + (self._loss_record() if self._unreported else b""))
        os.set_blocking(self._fd, False)
        room = select.poll()
        room.register(self._fd, select.POLLOUT)
        try:
            while left and room.poll(timeout_s * 1000):
                left = left[os.write(self._fd, left) :]
        except (BlockingIOError, BrokenPipeError):
            pass  # without a reader; the recorder learns it from the writer's report
        os.close(self._fd)


def pack_header(header: Mapping[str, str]) -> bytes:
    """Return the recording's header as the first record of the pipe."""
    return _with_length(_encode(Header(dict(header))))


def pack_loss(loss: LostCycles) -> bytes:
    """Return a count of lost cycles as a record of the pipe."""
    return _with_length(_encode(loss))


def pack_cycle(counter: int, cycle: Cycle) -> bytes:
    """Return one cycle as a msgpack record of the pipe.

    Args:
        counter: Number of the cycle since the recording began.
        cycle: The cycle.

    Timing:
        2 us for six legs.
    """
    scan, commands, forces, outcomes, reference, temperature_c = cycle
    if outcomes:
        outcomes = tuple(outcome._replace(reason=_encodable_text(outcome.reason)) for outcome in outcomes)
    record = _encode(
        (
            *("cycle", counter, scan.sequence, forces.sequence, forces.t_sent_ns),
            b"".join(map(np.ndarray.tobytes, _arrays_of(cycle))),
            *(commands, outcomes),
            None if reference is None else tuple(column.tobytes() for column in reference),
            None if temperature_c is None else temperature_c.tobytes(),
            None if forces.gait is None else _pack_gait(forces.gait),
        )
    )
    return _with_length(record)


def _pack_gait(gait: GaitFrame) -> tuple[object, ...]:
    arrays = b"".join(map(np.ndarray.tobytes, _gait_arrays_of(gait)))
    return (gait.t_ns, gait.friction, gait.all_in_air, gait.events, arrays)


def _with_length(record: bytes) -> bytes:
    return len(record).to_bytes(LENGTH_PREFIX_BYTES, "little") + record


def _encodable_text(reason: str) -> str:
    """Return a reason, cut to `_MAX_REASON_CHARACTERS`, with unencodable characters (lone surrogates) escaped."""
    return reason[:_MAX_REASON_CHARACTERS].encode(errors="backslashreplace").decode()
