"""Result page of `footsense evaluate --out`: error table and the paper's Figs. 17 to 19; needs matplotlib."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure

from footsense.calibration.evaluation import Evaluation
from footsense.cli.calibration import ERROR_COLUMNS, ErrorRow
from footsense.foot.directions import angles_between_deg, azimuth_elevation_deg, directions, normalized
from footsense.foot.force_errors import GRAM_FORCE_N, magnitude_errors_gf
from footsense.foot.parameters import FootParameters
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Deviations, Foot
from footsense.frames import ELEMENTS, ROWS, Vector
from footsense.lab.ball import elevation_circle_map_radius, map_circle, map_position
from footsense.lab.template import render

#: The paper's mean errors in the experiment, section V C [deg, gf].
PAPER_DEG, PAPER_GF = 15.9, 18.7

#: Steps of the map's colours [deg].
_COLOUR_LEVELS_DEG = (0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 15.0, 20.0, 30.0)
#: Centre of the circles of the mean error, as in the paper's Fig. 19: a contact half way down the ball.
_MEAN_ERROR_CIRCLE_CENTRE = np.array([np.cos(np.radians(60.0)), 0.0, np.sin(np.radians(60.0))])
_MAP_CIRCLE_ELEVATIONS_DEG = (30.0, 50.0, 70.0)


def error_map_figure(reference_n: Vector, estimates_n: Mapping[str, Vector]) -> Figure:
    """Return maps of the direction errors over the ball, one per source: a dot per load, in the force's direction.

    Args:
        reference_n: Forces of the reference [N], shape (n, 3).
        estimates_n: Estimates by source [N], same shape.
    """
    figure = Figure(figsize=(4.3 * len(estimates_n) + 0.9, 4.9), layout="constrained")
    row = np.atleast_1d(figure.subplots(1, len(estimates_n)))
    magnitude_n = np.linalg.norm(reference_n, axis=1)
    direction = reference_n / magnitude_n[:, None]
    # Heavy loads are drawn first, so that smaller dots in the same direction stay visible.
    order = np.argsort(-magnitude_n)
    for axes, (name, force_n) in zip(row, estimates_n.items(), strict=True):
        error_deg = angles_between_deg(reference_n, force_n)
        for elevation_deg in _MAP_CIRCLE_ELEVATIONS_DEG:
            axes.plot(
                *map_circle(np.array([0.0, 0.0, 1.0]), 90.0 - elevation_deg), color="0.6", lw=0.7, ls=":"
            )
            axes.text(
                0.0,
                elevation_circle_map_radius(elevation_deg),
                f"{elevation_deg:g} deg",
                fontsize=7,
                color="0.4",
                ha="center",
            )
        dots = axes.scatter(
            *map_position(direction[order]),
            s=8.0 + 45.0 * magnitude_n[order],
            c=error_deg[order],
            norm=BoundaryNorm(_COLOUR_LEVELS_DEG, 256, extend="max"),
            edgecolors="k",
            linewidths=0.3,
        )
        mean_deg = float(error_deg.mean())
        axes.plot(
            *map_circle(_MEAN_ERROR_CIRCLE_CENTRE, mean_deg), "r-", lw=1.8, label=f"mean, {mean_deg:.2f} deg"
        )
        axes.plot(
            *map_circle(_MEAN_ERROR_CIRCLE_CENTRE, PAPER_DEG),
            "r--",
            lw=1.2,
            label=f"the paper's, {PAPER_DEG} deg",
        )
        axes.set(aspect="equal", xticks=[], yticks=[], frame_on=False, xlabel="rear")
        axes.set_title(f"{name}\nforward", fontsize=10)
        axes.legend(fontsize=8, loc="lower left")
    row[0].set_ylabel("right")
    row[-1].yaxis.set_label_position("right")
    row[-1].set_ylabel("left")
    figure.colorbar(dots, ax=list(row), label="direction error [deg]", shrink=0.8)
    return figure


def error_histograms_figure(reference_n: Vector, estimates_n: Mapping[str, Vector]) -> Figure:
    """Return histograms of the force errors; arguments as of `error_map_figure`."""
    figure = Figure(figsize=(8.6, 3.6), layout="constrained")
    kinds = (
        (angles_between_deg, "direction error [deg]", PAPER_DEG),
        (magnitude_errors_gf, "magnitude error [gf]", PAPER_GF),
    )
    for axes, (error_of, label, paper) in zip(figure.subplots(1, 2), kinds, strict=True):
        errors = {name: error_of(reference_n, force_n) for name, force_n in estimates_n.items()}
        most = max(paper, *(float(values.max()) for values in errors.values()))
        bins = np.linspace(0.0, 1.02 * most, 41)
        for name, values in errors.items():
            share = np.full(len(values), 100.0 / len(values))
            axes.hist(values, bins, weights=share, histtype="stepfilled", alpha=0.5, label=name)
        axes.axvline(paper, color="r", ls="--", label="the paper's mean")
        axes.set(xlabel=label, ylabel="share of loads [%]")
        axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    return figure


def closure_patterns_figure(closures_um: Mapping[str, Mapping[str, Vector]]) -> Figure:
    """Return a bar chart of all elements' gap closures under each load, front row first.

    Args:
        closures_um: Closures by load and source [um], shape (elements,) each; all loads have the same sources.
    """
    figure = Figure(figsize=(8.6, 2.2 * len(closures_um) + 0.6), layout="constrained")
    panels = np.atleast_1d(figure.subplots(len(closures_um), 1))
    for axes, (title, by_source) in zip(panels, closures_um.items(), strict=True):
        width = 0.8 / len(by_source)
        for number, (name, closure_um) in enumerate(by_source.items()):
            axes.bar(np.arange(ELEMENTS) - 0.4 + (number + 0.5) * width, closure_um, width, label=name)
        axes.set_title(title, fontsize=10)
        axes.set_ylabel("closure [um]")
        axes.set_xticks(np.arange(ELEMENTS), [f"{i} {j}" for i in range(ROWS) for j in range(ROWS)])
        for edge in np.arange(ROWS, ELEMENTS, ROWS) - 0.5:
            axes.axvline(edge, color="0.8", lw=0.8)
        axes.grid(axis="y", alpha=0.3)
    axes.set_xlabel("row and column: 0 0 is the front left, 2 2 the rear right")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=3, fontsize=8)
    return figure


_MAP, _HISTOGRAMS, _PATTERNS = "error-map.png", "errors.png", "patterns.png"

#: Azimuth and elevation of the loads whose patterns are shown [deg]: that of Fig. 17, two others, and straight up.
_PATTERN_DIRECTIONS_DEG = ((0.0, 45.0), (90.0, 60.0), (225.0, 60.0), (0.0, 90.0))


def write_page(
    folder: Path,
    figures: dict[str, Any],
    rows: Sequence[ErrorRow],
    warnings: Sequence[str],
    evaluation: Evaluation,
    foot: FootParameters | None,
    response: FootResponse,
) -> Path:
    """Write the result page, its figures and its JSON; return the page's path.

    Args:
        folder: Existing folder.
        figures: The numbers.
        rows: Those of the table.
        warnings: Warnings about recordings and calibration.
        evaluation: The forces.
        foot: Parameters of the calibration; None without one.
        response: Response table of the foot's type.
    """
    compared = evaluation.is_compared
    estimates_n = {source: one.force_n[compared] for source, one in evaluation.estimates.items()}
    reference_n = evaluation.reference_n[compared]
    drawn = {
        _MAP: error_map_figure(reference_n, estimates_n),
        _HISTOGRAMS: error_histograms_figure(reference_n, estimates_n),
        _PATTERNS: closure_patterns_figure(_closure_patterns_um(evaluation, foot, response)),
    }
    for name, figure in drawn.items():
        figure.savefig(folder / name, dpi=110, bbox_inches="tight", metadata={"Software": None})
    stem = figures["foot"]
    (folder / f"{stem}.json").write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    header = [title for column in ERROR_COLUMNS for title in column.headings]
    cells = [[cell for column in ERROR_COLUMNS for cell in column.cells(row)] for row in rows]
    names = {"figures": figures, "header": header, "rows": cells, "warnings": warnings}
    page = folder / f"{stem}.md"
    page.write_text(render(__name__, names) + "\n", encoding="utf-8")
    return page


def _closure_patterns_um(
    evaluation: Evaluation, foot: FootParameters | None, response: FootResponse
) -> dict[str, dict[str, Vector]]:
    """Return measured and simulated gap closures under some of the loads [um], by load and source."""
    reference_n = evaluation.reference_n
    direction = normalized(reference_n)
    specimen, normal = Foot(response), direction
    if foot is not None:  # strays cancel in closures
        deviations = Deviations(
            gap_um=foot.gap_um - response.design.gap_um, stiffness_rel=foot.stiffness_rel, mount=foot.mount
        )
        specimen, normal = Foot(response, deviations), direction @ foot.mount.T
    simulated = evaluation.is_compared & (normal[:, 2] > np.sin(np.radians(response.min_elevation_deg)))
    chosen = dict.fromkeys(
        int(np.where(simulated, direction @ directions(*shown_deg), -np.inf).argmax())
        for shown_deg in _PATTERN_DIRECTIONS_DEG
    )
    shown: dict[str, dict[str, Vector]] = {}
    for row in chosen:
        loaded_pf = specimen.capacitance_pf(direction[row][None], reference_n[row][None])[0]
        shown[_load_title(reference_n[row])] = {
            f"measured, {source}": response.design.gap_um * one.closure_rel[row]
            for source, one in evaluation.estimates.items()
        } | {"simulated": response.design.closure_um(loaded_pf, specimen.unloaded_pf)}
    return shown


def _load_title(force_n: Vector) -> str:
    """Return a load's direction and magnitude as text."""
    azimuth_deg, elevation_deg = azimuth_elevation_deg(force_n)
    return (
        f"{np.linalg.norm(force_n) / GRAM_FORCE_N:.0f} gf from ({azimuth_deg:.0f}, {elevation_deg:.0f}) deg"
    )
