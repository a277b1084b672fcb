"""Feet that find their electrodes by standing: what the fit makes of unknown loads, which count, what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from footsense.calibration.standing.calibrate import calibrate_standing
from footsense.calibration.standing.recording import StandingLoads, standing_loads
from footsense.errors import CalibrationError
from footsense.estimation.network import steady_windows
from footsense.foot.directions import angles_between_deg, normalized
from footsense.foot.parameters import FootParameters
from footsense.foot.specimen import Specimen
from tests.support.test_stand_loads import design, made

Vector = NDArray[np.float64]

_SCAN_NS = 7_500_000


def _postures(n: int, seed: int, tilt: float = 0.2) -> tuple[Vector, Vector]:
    """Return contact normals and forces of a standing robot: legs tilt, and forces lean from the normal by friction."""
    rng = np.random.default_rng(seed)
    tilted, leaning = rng.uniform(-tilt, tilt, (2, n, 2))
    normal = normalized(np.column_stack([tilted, np.ones(n)]))
    direction = normalized(np.column_stack([tilted + leaning, np.ones(n)]))
    return normal, rng.uniform(0.2, 1.0, (n, 1)) * direction


def _standing(foot: Specimen, normal: Vector, force_n: Vector) -> StandingLoads:
    noise_pf = 1e-4 * np.random.default_rng(1).normal(size=(len(force_n), 9))
    unloaded_pf = np.tile(foot.unloaded_pf, (len(force_n), 1))
    return StandingLoads(foot.capacitance_pf(normal, force_n) + noise_pf, unloaded_pf)


def _direction_error_deg(foot: Specimen, own: FootParameters | None, seed: int) -> float:
    """Return the mean direction error of 60 other loads, read as the robot does."""
    normal, force_n = _postures(60, seed)
    stray_pf, gain_rel = (0.0, 1.0) if own is None else (own.stray_pf, own.gain_rel)
    capacitor = design().response.design
    closure_um = capacitor.closure_um(
        foot.capacitance_pf(normal, force_n) - stray_pf, foot.unloaded_pf - stray_pf
    )
    found_n = design().network_for_rows(60).estimate(steady_windows(closure_um / capacitor.gap_um / gain_rel))
    return float(angles_between_deg(found_n.force_n, force_n).mean())


def test_feet_find_their_electrodes_by_standing() -> None:
    """Ten unknown loads take the error of other loads to a fifth, on average; mount and stiffness stay as designed."""
    before_deg, after_deg = [], []
    for number in range(3):
        own = replace(made(number), mount=np.eye(3), stiffness_rel=0.0)
        foot = Specimen(design().response, own)
        found = calibrate_standing(design(), _standing(foot, *_postures(10, 1)), None)
        before_deg.append(_direction_error_deg(foot, None, 2))
        after_deg.append(_direction_error_deg(foot, found.parameters, 2))
        np.testing.assert_array_equal(found.parameters.mount, np.eye(3))
        assert found.parameters.stiffness_rel == 0.0
        # The mean angle is 1.25 times the standard deviation across.
        assert 0.3 < np.degrees(1.25 * found.parameters.error_rel) / after_deg[-1] < 1.3
        assert 0.7 * before_deg[-1] < found.turned_deg < 1.1 * before_deg[-1]
    assert np.mean(after_deg) < 0.2 * np.mean(before_deg)
    assert (np.array(after_deg) < 0.35 * np.array(before_deg)).all()


def test_what_a_reference_told_of_mount_and_stiffness_is_kept() -> None:
    """So is its remaining error; an electrode that did not change stays where it was."""
    own = made(1)
    foot = Specimen(design().response, own)
    known = FootParameters(
        stray_pf=own.stray_pf,
        unloaded_pf=foot.unloaded_pf,
        gap_um=design().response.design.gap_um + own.gap_um,
        stiffness_rel=0.1,
        mount=own.mount,
        error_rel=0.05,
    )
    found = calibrate_standing(design(), _standing(foot, *_postures(10, 1)), known)
    np.testing.assert_array_equal(found.parameters.mount, own.mount)
    assert (found.parameters.stiffness_rel, found.parameters.error_rel) == (0.1, 0.05)
    np.testing.assert_allclose(found.parameters.stray_pf, own.stray_pf, atol=0.1)
    assert found.turned_deg < 0.5


def test_what_loads_that_are_nearly_alike_leave_open_is_in_the_error() -> None:
    """A median angle over 1.177 is the standard deviation across; what the network errs comes on top."""
    foot = Specimen(design().response, replace(made(0), mount=np.eye(3), stiffness_rel=0.0))
    found = calibrate_standing(design(), _standing(foot, *_postures(8, 1, tilt=0.03)), None)
    open_deg = found.predicted_uncertainty.median_direction_error_deg / 1.177
    assert open_deg > 0.8
    assert np.degrees(found.parameters.error_rel) > 1.1 * open_deg


@pytest.mark.parametrize(
    ("loads", "told"),
    [
        pytest.param(_postures(4, 1), "4 different loads at rest; at least 5", id="too few"),
        pytest.param(_postures(6, 1, tilt=0.01), "too alike; lean the body forward", id="too alike"),
    ],
)
def test_loads_that_tell_too_little_are_refused(loads: tuple[Vector, Vector], told: str) -> None:
    """With what is missing."""
    foot = Specimen(design().response, made(0))
    with pytest.raises(CalibrationError, match=told):
        calibrate_standing(design(), _standing(foot, *loads), None)


def test_readings_of_no_foot_of_the_type_are_refused() -> None:
    """As of a foot whose connector is turned round."""
    foot = Specimen(design().response, made(0))
    loads = _standing(foot, *_postures(12, 3))
    order = [0, 5, 7, 3, 2, 8, 1, 6, 4]
    mixed = StandingLoads(loads.capacitance_pf[:, order], loads.baseline_pf[:, order])
    with pytest.raises(CalibrationError, match="standard deviations or more from any foot of this type"):
        calibrate_standing(design(), mixed, None)


def _scans(*parts: tuple[float, Vector]) -> tuple[NDArray[np.int64], Vector, Vector]:
    """Return times, readings and sizes of force of parts: how long [s], and changes of the readings [pF]."""
    changes = np.concatenate(
        [np.tile(change, (round(1e9 * long_s / _SCAN_NS), 1)) for long_s, change in parts]
    )
    size_n = np.where(changes.any(axis=1), 0.5, 0.001)
    return np.arange(len(changes)) * _SCAN_NS + 1, 5.0 + changes, size_n


_AIR, _ONE, _OTHER = np.zeros(9), np.linspace(0.1, 0.4, 9), np.linspace(0.5, 0.2, 9)


def test_each_posture_is_one_load_and_the_same_one_again_is_none() -> None:
    """Too short a stand is none, either; one that hangs is no load."""
    parts = ((1.0, _AIR), (1.0, _ONE), (1.0, _OTHER), (1.0, 1.01 * _ONE), (0.3, 2.0 * _ONE), (1.0, _AIR))
    loads = standing_loads(*_scans(*parts), 0.02)
    np.testing.assert_allclose(loads.capacitance_pf, 5.0 + np.array([_ONE, _OTHER]))
    assert loads.n_alike == 1
    assert loads.loaded_s == pytest.approx(3.3, abs=0.05)


def test_the_unloaded_reading_drifts_from_one_hanging_to_the_next() -> None:
    """A load's is that of its own time."""
    t_ns, readings_pf, size_n = _scans((1.0, _AIR), (1.0, _ONE), (1.0, _AIR))
    drift_pf = 0.01 * 1e-9 * t_ns[:, None]
    loads = standing_loads(t_ns, readings_pf + drift_pf, size_n, 0.02)
    np.testing.assert_allclose(loads.baseline_pf, 5.015, atol=2e-3)
    np.testing.assert_allclose(loads.drift_corrected_pf, 5.015 + _ONE[None], atol=2e-3)


def test_a_foot_that_never_hangs_is_refused() -> None:
    """Nothing tells what it reads without a load."""
    with pytest.raises(CalibrationError, match=r"no time of 0\.3 s in which it hangs free"):
        standing_loads(*_scans((1.0, _ONE), (1.0, _OTHER)), 0.02)


def test_a_foot_that_only_walks_is_told_to_stand() -> None:
    """The readings rise and fall all the time."""
    steps = [(0.03, 0.1 * n * _ONE) for n in (*range(1, 11), *range(10, 0, -1))]
    loads = standing_loads(*_scans((1.0, _AIR), *(5 * steps)), 0.02)
    with pytest.raises(
        CalibrationError, match=r"it stood still for 0\.0 of 2\.7 s under load; hold each posture"
    ):
        calibrate_standing(design(), loads, None)
