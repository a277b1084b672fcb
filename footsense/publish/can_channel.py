"""One CAN channel and the log of what was sent on it: the only file that knows python-can.

A frame that the channel does not take at once is dropped and counted, never tried again: by then there is a
newer one. Nothing here waits, and once the channel is open nothing here raises.

Each frame carries the time of its forces, so that on the virtual channel and in the log a simulated minute
lasts a minute. python-can does not check the settings that it is given and would add those of files in the
home directory: it gets the chance for neither.
"""

import contextlib
import errno
import logging
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from footsense.errors import CanError, RecordingError
from footsense.publish.can_log import check_log_suffix, open_log
from footsense.publish.can_stats import CanStats

if TYPE_CHECKING:
    import can

__all__ = ["CanChannel"]

#: Ends the drain of a channel that never falls silent; a full bus of 1 Mbit/s carries fewer frames in a scan.
_MAX_DRAINED = 1000

_NO_CHANNEL = {errno.ENETDOWN, errno.ENXIO, errno.ENODEV, errno.EAFNOSUPPORT}


class CanChannel:
    """An open CAN channel.

    Args:
        interface: Kind of channel, as python-can calls it: `virtual` or `socketcan`.
        channel: Its name, such as `can0`.
        bitrate: Bit rate of the bus [bit/s]; Linux sets it when the interface comes up, so it is only told.
        accept: CAN ids that `receive` returns.
        greeting: First frames, by CAN id; they also show whether the channel is up.
        log_file: File for every frame sent, its format by suffix; None for none. Made when all else is well.
        stats: Where to count.

    Attributes:
        log_error: Why the log ended early, such as a full disk; empty while it is whole.

    Raises:
        ConfigError: The log's suffix is unknown.
        RecordingError: The log cannot be opened.
        CanError: The channel is missing or down.
    """

    def __init__(
        self,
        *,
        interface: str,
        channel: str,
        bitrate: int,
        accept: Collection[int],
        greeting: Mapping[int, bytes],
        log_file: Path | None,
        stats: CanStats,
    ) -> None:
        if log_file is not None:
            check_log_suffix(log_file)
        import can

        self.stats = stats
        self.log_error = ""
        self._failures = (can.CanError, OSError)
        self._accept = frozenset(accept)
        self._log_file = log_file
        self._log: can.io.generic.FileIOMessageWriter[Any] | None = None
        self._unlogged: list[can.Message] = []
        try:
            self._bus = can.Bus(
                interface=interface, channel=channel, ignore_config=True, **_options(interface, accept)
            )
        except (can.CanError, OSError, ValueError, ImportError, NotImplementedError) as error:
            raise CanError(_what_is_wrong(interface, channel, bitrate, error)) from error
        try:
            self._greet(greeting, interface, channel, bitrate)
            if log_file is not None:
                self._log = open_log(log_file, channel)
        except BaseException:
            self._bus.shutdown()
            raise

    def frame(self, can_id: int, length: int) -> "can.Message":
        """Return a frame to be filled and sent again and again; python-can copies what it is handed."""
        import can

        return can.Message(arbitration_id=can_id, is_extended_id=False, data=bytes(length), is_rx=False)

    def send(self, frame: "can.Message", data: bytes, stamp_s: float) -> None:
        """Fill a frame and hand it over, or drop it.

        Args:
            frame: One that `frame` made.
            data: Its contents, of the same length.
            stamp_s: Time to be written to the log [s].
        """
        frame.data[:] = data
        frame.timestamp = stamp_s
        try:
            self._bus.send(frame, timeout=0)
        except self._failures:
            self.stats.dropped += 1
            return
        self.stats.sent += 1
        if self._log is not None:
            self._write_log(self._log, frame)

    def receive(self) -> list[tuple[int, bytes]]:
        """Return id and data of each accepted frame that has arrived, oldest first.

        The rest is taken from the channel too: an unread queue of the virtual channel grows without bound.
        """
        arrived = []
        for _ in range(_MAX_DRAINED):
            try:
                # Its recv() measures even no timeout with the wall clock, and waits as long as that is set back.
                message, _ = self._bus._recv_internal(timeout=0)  # noqa: SLF001
            except self._failures:
                break
            if message is None:
                break
            if message.is_error_frame:
                self.stats.bus_errors += 1
            elif message.arbitration_id in self._accept and not (
                message.is_extended_id or message.is_remote_frame
            ):
                arrived.append((message.arbitration_id, bytes(message.data)))
        self.stats.received += len(arrived)
        return arrived

    def close(self) -> None:
        """Release the channel and finish the log.

        Raises:
            RecordingError: The log is not whole.
        """
        self._bus.shutdown()
        if self._log is not None:
            self._end_log(self._log)
        if self.log_error:
            raise RecordingError(f"{self._log_file}: {self.log_error}; what was sent is not affected")

    def _greet(self, greeting: Mapping[int, bytes], interface: str, channel: str, bitrate: int) -> None:
        """Send the first frames.

        Raises:
            CanError: The channel is down. A full queue is no reason: where nobody listens, it fills at once.
        """
        for can_id, data in greeting.items():
            frame = self.frame(can_id, len(data))
            frame.data[:] = data
            try:
                self._bus.send(frame, timeout=0)
            except self._failures as error:
                if _errno(error) in _NO_CHANNEL:
                    raise CanError(_what_is_wrong(interface, channel, bitrate, error)) from error
                self.stats.dropped += 1
            else:
                self.stats.sent += 1
                self._unlogged.append(frame)

    def _write_log(self, log: "can.io.generic.FileIOMessageWriter[Any]", frame: "can.Message") -> None:
        """Add a frame; a log that cannot grow ends, and the forces go on."""
        try:
            # The greeting was sent before there was a log, and before there were forces to tell the time.
            for early in self._unlogged:
                early.timestamp = frame.timestamp
                log.on_message_received(early)
            self._unlogged.clear()
            log.on_message_received(frame)
        except OSError as error:
            self.log_error = f"the CAN log ended early: {error.strerror}"
            self._end_log(log)

    def _end_log(self, log: "can.io.generic.FileIOMessageWriter[Any]") -> None:
        self._log = None
        try:
            log.stop()
        except OSError as error:
            self.log_error = self.log_error or f"the CAN log is not whole: {error.strerror}"
            # python-can leaves the file open where its last words do not fit.
            with contextlib.suppress(OSError):
                log.file.close()


