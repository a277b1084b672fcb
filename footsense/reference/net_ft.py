"""Driver of a force sensor that streams over UDP as an ATI Net F/T does: Raw Data Transfer (RDT).

    request   header u16 0x1234 | command u16 | samples u32, 0 for no end              8 bytes
    record    rdt sequence u32 | ft sequence u32 | status u32 | fx fy fz tx ty tz i32   36 bytes, one or more a packet

All big-endian. Forces are counts; the sensor's web page shows the counts per unit. The rdt sequence increases by one
with each record, at the output rate set there; a status other than zero means that the sensor needs attention.

Source:
    ATI, Net F/T manual 9620-05-NET FT, section RDT, and table 5.1 for the status.
"""

import errno
import logging
import socket
import struct

import numpy as np
from numpy.typing import NDArray

from footsense.errors import ReferenceSensorError
from footsense.frames import Mask, ReferenceSamples
from footsense.reference.record_decoder import SensorRecords
from footsense.reference.sample_stream import SampleStream

RDT_PORT = 49_152
_REQUEST_STRUCT = struct.Struct(">HHI")
_HEADER, _STOP, _START = 0x1234, 0x0000, 0x0002
_RECORD_DTYPE = np.dtype(
    [("rdt", ">u4"), ("ft", ">u4"), ("status", ">u4"), ("force", ">i4", 3), ("torque", ">i4", 3)]
)
#: Silence after which the stream is requested again [ns]: the sensor was switched off.
_REQUEST_RETRY_NS = 1_000_000_000
_MAX_PACKETS_PER_READ = 4096

_log = logging.getLogger(__name__)


def rdt_request(command: int) -> bytes:
    """Return the RDT request packet of a command: start streaming (2) or stop (0).

    Example:
        >>> rdt_request(2).hex()
        '1234000200000000'
    """
    return _REQUEST_STRUCT.pack(_HEADER, command, 0)


class NetFtReference:
    """Driver of one Net F/T sensor; repeats its request for data after a silence.

    Args:
        host: The sensor's address.
        port: UDP port of the sensor.
        stream: Conversion of its counts to forces.

    Attributes:
        statistics: Counts so far; an opening is a request for the stream.

    Raises:
        ReferenceSensorError: There is no such address.
    """

    def __init__(self, host: str, port: int, stream: SampleStream) -> None:
        self._stream = stream
        self.statistics = stream.statistics
        self._name = f"{host}:{port}"
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.connect((host, port))
        except OSError as error:
            self._socket.close()
            raise ReferenceSensorError(
                f"{self._name}: {error.strerror or error}; give the sensor's address"
            ) from None
        self._socket.setblocking(False)
        self._requested_ns: int | None = None
        self._last_rdt: int | None = None
        self._unwrapped = 0
        self._bad = b""
        self._status = 0

    def read(self, now_ns: int) -> ReferenceSamples:
        """Return the force samples received since the last call.

        Raises:
            ReferenceSensorError: The received data are not RDT records.
        """
        packets = self._receive_packets()
        good = [packet for packet in packets if len(packet) % _RECORD_DTYPE.itemsize == 0]
        for packet in packets:
            if len(packet) % _RECORD_DTYPE.itemsize:
                self.statistics.n_bad_records, self._bad = self.statistics.n_bad_records + 1, packet[:40]
        records = self._drop_late_records(np.frombuffer(b"".join(good), _RECORD_DTYPE))
        # If all records come late, the sensor has restarted its sequence at the request of another client.
        silent = self._requested_ns is None or now_ns - self._requested_ns > _REQUEST_RETRY_NS
        if self._requested_ns is None or (silent and not len(records.raw_forces)):
            self._request_stream()
            self._requested_ns = now_ns
        elif len(records.raw_forces):
            self._requested_ns = now_ns
        return self._stream.convert(records, sum(map(len, packets)), now_ns, self._bad)

    def close(self) -> None:
        """Tell the sensor to stop streaming, and close the socket."""
        self._send(_STOP)
        self._socket.close()

    def _request_stream(self) -> None:
        """Send the request to start streaming."""
        if self.statistics.n_stream_starts:
            self._stream.restart_clock_sync()
            self._last_rdt = None
        self.statistics.n_stream_starts += 1
        self._send(_START)

    def _send(self, command: int) -> None:
        """Send an RDT request; a failure is only logged."""
        try:
            self._socket.send(rdt_request(command))
        except OSError as error:  # it is requested again, and the stream logs the silence
            _log.info("%s: %s", self._name, error.strerror)

    def _receive_packets(self) -> list[bytes]:
        """Return the UDP packets received so far.

        Raises:
            ReferenceSensorError: The socket fails.
        """
        packets = []
        for _ in range(_MAX_PACKETS_PER_READ):
            try:
                packets.append(self._socket.recv(2048))
            except BlockingIOError:
                break
            except OSError as error:
                if error.errno != errno.ECONNREFUSED:  # the port is closed now
                    raise ReferenceSensorError(f"{self._name}: {error.strerror}") from None
        return packets

    def _drop_late_records(self, records: np.ndarray[tuple[int], np.dtype[np.void]]) -> SensorRecords:
        """Return the records without repeated and late ones, which are counted as bad."""
        sequence, keep = [], []
        for number in records["rdt"].tolist():
            step = 1 if self._last_rdt is None else (number - self._last_rdt) % (1 << 32)
            late = step == 0 or step >= 1 << 31
            keep.append(not late)
            if not late:
                self._last_rdt = number
                self._unwrapped += step
                sequence.append(self._unwrapped)
        self.statistics.n_bad_records += keep.count(False)
        kept = records[np.array(keep, np.bool_)]
        return SensorRecords(
            None,
            np.array(sequence, np.int64),
            kept["force"].astype(np.float64).reshape(-1, 3),
            self._faulty_readings(kept["status"]),
        )

    def _faulty_readings(self, status: NDArray[np.uint32]) -> Mask:
        """Return the mask of the readings that the sensor flags as faulty, and log their start."""
        is_faulty: Mask = status != 0
        now = int(status[is_faulty][0]) if is_faulty.any() else 0
        if len(status):
            if now and not self._status:
                _log.warning("%s: status %#010x; its web page shows the cause", self._name, now)
            self._status = now
        return is_faulty
