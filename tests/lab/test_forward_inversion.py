"""The forward model of bent electrodes and closed gaps, and its inverse."""

import numpy as np
import pytest

from footsense.foot.directions import directions
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Foot
from footsense.lab.training.load_cases import sensed_closure_um
from footsense.lab.training.snapshot.forward_inversion import forward_model

pytestmark = pytest.mark.lab


def test_inverted_closures_are_linear_in_the_load_though_gaps_close(response: FootResponse) -> None:
    """From 20 to 170 gf, across the first contact: within 0.1 um of proportional, where elastance is off by 1 um."""
    normal = np.tile(directions(np.array([20.0]), np.array([50.0])), (6, 1))
    size = np.array([20.0, 60.0, 100.0, 140.0, 160.0, 170.0])[:, None] * GRAM_FORCE_N
    sensed = sensed_closure_um(Foot(response), normal, size * normal)
    free = response.free_element_closures_um(normal, size * normal)
    assert (Foot(response).cell_closures_um(normal, size * normal)[-1] >= response.design.gap_um).any()
    assert np.abs(sensed - free).max() > 1.0
    assert np.abs(forward_model(response).element_free_closure_um(sensed) - free).max() < 0.1


def test_the_inverse_inverts_the_model(response: FootResponse) -> None:
    """Any mean closures, some closing gaps: recovered from the capacitances."""
    model = forward_model(response)
    mean = np.random.default_rng(1).uniform(0.0, 14.0, (20, 9))
    closure = response.design.closure_um(model.capacitance_pf(mean), np.array([response.design.unloaded_pf]))
    np.testing.assert_allclose(model.element_free_closure_um(closure), mean, atol=1e-4)


def test_more_than_a_closed_gap_is_no_load(response: FootResponse) -> None:
    """A capacitance above that of the film alone is refused, not explained."""
    with pytest.raises((ArithmeticError, np.linalg.LinAlgError)):
        forward_model(response).element_free_closure_um(np.full((1, 9), 1.2 * response.design.gap_um))
