"""Figure of a session's covered force directions; needs matplotlib."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from footsense.calibration.session.coverage import MAGNITUDE_BAND_CENTRES_GF, MIN_ELEVATION_DEG, Coverage
from footsense.foot.directions import azimuth_elevation_deg
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.frames import Vector

_ELEVATION_RINGS_DEG = (40.0, 50.0, 60.0, 70.0, 80.0)


def draw_coverage(path: Path, coverage: Coverage, forces_n: Vector, title: str) -> None:
    """Write a figure of the loads of each magnitude band and the directions they cover, seen from above.

    Args:
        path: PNG to write.
        coverage: Coverage of the loads.
        forces_n: Their forces [N], shape (n, 3).
        title: Foot and session.
    """
    figure = Figure(figsize=(4.2 * len(MAGNITUDE_BAND_CENTRES_GF), 4.9), layout="constrained")
    magnitude_gf = np.linalg.norm(forces_n, axis=1) / GRAM_FORCE_N
    band_of = np.argmin(np.abs(magnitude_gf[:, None] - np.array(MAGNITUDE_BAND_CENTRES_GF)), axis=1)
    azimuth_deg, elevation_deg = azimuth_elevation_deg(forces_n)
    panels = figure.subplots(1, len(MAGNITUDE_BAND_CENTRES_GF), subplot_kw={"projection": "polar"})
    for band, (axes, band_gf) in enumerate(zip(panels, MAGNITUDE_BAND_CENTRES_GF, strict=True)):
        axes.set_theta_zero_location("N")
        own = band_of == band
        style = {"s": 26, "c": magnitude_gf[own], "cmap": "viridis", "vmin": 0, "vmax": 200}
        axes.scatter(np.radians(azimuth_deg[own]), 90.0 - elevation_deg[own], **style)
        axes.set_rlim(0.0, 90.0 - MIN_ELEVATION_DEG + coverage.reach_deg / 2)
        axes.set_rgrids(
            [90.0 - ring for ring in _ELEVATION_RINGS_DEG],
            [f"{ring:g}" for ring in _ELEVATION_RINGS_DEG],
            fontsize=7,
        )
        axes.set_thetagrids([0, 90, 180, 270], ["forward", "left", "rear", "right"], fontsize=8)
        share = 100 * coverage.covered_directions_rel[band]
        axes.set_title(f"about {band_gf:.0f} gf: {own.sum()} loads, {share:.0f} % covered", fontsize=10)
    figure.suptitle(
        f"{title}: rings of elevation [deg], each load covers {coverage.reach_deg:.0f} deg", fontsize=10
    )
    figure.savefig(path, dpi=110)
