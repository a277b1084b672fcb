"""Records out of the bytes of a serial line (`serial_frames.py`), whatever happens to them on the way.

What is held is at most one frame; what is lost is counted by kind, never passed over in silence.
"""

from firmware_interface.serial_frames import (
    MOST_BYTES,
    STUFFED_BYTES,
    Record,
    RecordFlag,
    decode_record,
    is_whole,
    unstuff,
)

__all__ = ["Losses", "SerialDecoder"]

#: A plain number: an enumeration's arithmetic costs as much as the crc.
_STARTING = int(RecordFlag.STARTING)


class Losses:
    """What a decoder has not passed on, by kind, since it began.

    Attributes:
        crc: Frames whose bytes are wrong: the crc, or the stuffing.
        length: Frames of a length that no record has: bytes were lost.
        version: Whole records of another version, or with a leg or flags that this one does not know.
        overflow: Bytes in which no zero came for longer than any record is.
        lost: Records that are missing between two numbers of a leg.
        repeated: Records with the number of the one before.
        restarts: How often a leg's numbers began anew because the controller had been started again.
    """

    def __init__(self) -> None:
        self.crc = self.length = self.version = self.overflow = self.lost = self.repeated = self.restarts = 0

    def __str__(self) -> str:
        """Return those that are not zero, such as `crc 2, lost 3`."""
        return ", ".join(f"{kind} {count}" for kind, count in vars(self).items() if count)

    @property
    def total(self) -> int:
        """Return their sum."""
        return sum(vars(self).values())


class SerialDecoder:
    """Takes bytes as they come and returns the whole records in them.

    Attributes:
        losses: What was not passed on.
    """

    def __init__(self) -> None:
        self.losses = Losses()
        self._rest = b""
        self._starting = True  # what comes first may be the end of a record
        self._overflowing = False
        self._last: dict[int, tuple[int, int]] = {}  # number and flags of each leg's last record

    def begin_anew(self) -> None:
        """Drop the part of a record that is held: the line was interrupted."""
        self._rest, self._starting, self._overflowing = b"", True, False

    def feed(self, data: bytes) -> list[Record]:
        """Return the records that are whole with these bytes, in their order."""
        *frames, self._rest = (self._rest + data).split(b"\0")
        if self._overflowing or len(self._rest) > MOST_BYTES:
            self._let_overflow(frames)
        if frames and self._starting:
            self._starting = False
            if len(frames[0]) != STUFFED_BYTES:
                del frames[0]
        return [record for frame in frames if frame and (record := self._decode(frame)) is not None]

    def _let_overflow(self, frames: list[bytes]) -> None:
        """Drop and count what no zero has ended in time, up to the next one."""
        if self._overflowing and frames:
            self.losses.overflow += len(frames.pop(0))
            self._overflowing = False
        if self._overflowing or len(self._rest) > MOST_BYTES:
            self.losses.overflow += len(self._rest)
            self._rest, self._overflowing, self._starting = b"", True, False

    def _decode(self, frame: bytes) -> Record | None:
        """Return the record in a frame; None, and count, if there is none to be used."""
        losses = self.losses
        if len(frame) > MOST_BYTES:
            losses.overflow += len(frame)
            return None
        data = unstuff(frame)
        if data is None or not is_whole(data):
            if len(frame) == STUFFED_BYTES:
                losses.crc += 1
            else:
                losses.length += 1
            return None
        try:
            record = decode_record(data)
        except ValueError:
            losses.length += 1
            return None
        if record is None:
            losses.version += 1
            return None
        return record if self._follows(record.leg, record.seq, record.flags) else None

    def _follows(self, leg: int, seq: int, flags: int) -> bool:
        """Count what is missing before a record; tell whether it is another one than the last."""
        last = self._last.get(leg)
        self._last[leg] = seq, flags
        if last is None:
            return True
        last_seq, last_flags = last
        if flags & _STARTING and (not last_flags & _STARTING or seq < last_seq):
            self.losses.restarts += 1
            return True
        ahead = (seq - last_seq) & 0xFFFF
        if ahead == 0:
            self.losses.repeated += 1
            return False
        self.losses.lost += ahead - 1
        return True
