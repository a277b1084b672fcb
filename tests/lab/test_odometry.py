"""The filter of the odometry: consistent where its errors are known, and close where no foot slides."""

import numpy as np
import pytest

from footsense.lab.odometry.run import Filter, example, run_filters
from footsense.lab.odometry.sources import Loads, sources
from footsense.lab.odometry.walk import PUBLISH_EVERY, STEP_S, OdometryWalk
from footsense.lab.walkers.robots import ROBOTS
from footsense.lab.walkers.split import WalkerRun
from footsense.validation.fault_table import ROBOTS as ROBOTS_OF_BOARDS

pytestmark = pytest.mark.lab

FEET_M = np.array([[0.2, 0.1, -0.3], [0.2, -0.1, -0.3], [-0.2, 0.1, -0.3], [-0.2, -0.1, -0.3]])
LEAN = np.array([0.1, -0.2, 0.0])


@pytest.fixture(scope="module")
def trot() -> OdometryWalk:
    return OdometryWalk(WalkerRun("quadruped-12kg", "trot-fast", "flat", 11, 4.0))


def test_a_standing_robot_keeps_its_place_and_errs_as_its_covariance_says() -> None:
    """Of fifty robots that lean, with the biases and the noise that the filter expects."""
    odometry, n, n_steps = example(), 50, 120
    rng = np.random.default_rng(1)
    true = odometry.rotations(LEAN)[0]
    bias = odometry.BIAS_SIGMA * rng.normal(size=(n, 6))
    noise = odometry.IMU_NOISE / np.sqrt(STEP_S)
    still = np.concatenate([np.zeros(3), -odometry.GRAVITY_M_S2 @ true])
    filters = odometry.Odometry(still[3:] + bias[:, 3:], len(FEET_M), 0.02)
    for _ in range(n_steps):
        imu = still + bias + noise * rng.normal(size=(n, 6))
        feet_m = FEET_M + odometry.FOOT_SIGMA_M * rng.normal(size=(n, *FEET_M.shape))
        firm = np.full((n, len(FEET_M)), 1e-4)
        filters.step(STEP_S, imu[:, :3], imu[:, 3:], feet_m, np.zeros((len(FEET_M), 3)), firm)
    speed_m_s, place_m = filters.columns[:, 0], filters.columns[:, 1]
    assert np.abs(place_m).max() < 3e-3
    up = filters.rotation[:, 2]
    lean_deg = np.degrees(np.arccos(np.minimum(up @ true[2], 1.0)))
    assert np.sqrt((lean_deg**2).mean()) == pytest.approx(np.degrees(np.hypot(0.1, 0.1) / 9.81), rel=0.25)
    error = np.concatenate([-speed_m_s, bias - filters.bias], axis=1)
    rows = np.r_[3:6, -6:0]
    covariance = filters.covariance[:, rows[:, None], rows]
    squared = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error)
    assert squared.mean() == pytest.approx(len(rows), rel=0.2)


@pytest.mark.slow
def test_feet_that_do_not_slide_carry_a_robot_over_a_metre_without_much_drift(trot: OdometryWalk) -> None:
    senses, feet = trot.senses(), trot.feet
    firm = feet.force_n.any(axis=2) & (np.linalg.norm(feet.slip_m_s, axis=2) < 0.01)
    loads = np.where(firm[trot.rows[1:]], np.inf, 0.0)
    nothing = Loads(np.zeros_like(loads), np.zeros_like(loads))
    poses = run_filters(
        trot, senses, [Filter(source, False) for source in (Loads(loads, np.zeros_like(loads)), nothing)]
    )
    with_feet, without = trot.drift_rel(*poses)
    assert trot.way_m[-1] > 1.5
    assert with_feet < 0.02
    assert without > 0.05


@pytest.mark.slow
def test_the_force_vector_drifts_less_than_the_contact_flag(trot: OdometryWalk) -> None:
    senses = trot.senses()
    known = sources(trot, senses, {"ad7147": trot.published("ad7147")})
    filters = [Filter(known[f"`ad7147`, {of}"], False) for of in ("force vector", "contact flag")]
    by_vector, by_flag = trot.drift_rel(*run_filters(trot, senses, filters))
    assert by_vector < 0.02
    assert by_flag > 1.5 * by_vector


def test_forces_are_published_as_by_the_service() -> None:
    assert {
        board: ROBOTS_OF_BOARDS[board].effective_publish_every for board in PUBLISH_EVERY
    } == PUBLISH_EVERY


@pytest.mark.parametrize("name", ["hexapod-2kg", "quadruped-12kg"])
def test_a_foot_is_where_its_joints_put_it_and_upright_in_the_middle_of_a_stance(name: str) -> None:
    robot = ROBOTS[name]
    for leg in robot.legs:
        middle_m = robot.neutral_m(leg)
        feet_m = middle_m + 0.2 * robot.shank_m * np.array([[0.0] * 3, [0.5, 0.3, 0.4], [-0.5, 0.4, 0.1]])
        at_m, turned = robot.foot_poses(leg, robot.joint_angles_rad(leg, feet_m))
        np.testing.assert_allclose(at_m, feet_m, atol=1e-12)
        np.testing.assert_allclose(turned[0], np.eye(3), atol=1e-12)
