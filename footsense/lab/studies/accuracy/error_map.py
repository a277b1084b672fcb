"""Study `error-map`: the released network's error by contact point on the ball, and on the 180 cases.

Source:
    Aoyagi et al., Figs. 18 and 19.
"""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from footsense.foot.directions import angles_between_deg, directions
from footsense.foot.force_errors import GRAM_FORCE_N, ForceErrors, evaluate_force_errors, magnitude_errors_gf
from footsense.foot.specimen import Foot
from footsense.frames import Vector
from footsense.lab.ball import elevation_circle_map_radius, map_circle, map_position
from footsense.lab.evaluation.evaluate import (
    MEASURED_DIRECTION_DEG,
    MEASURED_MAGNITUDE_GF,
    PAPER_DIRECTION_DEG,
    PAPER_MAGNITUDE_GF,
)
from footsense.lab.former_page import Plots, Study, StudyContext
from footsense.lab.plots import subplot_row
from footsense.lab.training.load_cases import (
    BASELINE_NOISE_PF,
    NOISE_PF,
    Cases,
    measured_closure_rel,
    paper_verification,
    sensed_closure_um,
)

MAGNITUDE_GF = 100.0
#: Lowest elevation that is computed, a little below the rim of the map [deg].
_MIN_COMPUTED_ELEVATION_DEG = 26.0
#: Steps of the map's colours, and its iso-lines [deg].
_COLOUR_LEVELS_DEG = (0.0, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0)
#: Points along a side of the map, and draws of the noise.
_POINTS, _POINTS_QUICK = 91, 41
_DRAWS, _DRAWS_QUICK = 40, 8
_SEED = 19
#: Where the paper's circles are drawn, azimuth and elevation [deg].
_PAPER_ERROR_CIRCLE_CENTRE_DEG = (0.0, 60.0)


def _map_normals(right: Vector, up: Vector) -> Vector:
    """Return the inward normals at points of the map: the inverse of the map projection."""
    squared = right**2 + up**2
    return np.stack([-2.0 * up, -2.0 * right, 1.0 - squared], axis=-1) / (1.0 + squared)[..., None]


@dataclass(frozen=True, kw_only=True)
class Results:
    """Results of the study `error-map`: noiseless direction errors on the map, and errors of the 180 cases.

    Attributes:
        n_noise_draws: Draws of the converter's noise.
        map_min_elevation_deg: Lowest elevation of the map [deg].
        map_mean_error_deg: Mean direction error over the map [deg].
        map_max_error_deg: Largest direction error on the map [deg].
        max_error_azimuth_deg: Azimuth of the force of the largest error [deg].
        max_error_elevation_deg: Elevation of the worst direction [deg].
        verification_errors_by_noise: Errors on the verification cases, by reading.
    """

    n_noise_draws: int
    map_min_elevation_deg: float
    map_mean_error_deg: float
    map_max_error_deg: float
    max_error_azimuth_deg: float
    max_error_elevation_deg: float
    verification_errors_by_noise: dict[str, ForceErrors]


def _estimated_forces_n(context: StudyContext, cases: Cases, n_noise_draws: int) -> Vector:
    """Return the released network's force estimates [N] for load cases, shape (draws, n, 3).

    Args:
        context: The models.
        cases: The loads.
        n_noise_draws: Number of noise draws; 0 for one reading without noise.
    """
    design, rng = context.response.design, np.random.default_rng(_SEED)
    closures_rel = [measured_closure_rel(design, cases.closure_um, rng) for _ in range(n_noise_draws)]
    return np.stack(
        [context.network.force_n(one) for one in closures_rel or [cases.closure_um / design.gap_um]]
    )


def _draw_map(
    axes: Axes, grid: tuple[Vector, Vector], error_deg: Vector, lowest_elevation_deg: float
) -> ContourSet:
    """Draw the direction error [deg] with iso-lines and the paper's circles; return the filled contours."""
    filled = axes.contourf(
        *grid, error_deg, levels=_COLOUR_LEVELS_DEG, norm=BoundaryNorm(_COLOUR_LEVELS_DEG, 256), extend="max"
    )
    lines = axes.contour(*grid, error_deg, levels=_COLOUR_LEVELS_DEG[1:], colors="k", linewidths=0.4)
    for part in (filled, lines):
        part.set_clip_path(
            Circle((0.0, 0.0), elevation_circle_map_radius(lowest_elevation_deg), transform=axes.transData)
        )
    for elevation_deg in (lowest_elevation_deg, 50.0, 70.0):
        axes.plot(*map_circle(np.array([0.0, 0.0, 1.0]), 90.0 - elevation_deg), color="w", lw=0.8, ls=":")
        right, up = map_position(directions(np.array([-160.0]), np.array([elevation_deg]))[0])
        axes.text(
            float(right), float(up), f"{elevation_deg:g} deg", fontsize=8, color="w", ha="center", va="top"
        )
    (middle,) = directions(*np.array(_PAPER_ERROR_CIRCLE_CENTRE_DEG)[:, None])
    for radius_deg, style in ((PAPER_DIRECTION_DEG, "-"), (MEASURED_DIRECTION_DEG, "--")):
        axes.plot(*map_circle(middle, radius_deg), "r" + style, lw=1.8, label=f"{radius_deg} deg")
    axes.set(aspect="equal", xticks=[], yticks=[], frame_on=False, xlabel="rear")
    return filled


