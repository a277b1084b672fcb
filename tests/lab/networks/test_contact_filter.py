"""Least squares and filter on the response of the foot: coordinates there and back, and a foot that stands still."""

import numpy as np
import pytest

from footsense.estimation.network import STEADY_AGES_S
from footsense.lab.evaluation.contact_filter import ContactFilter
from footsense.lab.evaluation.contact_model import (
    ContactMeasurementModel,
    contact_coordinates_of,
    force_and_slopes,
)
from footsense.lab.evaluation.evaluate_models import open_models
from footsense.lab.evaluation.window_fit import fit_force_and_sigma, is_steady
from footsense.lab.training.gait_readings import NOMINAL_SEND_DELAY_S, STEP_S, conversion_elements
from footsense.ports import LoadEstimate, Window
from tests.lab.released import RELEASED

pytestmark = pytest.mark.lab

#: Normal force [N], friction ratio and contact point of three feet.
COORDINATES = np.array([[0.6, 0.1, -0.2, 0.1, 0.05], [0.3, 0.0, 0.0, 0.0, 0.0], [0.8, -0.3, 0.1, -0.1, 0.0]])
#: Error of the network in the tests [N], [1].
OFF_N, OFF_REL = 0.03, 0.03


@pytest.fixture(scope="module")
def model() -> ContactMeasurementModel:
    """Return the model of the released foot."""
    return ContactMeasurementModel(open_models(RELEASED)[0])


def network_off() -> LoadEstimate:
    """Return an answer that is off by its sigma."""
    force_n, _ = force_and_slopes(COORDINATES)
    contact = COORDINATES[:, [3, 4, 1, 2]]
    return LoadEstimate(
        force_n + OFF_N, np.full_like(force_n, OFF_N), contact - OFF_REL, np.full_like(contact, OFF_REL)
    )


def test_coordinates_are_those_of_their_force() -> None:
    """There and back, and the derivatives are those of the force."""
    force_n, slopes = force_and_slopes(COORDINATES)
    np.testing.assert_allclose(
        contact_coordinates_of(force_n, COORDINATES[:, [3, 4, 1, 2]]), COORDINATES, atol=1e-12
    )
    for k, step in enumerate(1e-6 * np.eye(5)):
        difference = (
            force_and_slopes(COORDINATES + step)[0] - force_and_slopes(COORDINATES - step)[0]
        ) / 2e-6
        np.testing.assert_allclose(slopes[:, :, k], difference, atol=1e-4)


def test_a_fit_finds_the_load_of_a_foot_at_rest(model: ContactMeasurementModel) -> None:
    """From an answer that is off by its sigma, to a fifth of it; the readings tell that the foot is at rest."""
    closure_rel, _ = model.closure_and_slopes(COORDINATES)
    readings = np.repeat(closure_rel[:, None], 3, axis=1)
    window = Window(readings, np.tile(STEADY_AGES_S, (3, 1, 1)), np.zeros((3, 9), bool))
    force_n, sigma_n = fit_force_and_sigma(model, window, network_off(), rounds=2)
    true_n, _ = force_and_slopes(COORDINATES)
    assert np.abs(force_n - true_n).max() < 0.2 * OFF_N
    assert (sigma_n < OFF_N).all()
    assert is_steady(model, window).all()
    readings[:, 0, 4] += 0.05
    assert not is_steady(model, window).any()


def test_a_filter_follows_a_load_and_is_seeded_by_the_network(model: ContactMeasurementModel) -> None:
    """It settles within some scans; against a network that contradicts it for long, it starts from the network."""
    closure_rel, _ = model.closure_and_slopes(COORDINATES)
    true_n, _ = force_and_slopes(COORDINATES)
    tracker = ContactFilter(model, 3, STEP_S, NOMINAL_SEND_DELAY_S)
    for element in conversion_elements(0, 90).tolist():
        tracker.update(element, closure_rel[:, element])
    force_n, sigma_n = tracker.force_and_sigma_n()
    assert np.abs(force_n - true_n).max() < OFF_N
    assert (np.abs(force_n - true_n) < 3.0 * sigma_n + 1e-3).all()
    other = network_off()._replace(force_n=true_n + 0.5)
    for _ in range(4):
        tracker.restart_where_inconsistent(other, np.array([True, False, True]))
    moved_n = np.abs(tracker.force_and_sigma_n()[0] - force_n).max(axis=1)
    assert moved_n[1] == 0.0
    assert (moved_n[[0, 2]] > 0.1).all()
