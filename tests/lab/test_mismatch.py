"""The command `lab mismatch` in its quick form, and what it refuses."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from footsense.cli.lab.pages.mismatch_rows import MISMATCH_ROWS
from footsense.errors import ModelError
from footsense.foot.response_table import FootResponse
from footsense.lab.fem.whole import Imperfection, solve_whole_foot, with_added_response
from tests.lab.released import FOOT_DESIGN, RELEASED

pytestmark = pytest.mark.lab

RESPONSE = FootResponse.load(RELEASED / "response.npz")


def test_gold_is_in_the_solid_of_its_row() -> None:
    """A row is a foot of other dimensions or materials; one that changes nothing is no row."""
    assert MISMATCH_ROWS["gold"].solid.changed_design(FOOT_DESIGN).gold is not None
    assert FOOT_DESIGN.gold is None
    titles = [row.title for row in MISMATCH_ROWS.values()]
    assert (
        len({str(replace(row, title="")) for row in MISMATCH_ROWS.values()})
        == len(set(titles))
        == len(titles)
    )


def test_a_bubble_that_leaves_the_ball_is_one_clear_line() -> None:
    """A mismatch that the mesh cannot hold is refused before it is meshed."""
    with pytest.raises(ModelError, match="is not inside the ground-side ball"):
        solve_whole_foot(FOOT_DESIGN, Imperfection(bubble_centre_and_radius_mm=(0.0, 0.0, -1.0, 0.75)))


def test_a_whole_table_without_change_is_the_quarter_mirrored(tmp_path: Path) -> None:
    """A foot that is not symmetric has a table of all cells; without a change it reads the same, after a file, too."""
    none = np.zeros((RESPONSE.closure_coefficients.shape[1], 324, 3))
    whole = with_added_response(RESPONSE, FOOT_DESIGN, none, np.zeros((324, 324)))
    whole.save(tmp_path / "whole.npz")
    kept = FootResponse.load(tmp_path / "whole.npz")
    assert len(kept.quarter_compliance) == 18
    normal = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]])
    for one in (whole, kept):
        np.testing.assert_allclose(
            one.free_closure_um(normal, normal), RESPONSE.free_closure_um(normal, normal)
        )
    np.testing.assert_array_equal(kept.compliance_um_per_n, RESPONSE.compliance_um_per_n)
    other = replace(kept, quarter_series=1.1 * kept.quarter_series)
    assert (
        other.free_element_closures_um(normal, normal)[0, 0]
        > kept.free_element_closures_um(normal, normal)[0, 0]
    )
