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

from footsense.errors import ReferenceSensorError
from footsense.frames import ReferenceSamples
from footsense.reference.sample_stream import SampleStream, SensorRecords

_REQUEST_STRUCT = struct.Struct(">HHI")
_HEADER, _STOP, _START = 0x1234, 0x0000, 0x0002
_RECORD_DTYPE = np.dtype(
    [("rdt", ">u4"), ("ft", ">u4"), ("status", ">u4"), ("force", ">i4", 3), ("torque", ">i4", 3)]
)
#: Silence after which the stream is requested again [ns]: the sensor was switched off.
_REQUEST_RETRY_NS = 1_000_000_000
_MAX_PACKETS_PER_READ = 4096

_log = logging.getLogger(__name__)


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
        self._heard_ns: int | None = None
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
        whole = [packet for packet in packets if len(packet) % _RECORD_DTYPE.itemsize == 0]
        if len(whole) < len(packets):
            self.statistics.n_bad_records += len(packets) - len(whole)
            self._bad = next(packet[:40] for packet in packets if packet not in whole)
        records = self._drop_late_records(np.frombuffer(b"".join(whole), _RECORD_DTYPE))
        # If all records come late, the sensor has restarted its sequence at the request of another client.
        if self._heard_ns is None or (
            not len(records.raw_forces) and now_ns - self._heard_ns > _REQUEST_RETRY_NS
        ):
            self._request_stream()
            self._heard_ns = now_ns
        elif len(records.raw_forces):
            self._heard_ns = now_ns
        return self._stream.convert(records, sum(map(len, packets)), now_ns, self._bad)

    def close(self) -> None:
        """Tell the sensor to stop streaming, and close the socket."""
        self._send(_STOP)
        self._socket.close()

    def _request_stream(self) -> None:
        if self.statistics.n_stream_starts:
            self._stream.restart_clock_sync()
            self._last_rdt = None
        self.statistics.n_stream_starts += 1
        self._send(_START)

    def _send(self, command: int) -> None:
        try:
            self._socket.send(_REQUEST_STRUCT.pack(_HEADER, command, 0))
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
        """Return the records without repeated and late ones, which are counted as bad; log the first faulty status."""
        sequence, keep = [], []
        for number in records["rdt"].tolist():
            step = 1 if self._last_rdt is None else (number - self._last_rdt) % (1 << 32)
            is_late = step == 0 or step >= 1 << 31
            keep.append(not is_late)
            if not is_late:
                self._last_rdt = number
                self._unwrapped += step
                sequence.append(self._unwrapped)
        self.statistics.n_bad_records += keep.count(False)
        kept = records[np.array(keep, np.bool_)]
        for status in kept["status"].tolist():
            if status and not self._status:
                _log.warning("%s: status %#010x; its web page shows the cause", self._name, status)
            self._status = status
        forces = kept["force"].astype(np.float64).reshape(-1, 3)
        return SensorRecords(None, np.array(sequence, np.int64), forces, kept["status"] != 0)
