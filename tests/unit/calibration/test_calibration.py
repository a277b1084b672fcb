"""A foot calibrated from loads and sessions: parameters found, rubber's memory taken off, impossible feet refused."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from footsense.calibration.calibrate import calibrate, calibrate_sessions
from footsense.calibration.loads import LoadSet
from footsense.calibration.parameter_fit import fit_parameters
from footsense.calibration.recorded_session import RecordedSession
from footsense.calibration.rubber_memory import correct_baselines_for_creep
from footsense.calibration.twin import (
    GAP,
    MOUNT,
    N_PARAMETERS,
    OFFSET,
    STIFFNESS,
    STRAY,
    FootTwin,
    reference_gains,
)
from footsense.errors import CalibrationError
from footsense.estimation.calibrated_feet import CalibratedFeet
from footsense.estimation.network import steady_windows
from footsense.foot.directions import normalized, rotation
from footsense.foot.force_errors import evaluate_force_errors
from footsense.foot.parameters import FootParameters
from footsense.foot.specimen import ContactLoads, Deviations, Specimen
from footsense.sim.loads.press_sequence import paper_presses
from tests.support.test_stand_loads import design, load_set, made

Vector = NDArray[np.float64]

_TRAINING, _JUDGED = paper_presses("training"), paper_presses("verification")[::4]


def _read(loads: LoadSet, foot: FootParameters | None) -> Vector:
    """Return what a robot makes of loads [N], shape (n, 3)."""
    stray_pf = np.zeros(9) if foot is None else foot.stray_pf
    card = design().network_for_rows(1).card.trained_inputs
    closure_um = card.design.closure_um(loads.capacitance_pf - stray_pf, loads.baseline_pf - stray_pf)
    feet = CalibratedFeet(design().network_for_rows(len(loads)), [foot] * len(loads))
    gain_rel = np.ones(9) if foot is None else foot.gain_rel
    return feet.estimate(steady_windows(closure_um / card.design.gap_um / gain_rel)).force_n


@pytest.mark.parametrize("number", range(3))
def test_the_twin_reads_what_the_simulated_foot_reads(number: int) -> None:
    """Written from the elastance, it knows no film; the simulator has gap and film of its own."""
    own = made(number)
    force_n = np.concatenate([_TRAINING[::40], 2.0 * _TRAINING[5::60]])
    foot = Specimen(design().response, own)
    parameters = np.zeros(N_PARAMETERS)
    parameters[STRAY], parameters[GAP] = own.stray_pf, own.gap_um
    parameters[STIFFNESS] = own.stiffness_rel
    load = ContactLoads.centred(force_n)
    turned = replace(own, mount=np.eye(3))
    straight = Specimen(design().response, turned).capacitance_pf(load.normal, force_n)
    np.testing.assert_allclose(
        FootTwin(design().response, foot.unloaded_pf).capacitance_pf(parameters, load), straight
    )
    parameters[MOUNT] = [0.02, -0.03, 0.05]
    turned = replace(own, mount=rotation(parameters[MOUNT]))
    np.testing.assert_allclose(
        FootTwin(design().response, foot.unloaded_pf).capacitance_pf(parameters, load),
        Specimen(design().response, turned).capacitance_pf(load.normal, force_n),
    )


def test_exact_loads_identify_the_foot() -> None:
    """Strays, stiffness and mount come out as they are."""
    own = made(1)
    loads = load_set(own, _TRAINING[::6])
    found = fit_parameters(FootTwin(design().response, loads.median_baseline_pf), loads).parameters
    np.testing.assert_allclose(found[STRAY], own.stray_pf, atol=0.02)
    np.testing.assert_allclose(found[STIFFNESS], own.stiffness_rel, atol=0.01)
    np.testing.assert_allclose(rotation(found[MOUNT]), own.mount, atol=0.005)


def test_errors_as_large_as_supposed_lie_as_far_as_supposed() -> None:
    """Creep and unexplained changes make the median squared distance that of chi squared with 9 degrees of freedom.

    A little less, as the stick did not lean: left out of the supposed errors, creep makes it 12.4 and lean 8.6.
    """
    rng = np.random.default_rng(4)
    loads = load_set(made(1), _TRAINING[::4], rng, lean_deg=0.0, rubber_rel=0.015)
    unexplained_pf = (
        0.005 * (loads.capacitance_pf - loads.median_baseline_pf) * rng.normal(size=(len(loads), 9))
    )
    loads = replace(loads, capacitance_pf=loads.capacitance_pf + unexplained_pf)
    found = fit_parameters(FootTwin(design().response, loads.median_baseline_pf), loads)
    assert 6.0 < np.median(np.square(found.mahalanobis_distance)) < 7.5


def test_twenty_loads_make_a_foot_several_times_better() -> None:
    """On loads that the calibration did not know, of two feet that are as badly made as the paper's."""
    for number in (1, 3):
        rng = np.random.default_rng(number)
        loads, judged = load_set(made(number), _TRAINING, rng), load_set(made(number), _JUDGED, rng)
        found = calibrate(design(), loads.subset(loads.space_filling_order()[:20]))
        before = evaluate_force_errors(judged.force_n, _read(judged, None))
        after = evaluate_force_errors(judged.force_n, _read(judged, found.parameters))
        assert after.direction_deg < 0.25 * before.direction_deg
        assert after.direction_deg < 3.0
        assert after.magnitude_gf < 4.0
        assert found.predicted_uncertainty.median_direction_error_deg < 1.5


