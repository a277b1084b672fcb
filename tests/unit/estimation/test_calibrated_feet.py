"""Feet that differ from their design, read with what a bench found of them."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from footsense.estimation.calibrated_feet import CalibratedFeet
from footsense.estimation.network import steady_windows
from footsense.estimation.walking.ground import foot_loads, ground_of
from footsense.foot.parameters import UNKNOWN_TEMPERATURE_SIGMA_REL, FootParameters
from footsense.ports import LoadEstimate, Window

Vector = NDArray[np.float64]


class _Linear:
    """A network that reads x, y and z off the newest readings of three elements, and the contact off four others."""

    def estimate(self, window: Window) -> LoadEstimate:
        """Return them, and a sigma of its own for each axis."""
        newest = window.closure_rel[:, 0]
        sigma_n = np.tile([0.01, 0.02, 0.03], (len(newest), 1))
        return LoadEstimate(newest[:, [5, 7, 4]], sigma_n, newest[:, :4], newest[:, :4] + 0.1)


class _Sharp(_Linear):
    """The same, surer of the contact."""

    def estimate(self, window: Window) -> LoadEstimate:
        """Return the load with other deviations of the contact."""
        load = super().estimate(window)
        return load._replace(
            contact_sigma=np.tile([0.01, 0.02, 0.03, 0.04], (len(load.contact_point_and_friction), 1))
        )


def _foot(**own: object) -> FootParameters:
    plain: dict[str, object] = {
        "stray_pf": np.zeros(9),
        "unloaded_pf": np.full(9, 5.4),
        "gap_um": np.full(9, 20.0),
    }
    return FootParameters(**(plain | own))  # type: ignore[arg-type]


def test_a_foot_as_designed_is_read_as_the_network_says() -> None:
    """Neither no parameters nor neutral ones change a bit."""
    closures = np.random.default_rng(1).random((2, 9))
    plain = _Linear().estimate(steady_windows(closures))
    read = CalibratedFeet(_Linear(), [None, _foot()]).estimate(steady_windows(closures))
    np.testing.assert_array_equal(read.force_n, plain.force_n)
    np.testing.assert_allclose(read.sigma_n, plain.sigma_n)
    np.testing.assert_array_equal(read.contact_point_and_friction, plain.contact_point_and_friction)
    np.testing.assert_array_equal(read.contact_sigma, plain.contact_sigma)


def test_each_row_gets_its_own_foot() -> None:
    quarter = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    feet = [_foot(stiffness_rel=0.5, mount=quarter), _foot(stiffness_rel=0.1)]
    closures = np.zeros((2, 9))
    closures[:, [5, 7, 4]] = [0.2, 0.4, 0.6]
    force_n, sigma_n, *_ = CalibratedFeet(_Linear(), feet).estimate(steady_windows(closures))
    np.testing.assert_allclose(force_n[0], 1.5 * quarter.T @ [0.2, 0.4, 0.6])
    np.testing.assert_allclose(force_n[1], [0.22, 0.44, 0.66])
    np.testing.assert_allclose(sigma_n[0], 1.5 * np.array([0.02, 0.01, 0.03]))
    np.testing.assert_allclose(sigma_n[1], [0.011, 0.022, 0.033])


@pytest.mark.parametrize("turn_rad", [(0.0, 0.0, np.pi / 2), (0.3, 0.0, 0.0), (0.1, -0.2, 1.0)])
def test_the_contact_is_turned_by_the_mount_as_the_force_is(turn_rad: tuple[float, float, float]) -> None:
    """Normal and friction read off the leg's frame are those of the foot's, rotated; angles keep their sigma."""
    mount = Rotation.from_rotvec(turn_rad).as_matrix()
    closures = np.zeros((2, 9))
    closures[:, [5, 7, 4]] = [0.1, 0.2, 1.0]
    closures[:, :4] = [0.1, -0.05, 0.2, 0.1]
    resting = steady_windows(closures)
    plain, turned = (
        [ground_of(foot) for foot in foot_loads(feet.estimate(resting))]
        for feet in (_Sharp(), CalibratedFeet(_Sharp(), [_foot(mount=mount), None]))
    )
    for row, rotation in enumerate((mount.T, np.eye(3))):
        before, after = plain[row], turned[row]
        assert after.normal == pytest.approx((rotation @ before.normal).tolist())
        assert after[2:] == pytest.approx(before[2:])
        assert after.pressing_n == pytest.approx(before.pressing_n)


def test_a_temperature_scales_what_it_is_known_for() -> None:
    """10 K more stiffen a foot by 4.4 %; not known, they widen another's sigma; a designed foot is left alone."""
    feet = [_foot(), _foot(), None]
    resting = steady_windows(np.full((3, 9), 0.3))
    read = CalibratedFeet(_Linear(), feet, [23.0, 23.0, None])
    on_bench_n, bench_sigma_n, *_ = read.estimate(resting)
    read.set_temperature(np.array([33.0, np.nan, np.nan]))
    force_n, sigma_n, *_ = read.estimate(resting)
    np.testing.assert_allclose(force_n, on_bench_n * np.array([1.044, 1.0, 1.0])[:, None])
    np.testing.assert_allclose(sigma_n[0], 1.044 * bench_sigma_n[0])
    unknown_n = UNKNOWN_TEMPERATURE_SIGMA_REL * force_n[1]
    np.testing.assert_allclose(sigma_n[1], np.hypot(bench_sigma_n[1], unknown_n))
    np.testing.assert_array_equal(sigma_n[2], bench_sigma_n[2])


@pytest.mark.parametrize(
    ("own", "words"),
    [
        ({"stray_pf": np.full(9, 6.0)}, "above stray_pf"),
        ({"gap_um": np.zeros(9)}, "gap_um: has to be above 0"),
        ({"mount": np.ones((3, 3))}, "no rotation"),
        ({"stiffness_rel": -1.0}, "above -1"),
    ],
)
def test_what_no_foot_can_be_is_refused(own: dict[str, object], words: str) -> None:
    """One line, by the name of the value."""
    with pytest.raises(ValueError, match=words):
        _foot(**own)
