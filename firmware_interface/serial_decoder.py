"""Decoder of the serial byte stream into records (`serial_frames.py`); losses are counted."""

from collections import Counter

from firmware_interface.serial_frames import (
    MAX_STUFFED_BLOCK,
    STUFFED_BYTES,
    VERSION,
    Record,
    RecordFlag,
    Sending,
    decode_record,
    decode_sending,
    has_valid_crc,
    unstuff,
)

#: A plain number: an enumeration's arithmetic costs as much as the crc.
_STARTING = int(RecordFlag.STARTING)


class SerialDecoder:
    """Stateful decoder of the byte stream of one serial port.

    Attributes:
        losses: Losses since the start, by kind:
            crc: frames with wrong bytes: the checksum, or the stuffing;
            length: frames of a length that no record has: bytes were lost;
            version: whole records of another version, or with an unknown leg or flag;
            overflow: bytes without a zero for longer than any record is;
            lost: records missing between two numbers of a leg;
            repeated: records with the number of the one before;
            restarts: restarts of a leg's numbers because the controller was started again.
        other_version: Version of the last record that was counted as one of another version.
    """

    def __init__(self) -> None:
        self.losses = Counter[str]()
        self.other_version = VERSION
        self._rest = b""
        self._starting = True  # the first bytes may be the end of a record
        self._overflowing = False
        self._last: dict[int, tuple[int, int]] = {}  # number and flags of each leg's last record

    def reset(self) -> None:
        """Discard the incomplete record, after the serial port was interrupted."""
        self._rest, self._starting, self._overflowing = b"", True, False

    def feed(self, data: bytes) -> list[Record | Sending]:
        """Return what these bytes complete, in order of arrival."""
        *frames, self._rest = (self._rest + data).split(b"\0")
        if self._overflowing or len(self._rest) > MAX_STUFFED_BLOCK:
            self._discard_overlong(frames)
        if frames and self._starting:
            self._starting = False
            if len(frames[0]) != STUFFED_BYTES:
                del frames[0]
        return [record for frame in frames if frame and (record := self._decode(frame)) is not None]

    def _discard_overlong(self, frames: list[bytes]) -> None:
        """Discard and count bytes when a frame is too long, up to the next zero byte."""
        if self._overflowing and frames:
            self.losses["overflow"] += len(frames.pop(0))
            self._overflowing = False
        if self._overflowing or len(self._rest) > MAX_STUFFED_BLOCK:
            self.losses["overflow"] += len(self._rest)
            self._rest, self._overflowing, self._starting = b"", True, False

    def _decode(self, frame: bytes) -> Record | Sending | None:
        """Return what a frame has; if it cannot be used, count it and return None."""
        if len(frame) > MAX_STUFFED_BLOCK:
            self.losses["overflow"] += len(frame)
            return None
        data = unstuff(frame)
        if data is None or not has_valid_crc(data):
            self.losses["crc" if len(frame) == STUFFED_BYTES else "length"] += 1
            return None
        try:
            record = decode_record(data)
        except ValueError:
            self.losses["length"] += 1
            return None
        if record is None:
            sending = decode_sending(data)
            if sending is None:
                self.losses["version"] += 1
                self.other_version = data[0]
            return sending
        return record if self._count_losses_and_tell_if_new(record.leg, record.seq, record.flags) else None

    def _count_losses_and_tell_if_new(self, leg: int, seq: int, flags: int) -> bool:
        """Count the records missing before this one; return False if it repeats the last one."""
        last = self._last.get(leg)
        self._last[leg] = seq, flags
        if last is None:
            return True
        last_seq, last_flags = last
        if flags & _STARTING and (not last_flags & _STARTING or seq < last_seq):
            self.losses["restarts"] += 1
            return True
        ahead = (seq - last_seq) & 0xFFFF
        if ahead == 0:
            self.losses["repeated"] += 1
            return False
        if ahead > 1:
            self.losses["lost"] += ahead - 1
        return True