def test_an_offset_sheet_and_a_crooked_reference_are_told_from_the_foot() -> None:
    """Loads of an offset sheet are loads that lean; the gains of the reference do not go into the foot."""
    own, force_n, offset = made(1), _TRAINING[::4], np.array([0.06, -0.03])
    inside = normalized(force_n) @ own.mount.T
    inside[:, :2] += offset
    reached = inside[:, 2] > 0.5
    normal = (normalized(inside) @ own.mount)[reached]
    foot, force_n = Specimen(design().response, own), force_n[reached]
    loads = LoadSet(
        force_n=force_n * (1.02, 0.99, 0.98),
        sigma_n=np.full(force_n.shape, 0.003),
        capacitance_pf=foot.capacitance_pf(normal, force_n),
        baseline_pf=np.tile(foot.unloaded_pf, (len(force_n), 1)),
    )
    found = fit_parameters(FootTwin(design().response, loads.median_baseline_pf), loads)
    np.testing.assert_allclose(found.parameters[OFFSET], offset, atol=0.006)
    np.testing.assert_allclose(reference_gains(found.parameters), [1.0233, 0.9933, 0.9833], atol=0.01)
    assert np.median(found.mahalanobis_distance) < 1.0


def test_gains_of_the_reference_are_no_errors_of_the_calibration() -> None:
    """Neither of those that it says of itself, nor of those that are expected."""
    loads = load_set(made(1), _TRAINING[::18])
    straight, crooked = (
        calibrate(design(), replace(loads, force_n=loads.force_n * gains))
        for gains in (np.ones(3), np.array([1.04, 0.99, 0.97]))
    )
    assert crooked.parameters.error_rel < 1.3 * straight.parameters.error_rel
    expected = zip(crooked.predicted_uncertainty, straight.predicted_uncertainty, strict=True)
    assert all(of_crooked < 1.3 * of_straight for of_crooked, of_straight in expected)


def test_a_foot_as_designed_is_left_as_it_is() -> None:
    """Nothing is made up: calibration of an exact foot does not make it worse than the noise of its test stand."""
    rng = np.random.default_rng(5)
    loads, judged = load_set(Deviations(), _TRAINING[::5], rng), load_set(Deviations(), _JUDGED)
    found = calibrate(design(), loads).parameters
    assert evaluate_force_errors(judged.force_n, _read(judged, found)).direction_deg < 0.5


