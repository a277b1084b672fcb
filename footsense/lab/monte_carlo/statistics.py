"""How much a figure hangs on the start weights: mean and spread over networks that differ in nothing else."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Self

import numpy as np


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """Mean and spread of a figure over the seeds, in the figure's unit.

    Attributes:
        mean: Mean.
        deviation: Standard deviation of one network.
        lowest: Of all.
        highest: Of all.
        n: Seeds, at least 2.
    """

    mean: float
    deviation: float
    lowest: float
    highest: float
    n: int

    @classmethod
    def over(cls, figures: Iterable[float]) -> Self:
        """Return the spread of figures, one of each seed.

        Example:
            >>> print(Spread.over([1.0, 2.0, 3.0]))
            2.00 ± 1.00
        """
        values = np.array(list(figures))
        return cls(
            mean=float(values.mean()),
            deviation=float(values.std(ddof=1)),
            lowest=float(values.min()),
            highest=float(values.max()),
            n=len(values),
        )

    def excess(self, other: "Spread") -> tuple[float, float]:
        """Return how much larger this mean is than another, and the standard error of that difference.

        Example:
            >>> few, many = Spread.over([3.0, 5.0]), Spread.over([1.0, 1.0])
            >>> few.excess(many)
            (3.0, 1.0)
        """
        error = np.sqrt(self.deviation**2 / self.n + other.deviation**2 / other.n)
        return self.mean - other.mean, float(error)

    def __str__(self) -> str:
        return f"{self.mean:.2f} ± {self.deviation:.2f}"

    def json(self) -> dict[str, float]:
        """Return the spread as JSON values."""
        return asdict(self)