def _map_figure(grid: tuple[Vector, Vector], maps: dict[str, Vector], lowest_elevation_deg: float) -> Figure:
    """Return the figure of several error maps side by side, on one colour scale."""
    figure = Figure(figsize=(8.6, 4.7), layout="constrained")
    row = figure.subplots(1, len(maps))
    for axes, (name, error_deg) in zip(row, maps.items(), strict=True):
        filled = _draw_map(axes, grid, error_deg, lowest_elevation_deg)
        axes.set_title(f"{name}\nforward", fontsize=10)
    row[0].set_ylabel("right")
    row[-1].yaxis.set_label_position("right")
    row[-1].set_ylabel("left")
    row[0].legend(title="the paper's mean error", fontsize=8, title_fontsize=8, loc="lower left")
    figure.colorbar(filled, ax=list(row), label="direction error [deg]", shrink=0.8)
    return figure


def _histogram_figure(readings: dict[str, tuple[Vector, Vector]]) -> Figure:
    """Return the figure of direction and magnitude error histograms on the 180 cases."""
    figure, row = subplot_row(2, 8.6, 3.6)
    bins = np.geomspace(1e-3, 40.0, 60).tolist()
    papers = ((PAPER_DIRECTION_DEG, MEASURED_DIRECTION_DEG), (PAPER_MAGNITUDE_GF, MEASURED_MAGNITUDE_GF))
    labels = ("direction error [deg]", "magnitude error [gf]")
    for axes, label, marks, both in zip(
        row, labels, papers, zip(*readings.values(), strict=True), strict=True
    ):
        for name, error in zip(readings, both, strict=True):
            values = np.clip(error, bins[0], bins[-1])
            share = np.full(len(values), 100.0 / len(values))
            axes.hist(values, bins, weights=share, histtype="stepfilled", alpha=0.5, label=name)
        for mark, style, where in zip(marks, ("-", "--"), ("simulation", "experiment"), strict=True):
            axes.axvline(mark, color="r", ls=style, label=f"the paper's mean, {where}")
        axes.set(xscale="log", xlabel=label, ylabel="share of readings [%]")
        axes.xaxis.set_major_formatter("{x:g}")
    axes.legend(fontsize=7, loc="upper left")
    return figure


def compute(context: StudyContext) -> tuple[Results, Plots]:
    """Return the network's errors on centred loads over the whole ball and on the 180 cases, with figures."""
    points, draws = (_POINTS_QUICK, _DRAWS_QUICK) if context.quick else (_POINTS, _DRAWS)
    along = np.linspace(
        -elevation_circle_map_radius(_MIN_COMPUTED_ELEVATION_DEG),
        elevation_circle_map_radius(_MIN_COMPUTED_ELEVATION_DEG),
        points,
    )
    right, up = np.meshgrid(along, along)
    normal = _map_normals(right, up)
    computed = normal[..., 2] >= np.sin(np.radians(_MIN_COMPUTED_ELEVATION_DEG))
    force_n = normal[computed] * MAGNITUDE_GF * GRAM_FORCE_N
    cases = Cases(force_n, sensed_closure_um(Foot(context.response), normal[computed], force_n))
    verification = paper_verification(context.response)
    maps, readings, drawn = {}, {}, {}
    for name, n in (("without noise", 0), (f"with {1e3 * NOISE_PF:g} fF of noise", draws)):
        maps[name] = np.full(right.shape, np.nan)
        maps[name][computed] = angles_between_deg(cases.force_n, _estimated_forces_n(context, cases, n)).mean(
            axis=0
        )
        read_n = _estimated_forces_n(context, verification, n).reshape(-1, 3)
        truth_n = np.tile(verification.force_n, (max(n, 1), 1))
        readings[name] = evaluate_force_errors(truth_n, read_n)
        drawn[name] = angles_between_deg(truth_n, read_n), magnitude_errors_gf(truth_n, read_n)
        context.report_progress(f"error-map: {computed.sum()} directions {name}")
    map_min_elevation_deg = context.foot_design.loads.min_elevation_deg
    exact = np.where(
        normal[..., 2] >= np.sin(np.radians(map_min_elevation_deg)), maps["without noise"], np.nan
    )
    worst = normal.reshape(-1, 3)[np.nanargmax(exact)]
    results = Results(
        n_noise_draws=draws,
        map_min_elevation_deg=map_min_elevation_deg,
        map_mean_error_deg=float(np.nanmean(exact)),
        map_max_error_deg=float(np.nanmax(exact)),
        max_error_azimuth_deg=float(np.degrees(np.arctan2(worst[1], worst[0]))),
        max_error_elevation_deg=float(np.degrees(np.arcsin(worst[2]))),
        verification_errors_by_noise=readings,
    )
    return results, {
        "error-map.png": _map_figure((right, up), maps, map_min_elevation_deg),
        "error-histogram.png": _histogram_figure(drawn),
    }


STUDY = Study(
    name="error-map",
    title="Where the network errs",
    compute=compute,
    template_names={"BASELINE_NOISE_PF": BASELINE_NOISE_PF},
)