def test_a_load_that_slipped_does_not_count_much() -> None:
    """One reading of another load among sixty changes little."""
    loads = load_set(made(1), _TRAINING[::6], np.random.default_rng(2))
    slipped = loads.capacitance_pf.copy()
    slipped[10] = slipped[40]
    judged = load_set(made(1), _JUDGED)
    found = calibrate(design(), replace(loads, capacitance_pf=slipped)).parameters
    assert evaluate_force_errors(judged.force_n, _read(judged, found)).direction_deg < 1.5


def test_loads_from_one_side_are_refused_by_what_they_do_not_tell() -> None:
    """Honest refusal: what no load moved cannot be known."""
    own = made(1)
    with pytest.raises(CalibrationError, match="press from more sides"):
        calibrate(design(), load_set(own, _TRAINING[:1].repeat(5, axis=0)))
    with pytest.raises(CalibrationError, match="3 loads; at least 5"):
        calibrate(design(), load_set(own, _TRAINING[:3]))


def test_kilograms_force_taken_for_newtons_are_found_out() -> None:
    """No foot is a tenth as stiff as designed."""
    loads = load_set(made(1), _TRAINING[::10])
    with pytest.raises(CalibrationError, match=r"1 kgf is 9\.81 N"):
        calibrate(design(), replace(loads, force_n=loads.force_n / 9.80665))


def test_loads_of_no_foot_of_the_type_are_refused() -> None:
    """Elements wired in another order fit no parameters."""
    loads = load_set(made(1), _TRAINING[::15])
    order = np.random.default_rng(1).permutation(9)
    mixed = replace(
        loads, capacitance_pf=loads.capacitance_pf[:, order], baseline_pf=loads.baseline_pf[:, order]
    )
    with pytest.raises(CalibrationError, match=r"any foot of this type|as stiff as designed"):
        calibrate(design(), mixed)


@pytest.mark.slow
@pytest.mark.parametrize("number", [2, 9])
def test_firm_loads_that_shut_gaps_lead_nowhere_else(number: int) -> None:
    """All at once end where the light ones point: nothing is far from the twin."""
    result = calibrate(design(), load_set(made(number), _TRAINING[::2], np.random.default_rng(number)))
    found = result.fit
    assert np.median(found.mahalanobis_distance) < 5.0
    assert list(result.not_identified) in ([], ["gap_um"])
    np.testing.assert_allclose(found.parameters[GAP][result.not_identified.get("gap_um", [])], 0.0, atol=1.0)
    assert np.abs(found.parameters[STRAY] - made(number).stray_pf).max() < 0.35


def test_a_gap_is_identified_only_by_loads_that_close_it() -> None:
    """One that a neighbour's shutting had moved would let a shut gap pass for an open one on the robot."""
    own = made(0)
    loads = load_set(own, _TRAINING[::6], np.random.default_rng(0))
    twin = FootTwin(design().response, loads.median_baseline_pf)
    found = fit_parameters(twin, loads)
    cell_closures_um = twin.cell_closures_um(found.parameters, ContactLoads.centred(loads.force_n)).reshape(
        len(loads), 9, -1
    )
    shuts = (cell_closures_um >= twin.gap_um(found.parameters)[:, None] - 1e-6).any(axis=(0, 2))
    assert not shuts.all()
    np.testing.assert_allclose(found.parameters[GAP][~shuts], 0.0, atol=1.0)
    assert (found.contraction[GAP][~shuts] < 0.01).all()


_DRIFT_PF = 0.01


