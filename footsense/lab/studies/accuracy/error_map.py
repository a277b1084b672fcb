"""Study `error-map`: where on the ball the released network errs, and by how much on the 180 cases.

Source:
    Aoyagi et al., Figs. 18 and 19.
"""

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import NDArray

from footsense.foot.directions import angles_between_deg, directions
from footsense.foot.force_errors import GRAM_FORCE_N, magnitude_errors_gf
from footsense.foot.specimen import Foot
from footsense.lab.ball import circle, rim, touch
from footsense.lab.evaluation.evaluate import PAPER_DIRECTION_DEG, PAPER_MAGNITUDE_GF
from footsense.lab.studies.page import Figures, Study, StudyContext, panels
from footsense.lab.training.load_cases import (
    BASELINE_NOISE_PF,
    NOISE_PF,
    Cases,
    measured_closure_rel,
    paper_verification,
    sensed_closure_um,
)

Vector = NDArray[np.float64]

_MAP, _HISTOGRAM = "error-map.png", "error-histogram.png"
#: The paper's errors in the experiment, section V C [deg, gf].
EXPERIMENT_DEG, EXPERIMENT_GF = 15.9, 18.7
MAGNITUDE_GF = 100.0
#: Lowest elevation that is computed, a little below the rim of the map [deg].
_LOWEST_DEG = 26.0
#: Steps of the map's colours, and its iso-lines [deg].
_LEVELS_DEG = (0.0, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0)
#: Points along a side of the map, and draws of the noise.
_POINTS, _POINTS_QUICK = 91, 41
_DRAWS, _DRAWS_QUICK = 40, 8
_SEED = 19
#: Where the paper's circles are drawn, azimuth and elevation [deg].
_CIRCLES_AT_DEG = (0.0, 60.0)


def _disc(points: int) -> tuple[Vector, Vector]:
    """Return right and up of a grid that covers the map and a little more, shapes (points, points)."""
    radius = rim(_LOWEST_DEG)
    along = np.linspace(-radius, radius, points)
    right, up = np.meshgrid(along, along)
    return right, up


def _normals(right: Vector, up: Vector) -> Vector:
    """Return the inward normals of points of the map: the inverse of `ball.touch`."""
    squared = right**2 + up**2
    return np.stack([-2.0 * up, -2.0 * right, 1.0 - squared], axis=-1) / (1.0 + squared)[..., None]


class ReadingErrors(NamedTuple):
    """Direction [deg] and magnitude [gf] errors of single noisy readings.

    Attributes:
        direction_deg: Angles [deg], shape (draws, n).
        magnitude_gf: Magnitude errors [gf], shape (draws, n).
    """

    direction_deg: Vector
    magnitude_gf: Vector


@dataclass(frozen=True, kw_only=True)
class Distribution:
    """Mean, 95th percentile and maximum of an error.

    Attributes:
        mean: Mean.
        p95: 95th percentile.
        largest: Maximum.
    """

    mean: float
    p95: float
    largest: float

    @classmethod
    def of(cls, values: Vector) -> Self:
        """Return the mean, 95th percentile and maximum of some errors."""
        return cls(mean=values.mean(), p95=float(np.percentile(values, 95)), largest=values.max())

    def __str__(self) -> str:
        return f"{self.mean:.2f}, {self.p95:.2f}, {self.largest:.2f}"


@dataclass(frozen=True, kw_only=True)
class Results:
    """The map without noise, and the verification cases.

    Attributes:
        noise_draws: Draws of the converter's noise.
        lowest_deg: Lowest elevation of the map [deg].
        map_mean_deg: Mean direction error over the map [deg].
        map_max_deg: Largest direction error on the map [deg].
        worst_azimuth_deg: Azimuth of the force of the largest error [deg].
        worst_elevation_deg: Elevation of the worst direction [deg].
        verification: Direction errors [deg] and magnitude errors [gf], by reading.
    """

    noise_draws: int
    lowest_deg: float
    map_mean_deg: float
    map_max_deg: float
    worst_azimuth_deg: float
    worst_elevation_deg: float
    verification: dict[str, tuple[Distribution, Distribution]]


def _read(context: StudyContext, cases: Cases, draws: int) -> ReadingErrors:
    """Return the errors of the released network, case by case.

    Args:
        context: The models.
        cases: The loads.
        draws: Number of noise draws; 0 for one reading without noise.
    """
    design, rng = context.response.design, np.random.default_rng(_SEED)
    direction, magnitude = [], []
    for _ in range(max(draws, 1)):
        closure_rel = cases.closure_um / design.gap_um
        if draws:
            closure_rel = measured_closure_rel(design, cases.closure_um, rng)
        read_n = context.network.force_n(closure_rel)
        direction.append(angles_between_deg(cases.force_n, read_n))
        magnitude.append(magnitude_errors_gf(cases.force_n, read_n))
    return ReadingErrors(np.stack(direction), np.stack(magnitude))


