"""Response tables of feet that are not symmetric."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from footsense.foot.response_table import FootResponse
from footsense.lab.fem.whole import with_added_response
from tests.lab.released import FOOT_DESIGN, RELEASED

pytestmark = pytest.mark.lab


def test_a_whole_table_without_change_is_the_quarter_mirrored(tmp_path: Path) -> None:
    """A foot that is not symmetric has a table of all cells; without a change it reads the same, after a file, too."""
    response = FootResponse.load(RELEASED / "response.npz")
    none = np.zeros((response.closure_coefficients.shape[1], 324, 3))
    whole = with_added_response(response, FOOT_DESIGN, none, np.zeros((324, 324)))
    whole.save(tmp_path / "whole.npz")
    kept = FootResponse.load(tmp_path / "whole.npz")
    assert len(kept.quarter_compliance) == 18
    normal = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]])
    for one in (whole, kept):
        np.testing.assert_allclose(
            one.free_closure_um(normal, normal), response.free_closure_um(normal, normal)
        )
    np.testing.assert_array_equal(kept.compliance_um_per_n, response.compliance_um_per_n)
    other = replace(kept, quarter_series=1.1 * kept.quarter_series)
    assert (
        other.free_element_closures_um(normal, normal)[0, 0]
        > kept.free_element_closures_um(normal, normal)[0, 0]
    )
