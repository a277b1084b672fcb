"""Random gaits as a foot reads them, and a short training on them."""

import numpy as np
import pytest

from firmware_interface.conversion_order import CONVERSION_ORDERS
from footsense.estimation.missing_elements import Imputation
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import ContactLoads, Specimen
from footsense.frames import ELEMENTS, Vector
from footsense.lab.evaluation.evaluate_models import open_models
from footsense.lab.training.gait_readings import (
    NOMINAL_SEND_DELAY_S,
    STEP_S,
    GaitReadings,
    ReadingConditions,
    conversion_elements,
    random_gaits,
    simulate_gait_readings,
)
from footsense.lab.training.gait_windows import contact_and_normal_force, windows_of
from footsense.lab.training.load_cases import NOISE_PF, random_loads, sensed_closure_um
from footsense.lab.training.train_windowed import WindowTrainingSettings, train_windowed
from footsense.lab.training.windowed_network import mean_closure_product_matrix, predict
from footsense.ports import Window
from tests.lab.released import FOOT_DESIGN, RELEASED

pytestmark = [pytest.mark.lab, pytest.mark.slow]

N = 400
MAX_N = 2.0


@pytest.fixture(scope="module")
def response() -> FootResponse:
    """Return the released foot's response."""
    return open_models(RELEASED)[0]


@pytest.fixture(scope="module")
def gaits(response: FootResponse) -> GaitReadings:
    """Return a few random gaits."""
    return random_gaits(response, 3, 24, N, MAX_N)


def rising(t_s: Vector) -> ContactLoads:
    """Return a load that leans, from nothing to 0.8 N in a second."""
    normal = np.tile([np.sin(0.1), 0.0, np.cos(0.1)], (len(t_s), 1))
    return ContactLoads(normal, np.clip(t_s, 0.0, 1.0)[:, None] * np.array([0.05, 0.1, 0.8]))


@pytest.mark.parametrize("order", range(len(CONVERSION_ORDERS)))
def test_a_reading_is_of_its_own_time_and_the_truth_of_the_sending(
    response: FootResponse, order: int
) -> None:
    """One element a conversion, in the order of the scan, to within the noise; the force is a lead later."""
    gait = simulate_gait_readings(
        response, rising, ReadingConditions(conversion_order_index=order), np.random.default_rng(1), N
    )
    t_s = STEP_S * np.arange(1.0, N + 1)
    np.testing.assert_allclose(
        gait.true_force_at_sending_n[0], rising(t_s + gait.send_delay_s[0]).force_n, rtol=1e-6
    )
    np.testing.assert_allclose(gait.send_delay_s, NOMINAL_SEND_DELAY_S, atol=2e-4)
    normal, force_n = rising(t_s)
    exact_rel = sensed_closure_um(Specimen(response), normal, force_n) / response.design.gap_um
    error_rel = gait.closure_rel[0] - exact_rel[np.arange(N), conversion_elements(order, N)]
    assert np.abs(error_rel).max() < 5e-3
    in_another_order = gait.closure_rel[0] - exact_rel[np.arange(N), conversion_elements(int(order == 0), N)]
    assert np.abs(in_another_order).max() > 0.05
    assert gait.in_range.all()


def test_in_the_air_a_reading_is_noise_about_a_baseline(response: FootResponse) -> None:
    """Of the converter's size, with an offset of each element that stays."""
    gait = simulate_gait_readings(
        response, lambda t_s: rising(0.0 * t_s), ReadingConditions(), np.random.default_rng(2), 9 * 300
    )
    of_elements = np.empty((300, ELEMENTS))
    of_elements[:, conversion_elements(0, ELEMENTS)] = gait.closure_rel[0].reshape(300, ELEMENTS)
    per_pf = 37.0 / 20.0 / response.design.unloaded_pf
    assert of_elements.std(axis=0) / per_pf == pytest.approx(np.full(ELEMENTS, NOISE_PF), rel=0.35)
    assert not gait.true_force_at_sending_n.any()


