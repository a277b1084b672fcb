"""Convert a streaming force sensor's records to timed forces, and supervise the stream.

The loop reads bytes once a scan and finds several samples at once; which of them has just arrived is unknown. So the
sensor's own time is mapped by the lower envelope of all delays (`footsense.clock_map`): in some scans the newest sample
has arrived just before. Without timestamps, sequence numbers count; without those, its samples are counted, and the
count is corrected when samples are lost.
"""

import logging
from collections import deque
from typing import NamedTuple

import numpy as np

from footsense.clock_map import ClockMap
from footsense.errors import ReferenceSensorError
from footsense.frames import Mask, ReferenceSamples, SensorStatistics, Stamps, Vector
from footsense.reference.sensor_mounting import SensorMounting

_NS_PER_S = 1_000_000_000
#: Reads in a row whose newest sample is late before counted samples are taken as missing.
_N_LATE_READS_FOR_LOSS = 8
#: Lateness that a miscount causes, in periods: a sample that has just arrived is up to one period old.
_MIN_LATENESS_PERIODS = 1.05
#: Silence that is logged, and silence from the start on that is an error [ns].
_SILENCE_WARNING_NS = 500_000_000
_FIRST_RECORD_TIMEOUT_NS = 3_000_000_000
#: Bytes without a single record that are another format [bytes].
_MAX_BYTES_WITHOUT_RECORD = 4096

_log = logging.getLogger(__name__)


class SensorRecords(NamedTuple):
    """Decoded records of a force sensor: times, sequence numbers, raw values; oldest first.

    Attributes:
        t_sensor_ns: Time of each by the sensor's clock [ns], shape (n,), int64; None if it sends none.
        sequence: Sequence numbers, shape (n,), int64; None if it sends none.
        raw_forces: Forces as sent, shape (n, 3).
        saturated: Whether the sensor flags them as saturated, shape (n,).
    """

    t_sensor_ns: Stamps | None
    sequence: Stamps | None
    raw_forces: Vector
    saturated: Mask


class SampleStream:
    """Converts a sensor's records to timed forces; logs silence, its end, and clock jumps.

    Args:
        name: Name of the sensor, for messages.
        mounting: Its mounting.
        rate_hz: Samples per second of its clock [Hz].
        latency_ns: Age of a sample when the sensor sends it [ns].

    Attributes:
        statistics: Counts so far; the sensor's driver counts bad records and openings.
    """

    def __init__(self, name: str, mounting: SensorMounting, rate_hz: float, latency_ns: int) -> None:
        self._name = name
        self._mounting = mounting
        self.statistics = SensorStatistics()
        self._times = _SampleTimes(rate_hz, latency_ns, self.statistics)
        self._n_bytes = 0
        self._heard_ns: int | None = None
        self._silent = False
        self._n_missing_before = self._n_jumps_before = 0

    def restart_clock_sync(self) -> None:
        """Restart the clock synchronisation: the port was reopened, the sensor may have been restarted."""
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
        counts, waited_ns = self.statistics, now_ns - self._heard_ns
        counts.n_samples += n
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
        if counts.n_clock_jumps > self._n_jumps_before:
            self._n_jumps_before = counts.n_clock_jumps
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


class _SampleTimes:
    """Assigns sampling times in the daemon's clock to a sensor's samples, and counts missing ones and clock jumps."""

    def __init__(self, rate_hz: float, latency_ns: int, counts: SensorStatistics) -> None:
        self._period_ns = _NS_PER_S / rate_hz
        self._latency_ns = latency_ns
        self._counts = counts
        self._map = ClockMap()
        self._count = 0
        self._late_ns: deque[int] = deque(maxlen=_N_LATE_READS_FOR_LOSS)
        self._last: tuple[int, int] | None = None  # time of the last sample, sensor's clock and ours
        self._restarted = False

    def restart_clock_sync(self) -> None:
        self._map = ClockMap()
        self._restarted = True
        self._late_ns.clear()

    def sampling_times_ns(self, records: SensorRecords, arrival_ns: int) -> Stamps:
        """Return the sampling time of each record [ns], shape (n,).

        Args:
            records: Records received at once.
            arrival_ns: Time at which they were read [ns].
        """
        n = len(records.raw_forces)
        if n == 0:
            return np.zeros(0, np.int64)
        counted = records.t_sensor_ns is None and records.sequence is None
        if records.t_sensor_ns is not None:
            sensor_times_ns = records.t_sensor_ns.tolist()
        else:
            numbers = list(range(self._count + 1, self._count + n + 1))
            if records.sequence is not None:
                numbers = records.sequence.tolist()
            sensor_times_ns = [round(number * self._period_ns) for number in numbers]
            self._count += n
        is_first = self._last is None or self._restarted
        if is_first:
            self._map.map(sensor_times_ns[-1], arrival_ns)
        daemon_times_ns: list[int] = []
        for t_ns in sensor_times_ns:
            # By the sensor's clock, relative to the newest, which alone has just arrived.
            from_arrival_ns = arrival_ns - (sensor_times_ns[-1] - t_ns)
            jumps = self._map.restarts
            ours_ns = from_arrival_ns if is_first else self._map.map(t_ns, arrival_ns)
            n_jumps = self._map.restarts - jumps
            self._counts.n_clock_jumps += n_jumps
            if self._last is not None:  # across a jump the daemon's clock counts
                jumped = self._restarted or n_jumps
                since_ns = from_arrival_ns - self._last[1] if jumped else t_ns - self._last[0]
                self._counts.n_missing += max(round(since_ns / self._period_ns) - 1, 0)
            self._last, self._restarted = (t_ns, ours_ns), False
            daemon_times_ns.append(ours_ns)
        self._counts.clock_fit_residual_ms = self._map.mean_residual_ns * 1e-6
        if counted:
            self._skip_lost_sample_numbers(arrival_ns - daemon_times_ns[-1])
        return np.array(daemon_times_ns, np.int64) - self._latency_ns

    def _skip_lost_sample_numbers(self, late_ns: int) -> None:
        """Skip the numbers of lost samples, if the newest counted sample was late in several reads in a row."""
        self._late_ns.append(late_ns)
        least_ns = min(self._late_ns)
        if (
            len(self._late_ns) == _N_LATE_READS_FOR_LOSS
            and least_ns > _MIN_LATENESS_PERIODS * self._period_ns
        ):
            self._count += int(least_ns // self._period_ns)
            self._late_ns.clear()
