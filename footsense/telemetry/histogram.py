"""Histogram of a long run in constant memory, with mean and quantiles."""

import numpy as np

from footsense.frames import Vector


class Histogram:
    """Histogram with bins of equal width from 0; the last bin also counts all larger values.

    Args:
        width: Width of a bin.
        end: Upper end of the last one.
    """

    def __init__(self, width: float, end: float) -> None:
        self._width = width
        self._counts = np.zeros(round(end / width), np.int64)
        self._sum = 0.0

    def add(self, values: Vector) -> None:
        """Count the given non-negative values, shape (n,), in their bins."""
        bins = np.minimum((values / self._width).astype(np.int64), len(self._counts) - 1)
        np.add.at(self._counts, bins, 1)
        self._sum += float(values.sum())

    @property
    def total(self) -> int:
        """Number of values counted in all bins."""
        return int(self._counts.sum())

    @property
    def mean(self) -> float | None:
        """Mean of the values, None without any."""
        return self._sum / self.total if self.total else None

    def quantile(self, share: float) -> float | None:
        """Return the quantile at `share` to one bin's width; None without values.

        Example:
            >>> ages = Histogram(0.1, 10.0)
            >>> ages.add(np.arange(100) / 100)
            >>> round(ages.quantile(0.5), 3)
            0.5
        """
        if not self.total:
            return None
        rank = np.searchsorted(self._counts.cumsum(), share * self.total)
        return float((rank + 1) * self._width)
