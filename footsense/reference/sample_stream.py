"""Convert a streaming force sensor's records to timed forces, and supervise the stream."""

import logging

import numpy as np

from footsense.errors import ReferenceSensorError
from footsense.frames import ReferenceSamples, SensorStatistics
from footsense.reference.sample_times import SampleTimes, SensorRecords
from footsense.reference.sensor_mounting import SensorMounting

#: Silence that is logged, and silence from the start on that is an error [ns].
_SILENCE_WARNING_NS = 500_000_000
_FIRST_RECORD_TIMEOUT_NS = 3_000_000_000
#: Bytes without a single record that are another format [bytes].
_MAX_BYTES_WITHOUT_RECORD = 4096

_log = logging.getLogger(__name__)


class SampleStream:
    """Converts a sensor's records to timed forces; logs silence, its end, and clock jumps.

    Args:
        name: Name of the sensor, for messages.
        mounting: Its mounting.
        times: Its clock.

    Attributes:
        statistics: Counts so far; the sensor's driver counts bad records and openings.
    """

    def __init__(self, name: str, mounting: SensorMounting, times: SampleTimes) -> None:
        self._name = name
        self._mounting = mounting
        self._times = times
        self.statistics = SensorStatistics()
        self._n_bytes = 0
        self._heard_ns: int | None = None
        self._silent = False
        self._n_missing_before = 0

    def restart_clock_sync(self) -> None:
        """Restart the clock synchronisation, after the port was reopened."""
        self._times.restart_clock_sync()

    def convert(self, records: SensorRecords, n_bytes: int, now_ns: int, example: bytes) -> ReferenceSamples:
        """Return records as timed forces; records buffered before the first call are discarded.

        Args:
            records: The records.
            n_bytes: Number of bytes received with them.
            now_ns: Present time [ns].
            example: Bytes that were no record, for the message.

        Raises:
            ReferenceSensorError: There has never been a record, or never a byte.
        """
        t_ns = self._times.sampling_times_ns(records, now_ns)
        force_n, saturated = self._mounting.to_foot_force_n(records.raw_forces)
        saturated |= records.saturated
        # Samples older than the clock of a simulation have no time.
        fresh = np.full(len(t_ns), self._heard_ns is not None) & (t_ns >= 0)
        self._update_statistics(int(np.count_nonzero(fresh)), n_bytes, now_ns, example)
        self.statistics.n_saturated += int(np.count_nonzero(saturated[fresh]))
        return ReferenceSamples(t_ns[fresh], force_n[fresh], saturated[fresh])

    def _update_statistics(self, n: int, n_bytes: int, now_ns: int, example: bytes) -> None:
        """Update the counts, log the start and end of silence, and check that a first record arrives."""
        if self._heard_ns is None:
            self._heard_ns = now_ns
        counts, times, waited_ns = self.statistics, self._times, now_ns - self._heard_ns
        counts.n_samples += n
        counts.n_missing, counts.clock_fit_residual_ms = times.n_missing, times.clock_fit_residual_ns * 1e-6
        self._n_bytes += n_bytes
        if counts.n_samples == 0:
            self._check_first_record_arrived(waited_ns, example)
        elif n:
            if self._silent:
                missing = counts.n_missing - self._n_missing_before
                _log.warning("%s: sends again; %d samples are missing", self._name, missing)
            self._heard_ns, self._silent, self._n_missing_before = now_ns, False, counts.n_missing
        elif waited_ns > _SILENCE_WARNING_NS and not self._silent:
            self._silent = True
            _log.warning("%s: no sample for 0.5 s; the recording goes on without", self._name)
        if times.n_clock_jumps > counts.n_clock_jumps:
            counts.n_clock_jumps = times.n_clock_jumps
            _log.warning("%s: its clock has jumped; the clock map restarts", self._name)

    def _check_first_record_arrived(self, waited_ns: int, example: bytes) -> None:
        """Raise an error if the sensor has sent no valid record for too long.

        Raises:
            ReferenceSensorError: It sends something else, or nothing for too long.
        """
        is_late = waited_ns > _FIRST_RECORD_TIMEOUT_NS
        if self._n_bytes > _MAX_BYTES_WITHOUT_RECORD or (self._n_bytes and is_late):
            raise ReferenceSensorError(
                f"{self._name}: no record in {self._n_bytes} bytes, such as {example!r}; "
                "baud, columns and separator have to be the sensor's"
            )
        if is_late:
            raise ReferenceSensorError(
                f"{self._name}: nothing arrives for 3 s; is it switched on, does it need a start command (`start`), "
                "is the baud rate its own?"
            )
