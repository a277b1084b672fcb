"""The page of `footsense evaluate --out`: the table, and the paper's Figs. 17, 18 and 19 of one foot."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from footsense.calibration.evaluation import Evaluation
from footsense.cli.evaluate.figures import error_map, histograms, patterns
from footsense.cli.evaluate.summary import headline, table
from footsense.foot.directions import azimuth_elevation_deg, directions, normalized
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.parameters import FootParameters
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Deviations, Foot
from footsense.frames import Vector
from footsense.lab.template import render

_MAP, _HISTOGRAMS, _PATTERNS = "error-map.png", "errors.png", "patterns.png"

#: Azimuth and elevation of the loads whose patterns are shown [deg]: that of Fig. 17, two others, and straight up.
_SHOWN_DEG = ((0.0, 45.0), (90.0, 60.0), (225.0, 60.0), (0.0, 90.0))


def write_page(
    folder: Path,
    figures: dict[str, Any],
    warnings: Sequence[str],
    evaluation: Evaluation,
    foot: FootParameters | None,
    response: FootResponse,
) -> Path:
    """Write the page, its figures and its numbers, and return the page's path.

    Args:
        folder: Existing folder.
        figures: The numbers.
        warnings: Warnings about recordings and calibration.
        evaluation: The forces.
        foot: Parameters of the calibration; None without one.
        response: Response table of the foot's type.
    """
    compared = evaluation.compared
    estimates_n = {source: one.force_n[compared] for source, one in evaluation.estimates.items()}
    reference_n = evaluation.reference_n[compared]
    drawn = {
        _MAP: error_map(reference_n, estimates_n),
        _HISTOGRAMS: histograms(reference_n, estimates_n),
        _PATTERNS: patterns(_patterns(evaluation, foot, response)),
    }
    for name, figure in drawn.items():
        figure.savefig(folder / name, dpi=110, bbox_inches="tight", metadata={"Software": None})
    stem = figures["foot"]
    (folder / f"{stem}.json").write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    header, *rows = table(figures)
    names = {"headline": headline(figures), "header": header, "rows": rows, "warnings": warnings}
    page = folder / f"{stem}.md"
    page.write_text(render(__name__, names) + "\n", encoding="utf-8")
    return page


def _patterns(
    evaluation: Evaluation, foot: FootParameters | None, response: FootResponse
) -> dict[str, dict[str, Vector]]:
    """Return measured and simulated closures under some of the loads."""
    reference_n = evaluation.reference_n
    direction = normalized(reference_n)
    specimen, normal = Foot(response), direction
    if foot is not None:  # strays cancel in closures
        deviations = Deviations(
            gap_um=foot.gap_um - response.design.gap_um, stiffness_rel=foot.stiffness_rel, mount=foot.mount
        )
        specimen, normal = Foot(response, deviations), direction @ foot.mount.T
    simulated = evaluation.compared & (normal[:, 2] > np.sin(np.radians(response.min_elevation_deg)))
    chosen = dict.fromkeys(
        int(np.where(simulated, direction @ directions(*shown_deg), -np.inf).argmax())
        for shown_deg in _SHOWN_DEG
    )
    shown: dict[str, dict[str, Vector]] = {}
    for row in chosen:
        loaded_pf = specimen.capacitance_pf(direction[row][None], reference_n[row][None])[0]
        shown[_title(reference_n[row])] = {
            f"measured, {source}": response.design.gap_um * one.closure_rel[row]
            for source, one in evaluation.estimates.items()
        } | {"simulated": response.design.closure_um(loaded_pf, specimen.unloaded_pf)}
    return shown


def _title(force_n: Vector) -> str:
    azimuth_deg, elevation_deg = azimuth_elevation_deg(force_n)
    return (
        f"{np.linalg.norm(force_n) / GRAM_FORCE_N:.0f} gf from ({azimuth_deg:.0f}, {elevation_deg:.0f}) deg"
    )
