"""Mean, standard deviation and range of a figure over seeds or feet, and differences of means."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

#: A difference is significant from this many of its standard errors on.
SIGNIFICANT_STANDARD_ERRORS = 2.0


class MeanDifference(NamedTuple):
    """Difference of two means with its standard error.

    Attributes:
        difference: First mean minus the second, in the unit of the figure.
        standard_error: Standard error of the difference.
    """

    difference: float
    standard_error: float

    @property
    def significant_sign(self) -> int:
        """Sign of the difference, 1 or -1; 0 if it is not significant."""
        significant = abs(self.difference) > SIGNIFICANT_STANDARD_ERRORS * self.standard_error
        return int(np.sign(self.difference)) if significant else 0


@dataclass(frozen=True, slots=True, kw_only=True)
class MeanStd:
    """Mean, standard deviation and range of a figure over n seeds or feet, in the figure's unit.

    Attributes:
        mean: Mean.
        std: Standard deviation of one value.
        lowest: Smallest value.
        highest: Largest value.
        n: Values, at least 2.
    """

    mean: float
    std: float
    lowest: float
    highest: float
    n: int

    @classmethod
    def of_values(cls, figures: Iterable[float]) -> Self:
        """Return mean, standard deviation and range of the given values.

        Example:
            >>> print(MeanStd.of_values([1.0, 2.0, 3.0]))
            2.00 ± 1.00
        """
        values = np.array(list(figures))
        return cls(
            mean=float(values.mean()),
            std=float(values.std(ddof=1)),
            lowest=float(values.min()),
            highest=float(values.max()),
            n=len(values),
        )

    def difference_from(self, other: "MeanStd") -> MeanDifference:
        """Return this mean minus another, with the standard error of the difference.

        Example:
            >>> few, many = MeanStd.of_values([3.0, 5.0]), MeanStd.of_values([1.0, 1.0])
            >>> few.difference_from(many)
            MeanDifference(difference=3.0, standard_error=1.0)
        """
        error = np.sqrt(self.std**2 / self.n + other.std**2 / other.n)
        return MeanDifference(self.mean - other.mean, float(error))

    def __str__(self) -> str:
        return f"{self.mean:.2f} ± {self.std:.2f}"
