"""A force sensor on a serial port, or on whatever stands for one."""

from footsense.frames import Reference
from footsense.ports import SerialPort
from footsense.reference.record_decoder import Decoder
from footsense.reference.sample_stream import ReferenceStream, SensorStatistics

__all__ = ["SerialReference"]


class SerialReference:
    """Reads a sensor that streams, after it was asked to where it has to be.

    Args:
        port: Where its bytes come from.
        decoder: What makes records of them.
        stream: What makes forces of those.
        start: What to send when the port was opened, nothing if it streams by itself.
    """

    def __init__(
        self, port: SerialPort, decoder: Decoder, stream: ReferenceStream, start: bytes = b""
    ) -> None:
        self._port = port
        self._decoder = decoder
        self._stream = stream
        self._start = start
        self._opened = port.opened
        port.write(start)

    def read(self, now_ns: int) -> Reference:
        """Return the samples that have arrived since the last call.

        Raises:
            SensorError: What arrives is no record of this sensor.
        """
        data = self._port.read()
        if self._port.opened != self._opened:
            self._opened = self._port.opened
            self._decoder.reset()
            self._stream.restart()
            self._port.write(self._start)
        rows = self._decoder.feed(data)
        return self._stream.take(rows, len(data), now_ns, self._decoder.last_bad or data[:60])

    def figures(self) -> SensorStatistics:
        """Return how it went so far."""
        return self._stream.figures(self._decoder.n_bad, self._opened)

    def close(self) -> None:
        """Release the port."""
        self._port.close()
