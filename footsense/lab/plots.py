"""Plot helper of the studies: a row of panels."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure


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
