"""Electrodes that are found while a foot walks: what is found, what is refused, and what survives a restart."""

from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

from footsense.calibration.selfcal.instants import LegScans, StanceSampler
from footsense.calibration.selfcal.proposal import propose
from footsense.calibration.selfcal.state import other_foot, read_state, state_path, write_state
from footsense.calibration.selfcal.walking_fit import electrodes_before_walking, fit_instants
from footsense.calibration.selfcal.walking_foot import WalkingFoot
from footsense.calibration.twin import GAIN
from footsense.cli.calibration.proposals import accept, revert
from footsense.cli.calibration.selfcal import line_of
from footsense.daemon.foot_types import released_path
from footsense.errors import CalibrationError
from footsense.foot.calibration_files import read_calibration
from footsense.foot.directions import angles_between_deg, normalized
from footsense.foot.parameters import FootParameters
from footsense.foot.specimen import Specimen
from tests.support.calibrations import calibration
from tests.support.test_stand_loads import design
from tests.support.walking_foot import CONVERSION_NS, drifted, identity, made_foot, walk, walking_foot

Vector = NDArray[np.float64]

_WRITTEN = "2026-11-29T09:00:00Z"


def _error_deg(foot: Specimen, own: FootParameters) -> float:
    """Return the mean direction error of other loads."""
    rng = np.random.default_rng(9)
    normal = normalized(np.column_stack([rng.uniform(-0.2, 0.2, (60, 2)), np.ones(60)]))
    force_n = rng.uniform(0.2, 0.8, (60, 1)) * normalized(
        normal + np.pad(rng.uniform(-0.2, 0.2, (60, 2)), ((0, 0), (0, 1)))
    )
    found = design().estimate_in_foot_frame(
        foot.capacitance_pf(normal, force_n), foot.unloaded_pf, own.stray_pf, own.gain_rel
    )
    return float(angles_between_deg(found.force_n, force_n).mean())


def test_readings_of_an_instant_are_those_of_one_time() -> None:
    """Nine readings of one scan are 6 ms apart; interpolated, they are right to what their sigma says."""
    foot, _ = made_foot(0)
    scans, clean_pf = walk(foot, 6)
    found = StanceSampler(foot.unloaded_pf).add(scans)
    assert len(found.t_ns) == 15  # of the last stance nobody knows that it has ended
    assert found.part.tolist() == 5 * [0, 1, 2]
    t_ns = CONVERSION_NS * np.arange(1, len(clean_pf) + 1)
    true_pf = np.stack([np.interp(found.t_ns, t_ns, of_element) for of_element in clean_pf.T], axis=1)
    off = np.abs(found.capacitance_pf - true_pf) / found.sigma_pf
    assert (off < 3.0).mean() > 0.98
    raw_pf = scans.capacitance_pf[np.searchsorted(scans.t_ns.mean(axis=1), found.t_ns)]
    assert np.abs(raw_pf - true_pf).max() > 10.0 * np.abs(found.capacitance_pf - true_pf).max()
    np.testing.assert_allclose(found.baseline_pf[-1], foot.unloaded_pf, atol=0.5e-3)


def test_frames_that_are_missing_in_a_stance_make_no_reading_wrong() -> None:
    """A recorder that was too slow, for a tenth of a second in the middle of each stance."""
    foot, _ = made_foot(0)
    scans, clean_pf = walk(foot, 6)
    kept = np.arange(len(scans.t_ns)) % 74 // 15 != 3
    found = StanceSampler(foot.unloaded_pf).add(LegScans(*(values[kept] for values in scans)))
    assert len(found.t_ns) >= 10
    t_ns = CONVERSION_NS * np.arange(1, len(clean_pf) + 1)
    true_pf = np.stack([np.interp(found.t_ns, t_ns, of_element) for of_element in clean_pf.T], axis=1)
    assert (np.abs(found.capacitance_pf - true_pf) < 3.0 * found.sigma_pf).all()


def test_instants_that_the_model_does_not_explain_count_less() -> None:
    """Changes that are off by 5 % each leave more unknown than exact ones."""
    foot, known = made_foot(0)
    exact = StanceSampler(foot.unloaded_pf).add(walk(foot, 6)[0])
    off = 1.0 + 0.05 * np.random.default_rng(5).normal(size=exact.capacitance_pf.shape)
    spoiled = exact._replace(
        capacitance_pf=exact.baseline_pf + off * (exact.capacitance_pf - exact.baseline_pf)
    )
    before = electrodes_before_walking(design().response.design, known, calibrated=True)
    sigmas = []
    for instants in (exact, spoiled):
        found, misfit = fit_instants(design(), before, instants)
        sigmas.append(np.sqrt(np.diag(found.own_covariance)[GAIN]).mean())
    assert misfit > 1.3
    assert sigmas[1] > 1.05 * sigmas[0]


