"""Plot helpers of the studies: a row of panels, and a mean line with a standard deviation band."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from footsense.lab.monte_carlo.statistics import MeanStd


def subplot_row(n: int, width: float, height: float, **options: Any) -> tuple[Figure, list[Axes]]:
    """Return a figure (size in inch) with n panels in a row, and their axes with grids.

    Args:
        n: How many.
        width: Width of the figure [inch].
        height: Height of the figure [inch].
        options: As for `Figure.subplots`.
    """
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = list(np.atleast_1d(figure.subplots(1, n, **options)))
    for one in axes:
        one.grid(alpha=0.3)
    return figure, axes


def plot_band(axes: Axes, x: Sequence[float], statistics: Sequence[MeanStd], **options: Any) -> None:
    """Plot means over x with a band of one standard deviation to either side."""
    mean, std = (np.array([getattr(one, name) for one in statistics]) for name in ("mean", "std"))
    (line,) = axes.plot(x, mean, "o-", ms=4, **options)
    axes.fill_between(x, mean - std, mean + std, color=line.get_color(), alpha=0.2, lw=0)