def test_a_reading_beyond_the_range_is_its_end(response: FootResponse) -> None:
    """It is marked, and no window begins with it."""
    gait = simulate_gait_readings(
        response,
        lambda t_s: ContactLoads(
            *(part * scale for part, scale in zip(rising(t_s), (1.0, 3.0), strict=True))
        ),
        ReadingConditions(),
        np.random.default_rng(3),
        N,
    )
    beyond = ~gait.in_range[0]
    assert beyond.any()
    assert np.isfinite(gait.closure_rel).all()
    assert gait.closure_rel[0, beyond].std() < 5e-3
    assert gait.closure_rel[0].max() == pytest.approx(gait.closure_rel[0, beyond].max())


def test_a_seed_is_a_set_of_gaits_on_any_number_of_processes(response: FootResponse) -> None:
    """The same bits, in the same order; another seed gives others."""
    one, two = (random_gaits(response, 7, 4, 60, MAX_N, jobs=jobs) for jobs in (1, 2))
    other = random_gaits(response, 8, 4, 60, MAX_N)
    np.testing.assert_array_equal(one.closure_rel, two.closure_rel)
    np.testing.assert_array_equal(one.true_force_at_sending_n, two.true_force_at_sending_n)
    assert (one.closure_rel != other.closure_rel).any()


def test_a_load_is_its_contact_point_and_its_friction_ratio() -> None:
    """Both are zero for a load straight up the leg; a load from friction and normal gives them back."""
    normal = np.array([[0.0, 0.0, 1.0], [0.0, np.sin(0.3), np.cos(0.3)]])
    across = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(0.3), -np.sin(0.3)]])
    contact, pressing_n = contact_and_normal_force(0.5 * (normal + np.array([[0.0], [0.4]]) * across), normal)
    np.testing.assert_allclose(pressing_n, 0.5)
    np.testing.assert_allclose(contact[0], 0.0)
    np.testing.assert_allclose(contact[1], [0.0, np.tan(0.15), 0.0, 0.4 * np.cos(0.3)])
    nothing, none_n = contact_and_normal_force(np.zeros((1, 3)), normal[1:])
    assert (none_n[0], nothing[0, 2:].tolist()) == (0.0, [0.0, 0.0])


def test_a_short_training_learns_and_is_the_same_twice(response: FootResponse, gaits: GaitReadings) -> None:
    """Errors are a part of the load, and sigma and contact follow; the same seed gives the same bits."""
    rest = random_loads(response, FOOT_DESIGN.loads, 500, 1)
    design = response.design
    imputation = Imputation(
        mean_closure_product_matrix(rest.with_symmetric_copies().closure_um / design.gap_um)
    )
    settings = WindowTrainingSettings(channels=4, steps=500, batch=256, rate=1e-2)
    lines: list[str] = []
    weights, again = (
        train_windowed(gaits, rest, design, settings, imputation, lines.append) for _ in range(2)
    )
    for one, two in zip(weights, again, strict=True):
        np.testing.assert_array_equal(one, two)
    assert lines[0].startswith("step 500: loss ")
    window, (normal, force_n) = windows_of(random_gaits(response, 99, 10, N, MAX_N))
    loaded = np.linalg.norm(force_n, axis=1) > 0.05
    load = predict(weights, window)
    error_n = np.abs(load.force_n - force_n)[loaded]
    assert np.sqrt(np.square(error_n).mean()) < 0.3 * np.sqrt(np.square(force_n[loaded]).mean())
    assert (error_n < 2.0 * load.sigma_n[loaded]).mean() > 0.7
    contact, _ = contact_and_normal_force(force_n[loaded], normal[loaded])
    assert np.abs(load.contact_point_and_friction[loaded] - contact).mean() < 0.9 * np.abs(contact).mean()
    resting = Window(np.zeros((1, 3, ELEMENTS)), window.age_s[:1], window.missing[:1])
    assert not predict(weights, resting).force_n.any()
