"""Response tables of made-up feet with arrays of any size."""

import numpy as np

from footsense.foot.response_table import FootResponse, n_basis_functions
from tests.support.feet import DESIGN


def response(rows: int) -> FootResponse:
    """Return a table of a made-up foot: 5 um/N upright, and 2 um/N sideways, growing with the distance of the cell."""
    half, side = 3 * rows, 6 * rows
    own = np.zeros((half, half, side, side))
    row, column = np.indices((half, half))
    own[row, column, row, column] = 10.0
    series = np.zeros((2, n_basis_functions(2), half, half, 3))
    away = (half - 0.5 - row) / half
    series[0, 0] = np.stack([2.0 * away, 2.0 * away.T, np.full_like(away, 5.0)], axis=-1)
    return FootResponse(
        foot_type=f"test-{rows}",
        design=DESIGN,
        ball_radius_mm=10.0,
        hertz_modulus_mpa=6.8,
        min_elevation_deg=25.0,
        fit_elevation_deg=12.0,
        degree=2,
        quarter_series=series,
        quarter_compliance=own,
        provenance={},
    )
