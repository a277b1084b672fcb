"""Driver of a force sensor on a (real or simulated) serial port."""

from footsense.frames import ReferenceSamples
from footsense.ports import SerialPort
from footsense.reference.record_decoder import RecordDecoder
from footsense.reference.sample_stream import SampleStream


class SerialReference:
    """Driver of a force sensor on a serial port that streams by itself or after a start command.

    Args:
        port: Source of its bytes.
        decoder: Decoder of its records.
        stream: Conversion of the records to forces.
        start: Bytes to send after the port was opened; empty if it streams by itself.

    Attributes:
        statistics: Counts so far.
    """

    def __init__(
        self, port: SerialPort, decoder: RecordDecoder, stream: SampleStream, start: bytes = b""
    ) -> None:
        self._port = port
        self._decoder = decoder
        self._stream = stream
        self.statistics = stream.statistics
        self._start = start
        self.statistics.n_stream_starts = port.n_opened
        port.write(start)

    def read(self, now_ns: int) -> ReferenceSamples:
        """Return the force samples received since the last call.

        Raises:
            ReferenceSensorError: The bytes are no records of this sensor.
        """
        data = self._port.read()
        if self._port.n_opened != self.statistics.n_stream_starts:
            self.statistics.n_stream_starts = self._port.n_opened
            self._decoder.reset()
            self._stream.restart_clock_sync()
            self._port.write(self._start)
        records = self._decoder.feed(data)
        self.statistics.n_bad_records = self._decoder.n_bad
        return self._stream.convert(records, len(data), now_ns, self._decoder.last_bad or data[:60])

    def close(self) -> None:
        """Close the serial port."""
        self._port.close()