def _options(interface: str, accept: Collection[int]) -> dict[str, Any]:
    """Return what only this kind of channel understands."""
    if interface == "virtual":
        return {"preserve_timestamps": True}
    if interface == "socketcan":
        # The kernel drops the rest. python-can's own filter would end each drain at the first foreign frame.
        return {
            "can_filters": [{"can_id": can_id, "can_mask": 0x7FF, "extended": False} for can_id in accept]
        }
    return {}


def _errno(error: BaseException) -> int | None:
    """Return the system's number for what went wrong, which python-can keeps in a field of its own."""
    number = getattr(error, "error_code", None) or getattr(error, "errno", None)
    return number if isinstance(number, int) else None


def _what_is_wrong(interface: str, channel: str, bitrate: int, error: BaseException) -> str:
    """Return one line: what is wrong with the channel, and what would be right."""
    name = f"CAN channel {channel} ({interface})"
    match _errno(error):
        case errno.ENETDOWN:
            kind = "" if channel.startswith("vcan") else f" type can bitrate {bitrate}"
            return f"{name} is down; try: ip link set {channel} up{kind}"
        case errno.ENODEV | errno.ENXIO:
            return f"{name} does not exist; those that do: ip -details link show type can"
        case errno.EAFNOSUPPORT:
            return f"{name} needs a kernel with CAN; try: modprobe can_raw"
        case _:
            return f"{name} cannot be opened: {error}"


# python-can logs what it also raises; without a listener of its own, Python would print that beside our line.
logging.getLogger("can").addHandler(logging.NullHandler())
