"""Sampling times of a force sensor in the daemon's clock, and the number of missing samples.

The loop reads bytes once a scan and finds several samples at once; which of them has just arrived is unknown. So the
sensor's own time is mapped by the lower envelope of all delays (`footsense.clock_map`): in some scans the newest sample
has arrived just before. Without timestamps, sequence numbers count; without those, its samples are counted, and the
count is corrected when samples are lost.
"""

from collections import deque
from typing import NamedTuple

import numpy as np

from footsense.clock_map import ClockMap
from footsense.frames import Mask, Stamps, Vector

_NS_PER_S = 1_000_000_000
#: Reads in a row whose newest sample is late before counted samples are taken as missing.
_N_LATE_READS_FOR_LOSS = 8
#: Lateness that a miscount causes, in periods: a sample that has just arrived is up to one period old.
_MIN_LATENESS_PERIODS = 1.05


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


class SampleTimes:
    """Assigns sampling times in the daemon's clock to a force sensor's samples, and counts missing ones.

    Args:
        rate_hz: Samples per second of the sensor's clock [Hz].
        latency_ns: Age of a sample when the sensor sends it [ns].

    Attributes:
        n_missing: Samples lost, by their times.
    """

    def __init__(self, rate_hz: float, latency_ns: int) -> None:
        self._period_ns = _NS_PER_S / rate_hz
        self._latency_ns = latency_ns
        self._map = ClockMap()
        self._count = 0
        self._late_ns: deque[int] = deque(maxlen=_N_LATE_READS_FOR_LOSS)
        self._last: tuple[int, int] | None = None  # time of the last sample, sensor's clock and ours
        self._restarted = False
        self._n_jumps_before = 0
        self.n_missing = 0

    @property
    def n_clock_jumps(self) -> int:
        """Number of jumps of the sensor's clock."""
        return self._n_jumps_before + self._map.restarts

    @property
    def clock_fit_residual_ns(self) -> int:
        """Uncertainty of the sampling times [ns], without the constant part of the delay."""
        return self._map.mean_residual_ns

    def restart_clock_sync(self) -> None:
        """Restart the clock synchronisation: the port was reopened, the sensor may have been restarted."""
        self._n_jumps_before = self.n_clock_jumps
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
            if self._last is not None:  # across a jump the daemon's clock counts
                jumped = self._restarted or self._map.restarts != jumps
                since_ns = from_arrival_ns - self._last[1] if jumped else t_ns - self._last[0]
                self.n_missing += max(round(since_ns / self._period_ns) - 1, 0)
            self._last, self._restarted = (t_ns, ours_ns), False
            daemon_times_ns.append(ours_ns)
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
