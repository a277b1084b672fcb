"""Frame of the studies that are not yet a page of the report in its present form."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from footsense.lab.report import Figures, StudyContext

Plots = Figures

__all__ = ["MeanStd", "Plots", "Study", "StudyContext"]


@dataclass(frozen=True, slots=True, kw_only=True)
class MeanStd:
    """Mean, standard deviation of a sample and range of n values."""

    mean: float
    std: float
    lowest: float
    highest: float
    n: int

    @classmethod
    def of_values(cls, figures: Iterable[float]) -> Self:
        """Return mean, standard deviation and range of the given values."""
        values = np.array(list(figures))
        mean, std = float(values.mean()), float(values.std(ddof=1))
        return cls(mean=mean, std=std, lowest=float(values.min()), highest=float(values.max()), n=len(values))

    def __str__(self) -> str:
        return f"{self.mean:.2f} ± {self.std:.2f}"


@dataclass(frozen=True, kw_only=True)
class Study:
    """A study, its title, and the names that its template uses."""

    name: str
    title: str
    compute: Callable[[StudyContext], tuple[Any, Plots]]
    template_names: dict[str, Any] = field(default_factory=dict)
    command: str = ""
    uses_network: bool = True
