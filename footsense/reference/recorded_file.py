"""Replay of a recorded force sensor (CSV file) as a reference sensor, starting with the first scan."""

import csv
from functools import partial
from pathlib import Path

import numpy as np

from footsense.errors import ReferenceSensorError
from footsense.frames import ReferenceSamples, SensorStatistics
from footsense.reference.sensor_mounting import SensorMounting
from footsense.reference.serial_sensor import NS_PER_TIME_COLUMN_UNIT, plausible_values

#: Longest line that is read [characters]; a file without line ends would else be read whole.
_MAX_LINE_CHARACTERS = 10_000


class FileReference:
    """Reference sensor that plays recorded samples at their original rate, starting with the first call.

    Args:
        reference: All samples in their order.

    Attributes:
        statistics: Counts so far.
    """

    def __init__(self, reference: ReferenceSamples) -> None:
        self._reference = reference
        self._offset_ns: int | None = None
        self.statistics = SensorStatistics(n_stream_starts=1)

    def read(self, now_ns: int) -> ReferenceSamples:
        """Return the recorded samples due since the last call."""
        t_ns = self._reference.t_ns
        if self._offset_ns is None:
            self._offset_ns = now_ns - int(t_ns[0])
        until = int(np.searchsorted(t_ns, now_ns - self._offset_ns, side="right"))
        counts, (_, force_n, saturated) = self.statistics, self._reference
        span = slice(counts.n_samples, max(until, counts.n_samples))
        counts.n_samples = span.stop
        counts.n_saturated += int(np.count_nonzero(saturated[span]))
        return ReferenceSamples(t_ns[span] + self._offset_ns, force_n[span], saturated[span])

    def close(self) -> None:
        """Do nothing: the file has been read completely."""


def read_csv(path: Path, mounting: SensorMounting, latency_ns: int) -> ReferenceSamples:
    """Return the samples of a CSV file.

    Args:
        path: The file; its first line names the columns: a time, fx, fy and fz.
        mounting: Mounting of the sensor.
        latency_ns: Age of a sample at its recorded time [ns].

    Raises:
        ReferenceSensorError: A column is missing, a line is no sample, or the times do not increase.
    """
    samples = []
    try:
        with path.open(newline="", encoding="utf-8") as file:
            lines = iter(partial(file.readline, _MAX_LINE_CHARACTERS), "")
            rows = csv.DictReader(lines, skipinitialspace=True)
            rows.fieldnames = names = [name.strip() for name in rows.fieldnames or ()]
            time = next((name for name in NS_PER_TIME_COLUMN_UNIT if name in names), None)
            if time is None or not {"fx", "fy", "fz"} <= set(names):
                wanted = f"one of {', '.join(NS_PER_TIME_COLUMN_UNIT)}, and fx, fy, fz"
                raise ReferenceSensorError(
                    f"{path}: its first line names {', '.join(names)[:60]}; it needs {wanted}"
                )
            columns = (time, "fx", "fy", "fz")
            for row in rows:
                sample = plausible_values(columns, [row[column] for column in columns])
                if sample is None:
                    raise ReferenceSensorError(
                        f"{path}, line {rows.line_num}: is not four numbers that a sensor can send"
                    )
                samples.append(sample)
    except OSError as error:
        raise ReferenceSensorError(f"{path}: cannot be read: {error.strerror}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise ReferenceSensorError(f"{path}: is no CSV: {error}") from None
    values = np.array(samples, np.float64).reshape(-1, 4)
    t_ns = np.rint(values[:, 0] * NS_PER_TIME_COLUMN_UNIT[time]).astype(np.int64)
    if len(t_ns) == 0 or (np.diff(t_ns) <= 0).any():
        raise ReferenceSensorError(f"{path}: holds no samples, or not in the order of their times")
    force_n, saturated = mounting.to_foot_force_n(values[:, 1:])
    return ReferenceSamples(t_ns - latency_ns, force_n, saturated)