def _draw_map(axes: Axes, grid: tuple[Vector, Vector], error_deg: Vector, lowest_deg: float) -> ContourSet:
    """Draw the direction error [deg] with iso-lines and the paper's circles; return the filled contours."""
    filled = axes.contourf(
        *grid, error_deg, levels=_LEVELS_DEG, norm=BoundaryNorm(_LEVELS_DEG, 256), extend="max"
    )
    lines = axes.contour(*grid, error_deg, levels=_LEVELS_DEG[1:], colors="k", linewidths=0.4)
    for part in (filled, lines):
        part.set_clip_path(Circle((0.0, 0.0), rim(lowest_deg), transform=axes.transData))
    for elevation_deg in (lowest_deg, 50.0, 70.0):
        axes.plot(*circle(np.array([0.0, 0.0, 1.0]), 90.0 - elevation_deg), color="w", lw=0.8, ls=":")
        right, up = touch(directions(np.array([-160.0]), np.array([elevation_deg]))[0])
        axes.text(
            float(right), float(up), f"{elevation_deg:g} deg", fontsize=8, color="w", ha="center", va="top"
        )
    (middle,) = directions(*np.array(_CIRCLES_AT_DEG)[:, None])
    for radius_deg, style in ((PAPER_DIRECTION_DEG, "-"), (EXPERIMENT_DEG, "--")):
        axes.plot(*circle(middle, radius_deg), "r" + style, lw=1.8, label=f"{radius_deg} deg")
    axes.set(aspect="equal", xticks=[], yticks=[], frame_on=False, xlabel="rear")
    return filled


def _map_figure(grid: tuple[Vector, Vector], maps: dict[str, Vector], lowest_deg: float) -> Figure:
    """Draw the maps side by side, on one scale."""
    figure = Figure(figsize=(8.6, 4.7), layout="constrained")
    row = figure.subplots(1, len(maps))
    for axes, (name, error_deg) in zip(row, maps.items(), strict=True):
        filled = _draw_map(axes, grid, error_deg, lowest_deg)
        axes.set_title(f"{name}\nforward", fontsize=10)
    row[0].set_ylabel("right")
    row[-1].yaxis.set_label_position("right")
    row[-1].set_ylabel("left")
    row[0].legend(title="the paper's mean error", fontsize=8, title_fontsize=8, loc="lower left")
    figure.colorbar(filled, ax=list(row), label="direction error [deg]", shrink=0.8)
    return figure


def _histogram_figure(readings: dict[str, ReadingErrors]) -> Figure:
    """Draw the histograms of both errors on the 180 cases."""
    figure, row = panels(2, 8.6, 3.6)
    papers = ((PAPER_DIRECTION_DEG, EXPERIMENT_DEG), (PAPER_MAGNITUDE_GF, EXPERIMENT_GF))
    for axes, what, unit, marks in zip(
        row, ("direction_deg", "magnitude_gf"), ("deg", "gf"), papers, strict=True
    ):
        bins = np.geomspace(1e-3, 40.0, 60).tolist()
        for name, one in readings.items():
            values = np.clip(getattr(one, what).ravel(), bins[0], bins[-1])
            share = np.full(len(values), 100.0 / len(values))
            axes.hist(values, bins, weights=share, histtype="stepfilled", alpha=0.5, label=name)
        for mark, style, where in zip(marks, ("-", "--"), ("simulation", "experiment"), strict=True):
            axes.axvline(mark, color="r", ls=style, label=f"the paper's mean, {where}")
        axes.set(xscale="log", xlabel=f"{what.split('_')[0]} error [{unit}]", ylabel="share of readings [%]")
        axes.xaxis.set_major_formatter("{x:g}")
    axes.legend(fontsize=7, loc="upper left")
    return figure


def compute(context: StudyContext) -> tuple[Results, Figures]:
    """Read centred loads from all over the ball, and the 180 verification cases."""
    points, draws = (_POINTS_QUICK, _DRAWS_QUICK) if context.quick else (_POINTS, _DRAWS)
    right, up = _disc(points)
    normal = _normals(right, up)
    computed = normal[..., 2] >= np.sin(np.radians(_LOWEST_DEG))
    force_n = normal[computed] * MAGNITUDE_GF * GRAM_FORCE_N
    cases = Cases(force_n, sensed_closure_um(Foot(context.response), normal[computed], force_n))
    verification = paper_verification(context.response)
    maps, readings = {}, {}
    for name, n in (("without noise", 0), (f"with {1e3 * NOISE_PF:g} fF of noise", draws)):
        maps[name] = np.full(right.shape, np.nan)
        maps[name][computed] = _read(context, cases, n).direction_deg.mean(axis=0)
        readings[name] = _read(context, verification, n)
        context.say(f"error-map: {computed.sum()} directions {name}")
    lowest_deg = context.foot_design.loads.min_elevation_deg
    exact = np.where(normal[..., 2] >= np.sin(np.radians(lowest_deg)), maps["without noise"], np.nan)
    worst = normal.reshape(-1, 3)[np.nanargmax(exact)]
    results = Results(
        noise_draws=draws,
        lowest_deg=lowest_deg,
        map_mean_deg=float(np.nanmean(exact)),
        map_max_deg=float(np.nanmax(exact)),
        worst_azimuth_deg=float(np.degrees(np.arctan2(worst[1], worst[0]))),
        worst_elevation_deg=float(np.degrees(np.arcsin(worst[2]))),
        verification={
            name: (Distribution.of(one.direction_deg), Distribution.of(one.magnitude_gf))
            for name, one in readings.items()
        },
    )
    figures = {_MAP: _map_figure((right, up), maps, lowest_deg), _HISTOGRAM: _histogram_figure(readings)}
    return results, figures


STUDY = Study(
    name="error-map",
    title="Where the network errs",
    results=Results,
    compute=compute,
    names={"BASELINE_NOISE_PF": BASELINE_NOISE_PF},
)
