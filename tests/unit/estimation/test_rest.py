"""Loads that stand still: the fit on the response table, and when the network's answer stays."""

import numpy as np
from numpy.typing import NDArray

from footsense.daemon.foot_types import released_path
from footsense.estimation.network import Network, steady_windows
from footsense.estimation.rest import ROUNDS, RefinedAtRest
from footsense.foot.directions import angles_between_deg, directions, normalized
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Specimen
from footsense.ports import LoadEstimate, Window

Vector = NDArray[np.float64]

RESPONSE = FootResponse.load(released_path("response.npz"))
#: Loads whose contact leans from the force.
DIRECTION = directions([10.0, 70.0, 130.0, 190.0, 250.0, 310.0], [85.0, 75.0, 65.0, 60.0, 80.0, 70.0])
FORCE_N = DIRECTION * np.linspace(0.6, 1.1, 6)[:, None]
NORMAL = normalized(DIRECTION + 0.15 * np.roll(DIRECTION, 1, axis=0))
CAPACITANCE_PF = Specimen(RESPONSE).capacitance_pf(NORMAL, FORCE_N)
NOISE_PF = 1e-3
#: Calls in which each of six legs has all rounds.
CALLS = 6 * ROUNDS


def refined() -> RefinedAtRest:
    """Return the released network, refined at rest, for six legs."""
    network = Network(released_path("network.onnx"), 6)
    return RefinedAtRest(network, RESPONSE, network.card.trained_inputs, 6)


def window(rng: np.random.Generator, capacitance_pf: Vector = CAPACITANCE_PF) -> Window:
    """Return noisy readings of six feet at rest."""
    design = RESPONSE.design
    read_pf = capacitance_pf[:, None] + NOISE_PF * rng.normal(size=(6, 3, 9))
    closure_um = design.closure_um(read_pf, np.array(design.unloaded_pf))
    return steady_windows(closure_um[:, 0])._replace(closure_rel=closure_um / design.gap_um)


def after_rest(estimator: RefinedAtRest, capacitance_pf: Vector = CAPACITANCE_PF) -> np.random.Generator:
    """Let all rounds be done on loads at rest; return the generator of their noise."""
    rng = np.random.default_rng(5)
    for _ in range(CALLS):
        estimator.estimate(window(rng, capacitance_pf))
    return rng


def of_network(seen: Window) -> LoadEstimate:
    """Return the released network's answer."""
    return Network(released_path("network.onnx"), 6).estimate(seen)


def test_a_load_that_stands_still_is_known_better_than_by_the_network() -> None:
    estimator = refined()
    seen = window(after_rest(estimator))
    network, load = of_network(seen), estimator.estimate(seen)
    error_deg = angles_between_deg(load.force_n, FORCE_N)
    assert error_deg.max() < 0.2
    assert error_deg.mean() < 0.5 * angles_between_deg(network.force_n, FORCE_N).mean()
    assert (np.abs(load.force_n - FORCE_N) < 2.0 * load.sigma_n).all()
    assert (load.sigma_n >= network.sigma_n).all()
    # The contact, from which slips are told, stays the network's.
    np.testing.assert_array_equal(load.contact_point_and_friction, network.contact_point_and_friction)


def test_one_reading_that_moves_makes_the_force_the_networks_at_once() -> None:
    estimator = refined()
    seen = window(after_rest(estimator))
    seen.closure_rel[2, 0, 4] += 5e-3
    network, load = of_network(seen), estimator.estimate(seen)
    np.testing.assert_array_equal(load.force_n[2], network.force_n[2])
    assert (load.force_n[[0, 1, 3, 4, 5]] != network.force_n[[0, 1, 3, 4, 5]]).all()


def test_an_element_that_contradicts_the_table_or_is_missing_leaves_the_networks_answer() -> None:
    wrong_pf = CAPACITANCE_PF.copy()
    wrong_pf[1, 0] *= 1.03
    estimator = refined()
    rng = after_rest(estimator, wrong_pf)
    seen = window(rng, wrong_pf)
    seen.missing[3, 8] = True
    network, load = of_network(seen), estimator.estimate(seen)
    np.testing.assert_array_equal(load.force_n[[1, 3]], network.force_n[[1, 3]])
    np.testing.assert_array_equal(load.sigma_n[[1, 3]], network.sigma_n[[1, 3]])
    assert (load.force_n[[0, 2, 4, 5]] != network.force_n[[0, 2, 4, 5]]).all()


def test_a_foot_in_the_air_is_not_fitted() -> None:
    estimator = refined()
    unloaded_pf = np.full((6, 9), RESPONSE.design.unloaded_pf)
    seen = window(after_rest(estimator, unloaded_pf), unloaded_pf)
    np.testing.assert_array_equal(estimator.estimate(seen).force_n, of_network(seen).force_n)


def test_the_same_readings_give_the_same_bits() -> None:
    """So a replay gives the forces of the recording."""
    one, other = refined(), refined()
    rng = np.random.default_rng(6)
    for call in range(CALLS):
        seen = window(rng, CAPACITANCE_PF * (1.01 if call > CALLS // 2 else 1.0))
        np.testing.assert_array_equal(one.estimate(seen).force_n, other.estimate(seen).force_n)
