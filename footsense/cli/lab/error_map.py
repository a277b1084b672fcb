"""Picture of `footsense test-stand evaluate --map`: direction errors over the ball (the paper's Fig. 19)."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure

from footsense.foot.directions import angles_between_deg
from footsense.frames import Vector
from footsense.lab.ball import map_circle, map_position

#: The paper's mean error in the experiment, section V C [deg].
PAPER_DEG = 15.9
#: Steps of the map's colours [deg].
_COLOUR_LEVELS_DEG = (0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 15.0, 20.0, 30.0)
#: Centre of the circles of the mean error, as in the paper's Fig. 19: a contact half way down the ball.
_MEAN_ERROR_CIRCLE_CENTRE = np.array([np.cos(np.radians(60.0)), 0.0, np.sin(np.radians(60.0))])
_MAP_CIRCLE_ELEVATIONS_DEG = (30.0, 50.0, 70.0)


def write_error_map(path: Path, reference_n: Vector, estimates_n: Mapping[str, Vector]) -> None:
    """Write maps of the direction errors over the ball, one per source: a dot per load, in the force's direction.

    Args:
        path: The picture.
        reference_n: Forces of the reference [N], shape (n, 3).
        estimates_n: Estimates by source [N], same shape.
    """
    figure = Figure(figsize=(4.3 * len(estimates_n) + 0.9, 4.9), layout="constrained")
    magnitude_n = np.linalg.norm(reference_n, axis=1)
    direction = reference_n / magnitude_n[:, None]
    # Heavy loads are drawn first, so that smaller dots in the same direction stay visible.
    order = np.argsort(-magnitude_n)
    row = np.atleast_1d(figure.subplots(1, len(estimates_n)))
    for axes, (name, force_n) in zip(row, estimates_n.items(), strict=True):
        error_deg = angles_between_deg(reference_n, force_n)
        for elevation_deg in _MAP_CIRCLE_ELEVATIONS_DEG:
            circle = map_circle(np.array([0.0, 0.0, 1.0]), 90.0 - elevation_deg)
            axes.plot(*circle, color="0.6", lw=0.7, ls=":")
        dots = axes.scatter(
            *map_position(direction[order]),
            s=8.0 + 45.0 * magnitude_n[order],
            c=error_deg[order],
            norm=BoundaryNorm(_COLOUR_LEVELS_DEG, 256, extend="max"),
            edgecolors="k",
            linewidths=0.3,
        )
        for mean_deg, style, whose in (
            (float(error_deg.mean()), "r-", "mean"),
            (PAPER_DEG, "r--", "the paper's"),
        ):
            circle = map_circle(_MEAN_ERROR_CIRCLE_CENTRE, mean_deg)
            axes.plot(*circle, style, label=f"{whose}, {mean_deg:.2f} deg")
        axes.set(
            aspect="equal", xticks=[], yticks=[], frame_on=False, title=f"{name}\nforward", xlabel="rear"
        )
        axes.legend(fontsize=8, loc="lower left")
    figure.colorbar(dots, ax=list(row), label="direction error [deg]", shrink=0.8)
    figure.savefig(path, dpi=110, bbox_inches="tight", metadata={"Software": None})
