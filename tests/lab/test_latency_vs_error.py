"""The chain of the study `tradeoff` is that of the daemon, and its judgement knows late and wrong forces."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from firmware_interface.chips import fdc1004
from firmware_interface.conversion_order import CONVERSION_ORDERS
from footsense.benchmarks.conversions import (
    PublishedForces,
    SimulatedReadings,
    conversion_timing,
    conversion_windows,
    estimate_forces,
    simulate_conversions,
    true_normals_and_forces_n,
)
from footsense.benchmarks.latency_vs_error import (
    TrueLoads,
    latency_and_errors,
    measure_latency_vs_error,
    settling_ms,
)
from footsense.foot.capacitor import Capacitor
from footsense.foot.network_card import TrainedInputs
from footsense.foot.specimen import Specimen
from footsense.lab.evaluation.evaluate_models import open_models
from footsense.lab.report import StudyContext
from footsense.ports import LoadEstimate, Window
from footsense.sim.loads.ground_load import RampContact
from tests.system.command import run_json

pytestmark = pytest.mark.lab

RELEASED = Path(__file__).parents[2] / "models" / "aoyagi-3x3"
MS = 1_000_000
ANY = TrainedInputs(
    design=Capacitor(gap_um=20.0, film_um=17.0, film_eps_r=2.7, electrode_area_mm2=16.0),
    closure_rel_min=np.full(9, -np.inf),
    closure_rel_max=np.full(9, np.inf),
    moments=np.eye(9),
    max_force_n=np.inf,
)


class FirstThree:
    """A network whose force is the newest closures of the first three elements."""

    def estimate(self, window: Window) -> LoadEstimate:
        force_n = window.closure_rel[:, 0, :3]
        return LoadEstimate(force_n, np.ones_like(force_n), *np.zeros((2, len(force_n), 4)))


def readings(order: str, distance_of_time_s: NDArray[np.float64], n: int = 45) -> SimulatedReadings:
    """Return readings of one foot whose elements follow polynomials of time [s], shape (9, coefficients)."""
    step_ns, lead_ns = conversion_timing(400)
    t_ns = np.arange(1, n + 1, dtype=np.int64) * step_ns
    element = np.resize(CONVERSION_ORDERS[order], n)
    values = [
        np.polyval(distance_of_time_s[e], t * 1e-9) for e, t in zip(element, t_ns.tolist(), strict=True)
    ]
    return SimulatedReadings(
        order=CONVERSION_ORDERS[order],
        t_ns=t_ns,
        sent_ns=t_ns + lead_ns,
        plate_distance_rel=np.array(values)[:, None],
        unloaded_plate_distance_rel=np.zeros((1, 9)),
    )


@pytest.mark.slow
def test_the_daemon_keeps_the_same_pace() -> None:
    """Rate and age of the daemon with one converter in a foot are those that the study derives, to some hundredths."""
    small = Path(__file__).parents[1] / "golden/small.yaml"
    figures = run_json("--config", small, "--scene", "measured_walk", "--duration", "3", "--fast")
    step_ns, lead_ns = conversion_timing(400)
    assert figures["cycle_rate_hz"] == pytest.approx(1e9 / step_ns, rel=0.03)
    assert figures["age_ms"]["p50"] == pytest.approx(lead_ns * 1e-6, abs=0.1)


@pytest.mark.parametrize("order", list(CONVERSION_ORDERS))
def test_a_force_is_made_of_what_was_known(order: str) -> None:
    """A window is of the last 27 conversions, the newest of each element first, with their ages at sending."""
    said = readings(order, np.tile([1.0, 0.0], (9, 1)))  # every reading is its own time
    window = conversion_windows(said)
    sent_ns = said.sent_ns[26:, None, None]
    assert len(window.closure_rel) == len(sent_ns)
    np.testing.assert_allclose(-window.closure_rel, sent_ns * 1e-9 - window.age_s, atol=1e-12)
    step_ns, lead_ns = conversion_timing(400)
    since = (window.age_s * 1e9 - lead_ns) / step_ns
    assert (np.diff(since, axis=1) > 0).all()
    np.testing.assert_allclose(
        np.sort(since.reshape(-1, 27), axis=1), np.tile(np.arange(27), (len(since), 1))
    )


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_extrapolation_is_exact_for_its_own_kind_of_motion(degree: int) -> None:
    """The newest readings follow what stands still, lines what moves evenly, parabolas what accelerates evenly."""
    motion = np.random.default_rng(1).standard_normal((9, degree + 1))
    published = estimate_forces(readings("lo_shu", motion), FirstThree(), ANY, degree)
    wanted = [[-np.polyval(motion[e], t * 1e-9) for e in range(3)] for t in published.sent_ns.tolist()]
    np.testing.assert_allclose(published.force_n[:, 0], wanted, atol=1e-9)


def test_every_fourth_force_is_one_of_all() -> None:
    """With its time of sending and its newest reading."""
    published = estimate_forces(readings("lo_shu", np.tile([1.0, 0.0], (9, 1))), FirstThree(), ANY)
    fourth = published.every_nth(4)
    np.testing.assert_array_equal(fourth.sent_ns, published.sent_ns[::4])
    np.testing.assert_array_equal(fourth.force_n, published.force_n[::4])
    assert set(fourth.sent_ns - fourth.newest_reading_ns) == {conversion_timing(400).send_delay_ns}


def test_a_converted_foot_reads_its_load() -> None:
    """At rest the tare; under a load every element is pressed, by what the foot says to noise and step."""
    response, _ = open_models(RELEASED)
    foot, load = Specimen(response), RampContact((0.0, 0.0, 0.5), 100 * MS)
    said = simulate_conversions(
        foot, [partial(load.contact, "lf")], CONVERSION_ORDERS["lo_shu"], 100, 400 * MS, seed=1
    )
    values, _ = said.latest_by_element()
    closure_rel = said.unloaded_plate_distance_rel - values[:, 0]
    # dC / C = -d(distance) / distance.
    noise_rel = (
        said.unloaded_plate_distance_rel.mean()
        * fdc1004.RATES[100].noise_ff
        * 1e-3
        / response.design.unloaded_pf
    )
    assert np.abs(closure_rel[0]).max() < 8 * noise_rel
    pressed_pf = foot.capacitance_pf(np.array([[0.0, 0.0, 1.0]]), np.array([[0.0, 0.0, 0.5]]))
    gap_um = response.design.gap_um
    wanted = said.unloaded_plate_distance_rel[0] - response.design.plate_distance_um(pressed_pf)[0] / gap_um
    np.testing.assert_allclose(closure_rel[-1], wanted, atol=8 * noise_rel)


def published_late(truth: TrueLoads, late_ns: int, every_ns: int = MS) -> PublishedForces:
    """Return true forces that are sent so much too late."""
    sent_ns = np.arange(0, truth.evaluation_end_ns + MS, every_ns)
    force_n = true_normals_and_forces_n(truth.feet, sent_ns - late_ns)[1]
    return PublishedForces(sent_ns, sent_ns - late_ns, force_n, np.full(force_n.shape, 1e-3))


def test_late_forces_are_found_to_be_late() -> None:
    """By how much; and a force that was right for its newest reading is wrong when it is sent."""
    feet = [partial(RampContact((0.1, 0.0, 0.8), 700 * MS, 200 * MS).contact, "lf")]
    truth = TrueLoads.sample(feet, 650 * MS, 1000 * MS)
    right, late = (
        latency_and_errors(published_late(truth, 0), truth),
        latency_and_errors(published_late(truth, 20 * MS), truth),
    )
    assert right["error_norm_rms_mn"] == right["held_error_norm_rms_mn"] == 0.0
    assert right["lag_ms"] == pytest.approx(0.0, abs=0.1)
    assert late["lag_ms"] == pytest.approx(20.0, abs=0.1)
    assert late["held_age_p50_p99_ms"][0] == 20.0
    assert late["error_norm_rms_mn"] > 30.0


def test_a_step_is_settled_when_the_last_wrong_force_is_replaced() -> None:
    """A force sent every 10 ms, 20 ms late, is right 20 to 30 ms after a step."""
    starts_ns = (700 * MS, 704 * MS)
    feet = [partial(RampContact((0.0, 0.0, 0.8), at_ns).contact, "lf") for at_ns in starts_ns]
    truth = TrueLoads.sample(feet, 650 * MS, 1000 * MS)
    found_ms = settling_ms(published_late(truth, 20 * MS, every_ns=10 * MS), truth, starts_ns)
    np.testing.assert_allclose(found_ms, [20.0, 26.0])


@pytest.mark.slow
def test_the_service_s_method_is_ahead_of_simpler_ones() -> None:
    found = measure_latency_vs_error(StudyContext(RELEASED, quick=True, report_progress=lambda _: None))
    walk = {
        (each["method"], each["scan_order"]): each["errors"]["error_norm_rms_mn"] for each in found["walk"]
    }
    assert walk["every conversion", "lo_shu"] < 0.7 * min(
        error_mn for (method, _), error_mn in walk.items() if not method.startswith("every")
    )
    every, fourth, ninth = (point["walk"]["held_error_norm_rms_mn"] for point in found["points"])
    assert every < fourth < ninth
