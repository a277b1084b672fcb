"""The table against a solve per load."""

import numpy as np
import pytest

from footsense.foot.response_table import FootResponse
from footsense.lab.fem.mesh import COARSE_MESH
from tests.lab.mechanics.direct_solve import DirectSolveFoot
from tests.lab.released import FOOT_DESIGN, RELEASED

pytestmark = pytest.mark.lab

#: An inclined contact that the force leans away from: no symmetry left.
NORMAL = np.array([np.sin(0.4) * np.cos(0.3), np.sin(0.4) * np.sin(0.3), np.cos(0.4)])
FORCE = np.array([0.3, -0.2, 0.9])


@pytest.mark.slow
def test_one_solve_per_load_equals_the_table() -> None:
    """Reciprocity, classes, transposed class, patch: every cell, within the error of the coarse mesh."""
    solved = DirectSolveFoot(FOOT_DESIGN, COARSE_MESH).cell_closures_um(NORMAL, FORCE)
    tabled = FootResponse.load(RELEASED / "response.npz").free_closure_um(NORMAL, FORCE)
    assert np.abs(solved - tabled).max() < 0.06 * np.abs(tabled).max()
