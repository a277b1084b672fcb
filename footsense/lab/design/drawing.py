"""The picture of a design: range against error against size, and the range of the chosen feet over the elevation."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from footsense.lab.design.assess import ELEVATIONS_DEG
from footsense.lab.design.choice import Choice
from footsense.lab.design.wishes import Wishes
from footsense.lab.studies.plots import panels

if TYPE_CHECKING:
    from footsense.lab.design.design import DesignedFoot

#: Points of the cloud that are drawn.
_DRAWN = 6000


def draw(path: Path, choice: Choice, chosen: Sequence["DesignedFoot"], wishes: Wishes) -> None:
    """Write the picture.

    Args:
        path: PNG to write.
        choice: The candidates.
        chosen: The chosen feet.
        wishes: The input.
    """
    figure, (cloud, directions) = panels(2, 10.0, 4.4)
    feet, screened = choice.feet, choice.screened
    works = np.flatnonzero(np.isfinite(screened.direction_deg))
    shown = np.random.default_rng(1).permutation(works)[:_DRAWN]
    diameter = 2.0 * feet.ball_radius_mm
    colour = cloud.scatter(
        screened.range_n[shown],
        screened.direction_deg[shown],
        c=diameter[shown],
        s=3,
        alpha=0.35,
        lw=0,
        cmap="viridis",
    )
    cloud.scatter(
        *(screened.range_n[choice.front], screened.direction_deg[choice.front]),
        c=diameter[choice.front],
        s=14,
        edgecolors="black",
        linewidths=0.4,
        cmap="viridis",
        vmin=float(diameter[shown].min()),
        vmax=float(diameter[shown].max()),
        label="Pareto front",
    )
    for foot in chosen:
        name, row = foot.name, foot.row
        cloud.plot(screened.range_n[row], screened.direction_deg[row], "r*", ms=11)
        cloud.annotate(
            name,
            (screened.range_n[row], screened.direction_deg[row]),
            textcoords="offset points",
            xytext=(6, 4),
        )
    cloud.axvline(wishes.max_n, color="grey", ls=":", lw=1)
    cloud.axhline(wishes.error_deg, color="grey", ls=":", lw=1)
    cloud.set(
        xscale="log", yscale="log", xlabel="range [N]", ylabel="direction, Cramer-Rao bound, mean [deg rms]"
    )
    cloud.legend(loc="upper left")
    figure.colorbar(colour, ax=cloud, label="diameter of the ball [mm]")
    for foot in chosen:
        directions.plot(ELEVATIONS_DEG, foot.figures.range_n, "o-", ms=4, label=foot.name)
    directions.axhline(wishes.max_n, color="grey", ls=":", lw=1)
    directions.set(xlabel="elevation of the force [deg]", ylabel="range [N]", ylim=(0.0, None))
    directions.legend()
    figure.savefig(path, dpi=110)