def test_stances_with_an_open_element_are_not_used() -> None:
    """A line that is cut after six stances: what was found until then stays, and is not proposed."""
    foot, known = made_foot(0)

    def cut(capacitance_pf: Vector, _: Vector) -> Vector:
        capacitance_pf[6:, :, 4] = known.stray_pf[4]
        return capacitance_pf

    scans, _ = walk(foot, 24, cut)
    whole, _ = walk(foot, 7)
    cut_off, before = (walking_foot(drifted(known), "0" * 64, one) for one in (scans, whole))
    assert cut_off.n_instants == before.n_instants > 0
    np.testing.assert_allclose(cut_off.electrodes.parameters, before.electrodes.parameters, atol=0.02)
    assert cut_off.saturated_rel > 0.7
    assert not cut_off.is_proposed


@pytest.mark.slow
@pytest.mark.parametrize("number", range(3))
def test_a_walk_finds_gains_that_have_drifted(number: int) -> None:
    """The error of other loads falls to a third or less, is proposed, and is told before and after."""
    foot, known = made_foot(number)
    old = drifted(known, number)
    found = walking_foot(old, "1" * 64, walk(foot, 31)[0])
    before_deg, after_deg = _error_deg(foot, old), _error_deg(foot, found.parameters())
    assert after_deg < before_deg / 3.0
    assert found.turn is not None
    assert after_deg < 2.0 * found.turn.sigma_deg
    assert (found.objection, found.is_proposed) == ("", True)
    assert line_of(found).startswith("lf foot-0007: electrodes turned by ")
    assert "since the calibration of 2026-03-01; a calibration is proposed: " in line_of(found)


@pytest.mark.slow
def test_a_walk_finds_the_electrodes_of_a_made_foot() -> None:
    """Nobody has calibrated it: a first fit from two starts, then the others."""
    foot, known = made_foot(1)
    uncalibrated = FootParameters(stray_pf=np.zeros(9), unloaded_pf=foot.unloaded_pf, gap_um=np.full(9, 20.0))
    found = walking_foot(uncalibrated, "", walk(foot, 21)[0])
    assert _error_deg(foot, found.parameters()) < 0.2 * _error_deg(foot, uncalibrated)
    assert _error_deg(foot, found.parameters()) < _error_deg(foot, known) + 1.5
    assert "against the design" in line_of(found)


def _unworn(capacitance_pf: Vector, _: Vector) -> Vector:
    return capacitance_pf


def _creeping(capacitance_pf: Vector, phase: Vector) -> Vector:
    """Return capacitances of elements whose changes creep by 3 % (rms), each by another share, in a stance."""
    crept = 0.03 * np.random.default_rng(5).normal(size=9) * np.clip(phase, 0.0, 1.0)[:, None]
    return capacitance_pf + crept * (capacitance_pf - capacitance_pf[:, :1])


def _on_floor(capacitance_pf: Vector, phase: Vector) -> Vector:
    """Return capacitances with up to 0.1 pF that the floor adds in a stance, to each element another share."""
    share = np.random.default_rng(5).uniform(0.7, 1.0, 9)
    return capacitance_pf + 0.1 * share * ((phase > 0.0) & (phase < 1.0))[:, None]


@pytest.mark.slow
@pytest.mark.parametrize("worn", [_creeping, _on_floor])
def test_what_only_seems_to_be_electrodes_is_not_proposed(worn: Callable[[Vector, Vector], Vector]) -> None:
    """A foot whose calibration is right, with elements that creep differently, or on a floor that adds capacitance."""
    foot, known = made_foot(0)
    found = walking_foot(known, "1" * 64, walk(foot, 21, worn)[0])
    assert found.n_instants > 50
    assert found.objection
    assert not found.is_proposed
    assert "nothing proposed: " in line_of(found)