@pytest.mark.parametrize("every", [3, 18])
def test_what_the_rubber_remembers_is_taken_off_and_drift_is_left(every: int) -> None:
    """Play stays in the direction of the press before, creep in that of the last presses; 21 presses tell both."""
    own, force_n = made(1), paper_presses("training")[::every]
    loads = load_set(own, force_n, np.random.default_rng(1))
    mean_n, staying_n = np.zeros(3), [np.zeros(3)]
    for one_n in force_n[:-1]:
        mean_n = 0.9 * mean_n + 0.1 * one_n
        staying_n.append(0.01 * one_n / np.linalg.norm(one_n) + 0.015 * mean_n)
    contacts = normalized(np.concatenate([force_n[:1], force_n[:-1]]))
    rested_pf = loads.baseline_pf + np.linspace(0.0, _DRIFT_PF, len(loads))[:, None]
    remembering_pf = Specimen(design().response, own).capacitance_pf(contacts, np.array(staying_n))
    read_pf = rested_pf + remembering_pf - loads.baseline_pf
    found_pf = correct_baselines_for_creep(design().response, replace(loads, baseline_pf=read_pf)).baseline_pf
    assert np.abs(read_pf - rested_pf).mean() > 0.02
    assert abs((found_pf - rested_pf).mean()) < 0.003
    assert (found_pf - rested_pf).std() < 0.002


def test_an_elastic_foot_is_left_as_it_is() -> None:
    """Noise of the readings is no memory."""
    rng = np.random.default_rng(2)
    loads = load_set(made(2), paper_presses("training")[::12], rng)
    noisy_pf = loads.baseline_pf + 0.0002 * rng.normal(size=loads.baseline_pf.shape)
    found_pf = correct_baselines_for_creep(
        design().response, replace(loads, baseline_pf=noisy_pf)
    ).baseline_pf
    np.testing.assert_allclose(found_pf, noisy_pf, atol=0.001)


_FORCE_N = 0.3 * paper_presses("training")[::12]


def session(name: str, number: int) -> RecordedSession:
    """Return one of three recordings of a foot, with a third of its loads."""
    return RecordedSession(
        path=Path(f"{number}.mcap"),
        sha256=str(number),
        name=name,
        foot="foot-0007",
        foot_type="aoyagi-3x3",
        test_stand=None,
        temperature_c=None,
        loads=load_set(made(1), _FORCE_N[number::3]),
        dwells_ns=(),
        rejected=Counter(),
        n_lost_cycles=0,
        damage="",
    )


@pytest.mark.parametrize(("names", "kept"), [("abb", 2 / 3), ("aab", 1 / 3), ("aaa", 1 / 5)])
def test_a_mounting_is_kept_whole_however_many_recordings_it_has(names: str, kept: float) -> None:
    """The last of several mountings, or every fifth load of the only one."""
    sessions = [session(name, number) for number, name in enumerate(names)]
    held_out = calibrate_sessions(design(), sessions).held_out
    assert held_out is not None
    n = sum(len(one.loads) for one in sessions)
    assert held_out.calibrated.n == pytest.approx(kept * n, abs=1)


def test_held_out_loads_judge_a_calibration_that_did_not_know_them() -> None:
    """The second time the foot was mounted 2.9 deg off; the temperature is that of all loads, not of all sessions."""
    first = load_set(made(1), _FORCE_N[::2])
    turned = replace(made(1), mount=rotation(np.array([0.05, 0.0, 0.0])) @ made(1).mount)
    again = load_set(turned, _FORCE_N[1::3])
    sessions = [
        replace(session(name, 0), loads=loads, temperature_c=temperature_c)
        for name, loads, temperature_c in (("a", first, 20.0), ("b", again, 26.0))
    ]
    found = calibrate_sessions(design(), sessions)
    assert found.held_out is not None
    assert found.held_out.calibrated.direction_deg == pytest.approx(2.8, abs=0.3)
    assert found.temperature_c == pytest.approx(
        (20.0 * len(first) + 26.0 * len(again)) / (len(first) + len(again))
    )


def test_a_session_that_is_not_there_is_no_judge() -> None:
    """Those that are there are named, each once."""
    with pytest.raises(
        CalibrationError, match=r"--hold-out c: has to be one of several sessions, here are a, b$"
    ):
        calibrate_sessions(design(), [session(name, number) for number, name in enumerate("abb")], "c")
