"""The page that `footsense evaluate --out` writes: the table, and the paper's Figs. 17, 18 and 19 of one foot."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from footsense.calibration.evaluation import Evaluation
from footsense.cli.evaluate.command import CALIBRATED, DESIGN_ONLY, headline, rows
from footsense.cli.evaluate.figures import Pattern, error_map, histograms, patterns
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.parameters import FootParameters
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Deviations, Foot

Vector = NDArray[np.float64]

_MAP, _HISTOGRAMS, _PATTERNS = "error-map.png", "errors.png", "patterns.png"

#: The loads whose patterns are shown, azimuth and elevation [deg]: that of Fig. 17, two others, and straight up.
_SHOWN_DEG = ((0.0, 45.0), (90.0, 60.0), (225.0, 60.0), (0.0, 90.0))


def write_page(
    folder: Path,
    figures: dict[str, Any],
    warnings: Sequence[str],
    found: Evaluation,
    foot: FootParameters | None,
    table: Path,
) -> Path:
    """Write the page, its figures and its numbers, and return the page's path.

    Args:
        folder: Where to; it is there.
        figures: The numbers.
        warnings: What is missing of the recordings.
        found: The forces.
        foot: What the calibration says of the foot; None without one.
        table: The response table of the foot's type.
    """
    compared = found.compared
    read_n = {DESIGN_ONLY: found.design_only.force_n[compared]}
    if found.calibrated is not None:
        read_n[CALIBRATED] = found.calibrated.force_n[compared]
    truth_n = found.truth_n[compared]
    drawn = {
        _MAP: error_map(truth_n, read_n),
        _HISTOGRAMS: histograms(truth_n, read_n),
        _PATTERNS: patterns(_patterns(found, foot, FootResponse.load(table))),
    }
    for name, figure in drawn.items():
        figure.savefig(folder / name, dpi=110, bbox_inches="tight", metadata={"Software": None})
    stem = figures["foot"]
    (folder / f"{stem}.json").write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    header, *lines = rows(figures)
    rule = "|---|---|" + "---:|" * (len(header) - 2)
    body = "\n".join("| " + " | ".join(line) + " |" for line in lines)
    notes = "\n".join(f"- {line}" for line in warnings)
    page = folder / f"{stem}.md"
    page.write_text(
        f"""# {headline(figures)}

Mean and 95th percentile of the angle to the reference's force, and of the difference of the magnitudes, on the loads
that can be read either way.

| {" | ".join(header)} |
{rule}
{body}

{notes}

## Where on the ball

Each dot is a load, where it touches the ball, seen from below; heavier ones are larger. The red circle is the mean
error around a contact as in the paper's Fig. 19, the dashed one the paper's own.

![]({_MAP})

## How often which error

![]({_HISTOGRAMS})

## What the elements do

Closures as measured, and as the simulated foot has them under the reference's force; the paper's Fig. 17.

![]({_PATTERNS})
""",
        encoding="utf-8",
    )
    return page


def _patterns(found: Evaluation, foot: FootParameters | None, response: FootResponse) -> list[Pattern]:
    """Return what was measured under some of the loads beside what the simulated foot does under them."""
    size_n = np.linalg.norm(found.truth_n, axis=1)
    direction = found.truth_n / size_n[:, None]
    specimen = Foot(response) if foot is None else Foot(response, _described(foot, response))
    normal = direction if foot is None else direction @ foot.mount.T
    simulated = found.compared & (normal[:, 2] > np.sin(np.radians(response.min_elevation_deg)))
    chosen = dict.fromkeys(_nearest(direction, simulated, shown_deg) for shown_deg in _SHOWN_DEG)
    gap_um, shown = response.design.gap_um, []
    for load in chosen:
        loaded_pf = specimen.capacitance_pf(direction[load][None], found.truth_n[load][None])[0]
        closure_um = {f"measured, {DESIGN_ONLY}": gap_um * found.design_only.closure_rel[load]}
        if found.calibrated is not None:
            closure_um[f"measured, {CALIBRATED}"] = gap_um * found.calibrated.closure_rel[load]
        closure_um["simulated"] = response.design.closure_um(loaded_pf, specimen.rest_pf)
        shown.append(Pattern(_title(found.truth_n[load]), closure_um))
    return shown


def _described(foot: FootParameters, response: FootResponse) -> Deviations:
    """Return the foot as its calibration describes it; strays drop out of closures."""
    gap_um = foot.gap_um - response.design.gap_um
    return Deviations(gap_um=gap_um, stiffness_rel=foot.stiffness_rel, mount=foot.mount)


def _nearest(direction: Vector, allowed: NDArray[np.bool_], shown_deg: tuple[float, float]) -> int:
    """Return the load whose direction is nearest to two angles [deg]."""
    azimuth, elevation = np.radians(shown_deg)
    wanted = np.array(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    )
    return int(np.where(allowed, direction @ wanted, -np.inf).argmax())


def _title(force_n: Vector) -> str:
    size_n = float(np.linalg.norm(force_n))
    azimuth_deg = np.degrees(np.arctan2(force_n[1], force_n[0]))
    elevation_deg = np.degrees(np.arcsin(force_n[2] / size_n))
    return f"{size_n / GRAM_FORCE_N:.0f} gf from ({azimuth_deg:.0f}, {elevation_deg:.0f}) deg"