@pytest.mark.slow
@pytest.mark.parametrize("worn", [_unworn, _creeping, _on_floor])
def test_a_calibration_that_is_right_is_confirmed_once_it_is_old(
    worn: Callable[[Vector, Vector], Vector],
) -> None:
    """Whose turn is not certain: one of today stays, one of days ago is replaced by what the walk knows better."""
    foot, known = made_foot(1)
    scans, _ = walk(foot, 31, worn)
    today, old = (walking_foot(known, "1" * 64, scans, expected_deg=deg) for deg in (1.0, 6.6))
    assert today.objection == "no improvement to expect"
    assert old.is_proposed
    assert old.turn is not None
    assert old.turn.sigma_deg < 6.6 / 2.0
    assert _error_deg(foot, old.parameters()) < 2.0 * old.turn.sigma_deg
    assert line_of(old).endswith(f"a calibration is proposed: 6.6 to {old.turn.sigma_deg:.1f} deg expected")


@pytest.mark.slow
def test_a_state_goes_on_after_a_restart(tmp_path: Path) -> None:
    """What is read back is what was written, to the bit, and further stances give the same."""
    foot, known = made_foot(2)
    scans, _ = walk(foot, 21)
    one = walking_foot(drifted(known), "1" * 64, scans)
    write_state(tmp_path, one.state(_WRITTEN))
    state = read_state(state_path(tmp_path, "lf"))
    other = WalkingFoot(design(), identity("1" * 64), drifted(known), 0.0, state)
    assert msgspec.json.encode(other.state(_WRITTEN)) == msgspec.json.encode(one.state(_WRITTEN))
    other.judge()
    assert line_of(other) == line_of(one)
    rested = WalkingFoot(design(), identity("1" * 64), drifted(known), 0.0, state, slept_min=60.0)
    assert np.trace(rested.electrodes.covariance) > np.trace(one.electrodes.covariance)


def test_a_state_of_another_foot_is_named(tmp_path: Path) -> None:
    """Foot, board and calibration; a file that is none is an error in one line."""
    _, known = made_foot(0)
    write_state(tmp_path, walking_foot(known, "1" * 64).state(_WRITTEN))
    state = read_state(state_path(tmp_path, "lf"))
    assert other_foot(state, identity("1" * 64)) == ""
    assert other_foot(state, identity("1" * 64, "foot-0008")) == "foot foot-0007, here is foot-0008"
    assert other_foot(state, identity("2" * 64)).startswith("calibration 1111")
    other_board = msgspec.structs.replace(identity("1" * 64), board="fdc1004")
    assert other_foot(state, other_board) == "board ad7147, here is fdc1004"
    state_path(tmp_path, "lf").write_text('{"format": 1}')
    with pytest.raises(CalibrationError, match=r"lf\.json: is no state of `footsense selfcal`: "):
        read_state(state_path(tmp_path, "lf"))


def test_a_proposal_is_accepted_and_reverted(tmp_path: Path) -> None:
    """The former calibration is kept, and one command takes it back."""
    states, feet = tmp_path / "states", tmp_path / "feet"
    old = calibration(feet).manifest
    foot = walking_foot(read_calibration(feet / "foot-0007").parameters, old.sha256)
    runner, where = CliRunner(), ["--calibrations", str(feet)]
    with pytest.raises(CalibrationError, match="nothing is proposed in "):
        runner.invoke(accept, [*where, "--state", str(states)], standalone_mode=False, catch_exceptions=False)
    write_state(states, foot.state(_WRITTEN))
    foot.electrodes.parameters[:9] += 0.01
    propose(states, foot, released_path("network.onnx"), 23.5, _WRITTEN)
    said = runner.invoke(accept, [*where, "--state", str(states)])
    assert said.stdout.startswith("foot-0007: "), said
    new = read_calibration(feet / "foot-0007")
    np.testing.assert_allclose(new.parameters.stray_pf, np.linspace(0.1, 0.5, 9) + 0.01)
    np.testing.assert_array_equal(
        new.parameters.mount, read_calibration(feet / "foot-0007.1").parameters.mount
    )
    manifest = new.manifest
    assert (manifest.by_walking, manifest.made, new.calibrated_at_c) == (True, _WRITTEN, 23.5)
    assert not list((states / "proposed").iterdir())
    said = runner.invoke(revert, ["foot-0007", *where])
    assert said.exit_code == 0, said
    assert read_calibration(feet / "foot-0007").manifest.sha256 == old.sha256
    assert read_calibration(feet / "foot-0007.1").manifest.sha256 == new.manifest.sha256
    with pytest.raises(CalibrationError, match="no former calibration is kept"):
        runner.invoke(revert, ["foot-0008", *where], standalone_mode=False, catch_exceptions=False)
