"""Plot of a design: range, error and size of all candidates, and range over elevation of the chosen feet."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.ticker import FuncFormatter

from footsense.lab.design.choice import Choice
from footsense.lab.design.foot_files import DesignedFoot
from footsense.lab.design.inputs.requirements import Requirements
from footsense.lab.design.prediction.assess import ELEVATIONS_DEG
from footsense.lab.plots import subplot_row

#: Numbers as they are on logarithmic axes; every second of the small ones is left out.
PLAIN_NUMBER_FORMATTER = FuncFormatter(lambda value, _: f"{value:g}" if f"{value:e}"[0] in "1235" else "")
#: Points of the cloud that are drawn.
_MAX_DRAWN_POINTS = 6000


def draw_design(
    path: Path, choice: Choice, chosen: Sequence[DesignedFoot], requirements: Requirements
) -> None:
    """Save the plot of range, error and size of all candidates, with the chosen feet marked.

    Args:
        path: PNG to write.
        choice: The candidates.
        chosen: The chosen feet.
        requirements: The input.
    """
    figure, (cloud, directions) = subplot_row(2, 10.0, 4.4)
    feet, screened = choice.manufacturable, choice.screened
    works = np.flatnonzero(np.isfinite(screened.direction_error_bound_deg))
    shown = np.random.default_rng(1).permutation(works)[:_MAX_DRAWN_POINTS]
    diameter = 2.0 * feet.ball_radius_mm
    colour = cloud.scatter(
        screened.range_n[shown],
        screened.direction_error_bound_deg[shown],
        c=diameter[shown],
        s=3,
        alpha=0.35,
        lw=0,
        cmap="viridis",
    )
    cloud.scatter(
        *(screened.range_n[choice.pareto_front], screened.direction_error_bound_deg[choice.pareto_front]),
        c=diameter[choice.pareto_front],
        s=14,
        edgecolors="black",
        linewidths=0.4,
        cmap="viridis",
        vmin=float(diameter[shown].min()),
        vmax=float(diameter[shown].max()),
        label="Pareto front",
    )
    for number, foot in enumerate(chosen):
        at = screened.range_n[foot.candidate_row], screened.direction_error_bound_deg[foot.candidate_row]
        cloud.plot(*at, "*", ms=13, mec="black", color=f"C{number}", label=foot.name, ls="none")
        directions.plot(
            ELEVATIONS_DEG, foot.figures.range_by_elevation_n, "o-", ms=4, color=f"C{number}", label=foot.name
        )
    cloud.axvline(requirements.max_n, color="grey", ls=":", lw=1)
    cloud.axhline(requirements.max_noise_direction_error_deg, color="grey", ls=":", lw=1)
    cloud.set(
        xscale="log", yscale="log", xlabel="range [N]", ylabel="direction, Cramer-Rao bound, mean [deg rms]"
    )
    cloud.legend(loc="upper left")
    for axis in (cloud.xaxis, cloud.yaxis):
        axis.set_major_formatter(PLAIN_NUMBER_FORMATTER)
        axis.set_minor_formatter(PLAIN_NUMBER_FORMATTER)
    cloud.tick_params(which="both", labelsize=8)
    bar = figure.colorbar(colour, ax=cloud, label="diameter of the ball [mm]")
    if bar.solids is not None:
        bar.solids.set_alpha(1.0)
    directions.axhline(requirements.max_n, color="grey", ls=":", lw=1)
    directions.set(xlabel="elevation of the force [deg]", ylabel="range [N]", ylim=(0.0, None))
    directions.legend()
    figure.savefig(path, dpi=110)
