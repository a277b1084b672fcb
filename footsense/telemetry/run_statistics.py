"""Statistics of a run: cycle rate, age of the forces, states, and force error where the true force is known.

The error is taken against the true force at the time of sending, so that a measurement's age counts. All statistics
are kept in fixed tables: a day of walking takes no more memory than a minute.
"""

from collections.abc import Callable

import numpy as np

from footsense.foot.directions import angles_between_deg
from footsense.frames import FAULT_FREE, IS_USABLE_STATE, Codes, Cycle, Stamps, State, Vector
from footsense.ports import Observer

#: Smallest true force of a loaded frame, whose direction is defined, over the feet's largest force [1].
LOADED_THRESHOLD_REL = 0.05

_MAGNITUDE_ERROR_BIN_REL = 0.001
_DIRECTION_ERROR_BIN_DEG = 0.02
_AGE_BIN_MS = 0.05
#: Cycles that are kept before they are added to the tables.
_CYCLES_PER_HISTOGRAM_BATCH = 256


class RunStatistics(Observer):
    """Observer that accumulates the statistics of a run.

    Args:
        legs: Name of the leg in each row of the frames.
        true_force_n_at: Returns the true force on each foot at a time [ns -> N, shape (legs, 3)]; None if unknown.
        max_n: Largest force of the feet [N].
        process_age_ns: Returns the time since the start of the process [ns].
    """

    def __init__(
        self,
        legs: tuple[str, ...],
        true_force_n_at: Callable[[int], Vector] | None,
        max_n: float = 2.0,
        process_age_ns: Callable[[], int] = int,
    ) -> None:
        self._process_age_ns = process_age_ns
        self._legs = legs
        self._loaded_n = LOADED_THRESHOLD_REL * max_n
        self._true_force_n_at = true_force_n_at
        self._cycles = 0
        self._process_age_s: float | None = None
        self._first_ns = self._last_ns = 0
        self._states = np.zeros((len(legs), len(State)), np.int64)
        self._age_ms = Histogram(_AGE_BIN_MS, 500.0)
        self._direction_deg = Histogram(_DIRECTION_ERROR_BIN_DEG, 180.0)
        self._magnitude_rel = Histogram(_MAGNITUDE_ERROR_BIN_REL, 2.0)
        self._squared_n2 = np.zeros(3)
        self._valid = 0
        #: State, age, force and true force of the legs in the cycles that are in no table yet.
        self._buffer: list[tuple[Codes, int, Stamps, Vector, Vector]] = []

    def observe(self, cycle: Cycle) -> None:
        """Add one cycle to the statistics."""
        forces = cycle.forces
        if self._cycles == 0:
            self._first_ns = forces.t_sent_ns
            self._process_age_s = self._process_age_ns() * 1e-9
        self._last_ns = forces.t_sent_ns
        self._cycles += 1
        true_n = self._true_force_n_at(forces.t_sent_ns) if self._true_force_n_at else forces.force_n
        self._buffer.append((forces.state, forces.t_sent_ns, forces.t_ns, forces.force_n, true_n))
        if len(self._buffer) >= _CYCLES_PER_HISTOGRAM_BATCH:
            self._add_buffered_cycles()

    def _add_buffered_cycles(self) -> None:
        """Add the buffered cycles to the tables; in a batch this is ten times faster."""
        if not self._buffer:
            return
        state, t_sent_ns, t_ns, force_n, true_n = map(np.array, zip(*self._buffer, strict=True))
        self._buffer.clear()
        np.add.at(self._states, (np.arange(len(self._legs)), state), 1)
        valid = IS_USABLE_STATE[state]
        self._valid += int(valid.sum())
        self._age_ms.add((t_sent_ns[:, None] - t_ns)[valid] * 1e-6)
        if self._true_force_n_at is None:
            return
        force_n, true_n = force_n[valid], true_n[valid]
        self._squared_n2 += np.square(force_n - true_n).sum(axis=0)
        size_n = np.linalg.norm(true_n, axis=1)
        loaded = (size_n >= self._loaded_n) & force_n.any(axis=1)
        self._direction_deg.add(angles_between_deg(true_n[loaded], force_n[loaded]))
        estimated_rel = np.linalg.norm(force_n[loaded], axis=1) / size_n[loaded]
        self._magnitude_rel.add(np.abs(estimated_rel - 1.0))

    def summary(self) -> dict[str, object]:
        """Return the statistics as plain values; None for a value without samples."""
        self._add_buffered_cycles()
        span_s = (self._last_ns - self._first_ns) * 1e-9
        summary: dict[str, object] = {
            "cycles": self._cycles,
            "start_to_first_frame_s": self._process_age_s,
            "cycle_rate_hz": (self._cycles - 1) / span_s if span_s > 0 else None,
            "age_ms": {"p50": self._age_ms.quantile(0.5), "p99": self._age_ms.quantile(0.99)},
            "states": {
                leg: {State(s).name.lower(): int(n) for s, n in enumerate(counts) if n}
                for leg, counts in zip(self._legs, self._states, strict=True)
            },
            "faulty_leg_cycles": int(self._states.sum() - self._states[:, sorted(FAULT_FREE)].sum()),
        }
        if self._true_force_n_at is not None:
            rmse_n = np.sqrt(self._squared_n2 / self._valid).tolist() if self._valid else [None] * 3
            summary["force_rmse_n"] = dict(zip("xyz", rmse_n, strict=True))
            summary["direction_error_deg"] = {
                "mean": self._direction_deg.mean,
                "p95": self._direction_deg.quantile(0.95),
                "loaded_frames": self._direction_deg.n_values,
                "loaded_from_n": self._loaded_n,
            }
            summary["magnitude_error_rel"] = {
                "mean": self._magnitude_rel.mean,
                "p95": self._magnitude_rel.quantile(0.95),
            }
        return summary


class Histogram:
    """Histogram with bins of equal width from 0; the last bin also counts all larger values.

    Args:
        bin_width: Width of a bin.
        end: Upper end of the last one.
    """

    def __init__(self, bin_width: float, end: float) -> None:
        self._width = bin_width
        self._counts = np.zeros(round(end / bin_width), np.int64)
        self._sum = 0.0

    def add(self, values: Vector) -> None:
        """Count non-negative values, shape (n,), in their bins."""
        bins = np.minimum((values / self._width).astype(np.int64), len(self._counts) - 1)
        np.add.at(self._counts, bins, 1)
        self._sum += float(values.sum())

    @property
    def n_values(self) -> int:
        """Number of values in all bins."""
        return int(self._counts.sum())

    @property
    def mean(self) -> float | None:
        """Mean of the values; None without any."""
        return self._sum / self.n_values if self.n_values else None

    def quantile(self, share: float) -> float | None:
        """Return the quantile at the fraction `share`, to one bin width; None without values.

        Example:
            >>> ages = Histogram(0.1, 10.0)
            >>> ages.add(np.arange(100) / 100)
            >>> round(ages.quantile(0.5), 3)
            0.5
        """
        if not self.n_values:
            return None
        rank = np.searchsorted(self._counts.cumsum(), share * self.n_values)
        return float((rank + 1) * self._width)
