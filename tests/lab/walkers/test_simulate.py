"""Robots in MuJoCo: what their feet feel is what mechanics says."""

from itertools import pairwise
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from footsense.frames import Vector
from footsense.lab.walkers import simulate
from footsense.lab.walkers.gaits import GAITS, WalkerGait
from footsense.lab.walkers.robots import GRAVITY_M_S2, ROBOTS, GroundModel
from footsense.lab.walkers.simulate import FallError, WalkerLog, simulate_walker
from footsense.lab.walkers.split import GROUNDS

FLAT = GROUNDS["flat"]


def pressing_n(log: WalkerLog) -> Vector:
    """Return the force along the normal [N], shape (n, legs): on flat ground the vertical one."""
    force_n: Vector = (log.force_n * log.normal).sum(axis=2)
    return force_n


@pytest.mark.parametrize("name", ["quadruped-12kg", "hexapod-2kg", "quadruped-300g"])
def test_a_standing_robot_weighs_what_it_weighs_on_upright_feet(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(GAITS, "still", WalkerGait(name="still"))
    log = simulate_walker(name, "still", FLAT, 1, 0.5)
    weight_n = ROBOTS[name].mass_kg * GRAVITY_M_S2
    assert pressing_n(log)[200:].sum(axis=1) == pytest.approx(weight_n, rel=0.03)
    assert np.degrees(np.arccos(log.normal[..., 2].min())) < 3.0
    assert np.abs(log.slip_m_s).max() < 5e-3


@pytest.fixture(scope="module")
def trot() -> WalkerLog:
    return simulate_walker("quadruped-12kg", "trot-slow", GROUNDS["friction-0.3"], 3, 2.0)


def test_a_trot_carries_the_weight_and_is_upright_in_the_middle_of_its_stances(trot: WalkerLog) -> None:
    loaded_n = pressing_n(trot)
    weight_n = ROBOTS["quadruped-12kg"].mass_kg * GRAVITY_M_S2
    assert loaded_n.sum(axis=1).mean() == pytest.approx(weight_n, rel=0.05)
    assert trot.n_touches() >= 8
    leans_deg = []
    for leg in range(4):
        edges = np.flatnonzero(np.diff((loaded_n[:, leg] > 0.1 * weight_n).astype(int)))
        leans_deg += [
            np.degrees(np.arccos(trot.normal[(first + last) // 2, leg, 2]))
            for first, last in pairwise(edges.tolist())
            if loaded_n[(first + last) // 2, leg] > 0.1 * weight_n and last - first > 100
        ]
    assert len(leans_deg) >= 6
    assert np.median(leans_deg) < 6.0


def test_friction_ends_at_its_coefficient(trot: WalkerLog) -> None:
    """Slides reach it, nothing exceeds it."""
    loaded_n = pressing_n(trot)
    tangential_n = np.linalg.norm(trot.force_n - loaded_n[..., None] * trot.normal, axis=2)
    ratio = tangential_n[loaded_n > 1.0] / loaded_n[loaded_n > 1.0]
    assert 0.29 < ratio.max() < 0.3001


def test_the_same_seed_gives_the_same_log() -> None:
    """Bit for bit; another seed gives another ground and other pushes."""
    one, same, other = (
        simulate_walker("hexapod-300g", "stand", GROUNDS["rough"], seed, 0.2) for seed in (1, 1, 2)
    )
    for name in one._fields:
        assert np.array_equal(getattr(one, name), getattr(same, name)), name
    assert not np.array_equal(one.force_n, other.force_n)


def test_a_foot_that_is_dragged_slides_as_fast_as_it_is_dragged() -> None:
    """In the foot's frame, which is turned against the ground's; friction is against the slide, at the cone."""
    turn = np.array([0.9, 0.1, 0.3, 0.3]) / np.linalg.norm([0.9, 0.1, 0.3, 0.3])
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option cone="elliptic" impratio="5"/><worldbody>
<geom type="plane" size="1 1 1" friction=".01"/><body pos="0 0 .0199">
<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint type="slide" axis="0 0 1"/>
<geom size=".001" mass=".01" contype="0" conaffinity="0"/>
<body name="lf" quat="{" ".join(map(str, turn))}"><geom name="lf" size=".02" mass="1" friction=".4"/></body>
</body></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    felt = simulate._Recorder(model, SimpleNamespace(legs={"lf": None}), 0.4)  # type: ignore[arg-type]
    drag_m_s = np.array([0.03, -0.05, 0.0])
    for _ in range(200):
        data.qvel[:2] = drag_m_s[:2]
        mujoco.mj_step(model, data)
        data.qvel[:2] = drag_m_s[:2]
        mujoco.mj_forward(model, data)
        felt.add(data)
    log, to_ground = felt.log(), np.zeros(9)
    mujoco.mju_quat2Mat(to_ground, turn)
    slip_m_s, force_n, normal = (
        to_ground.reshape(3, 3) @ part[-1, 0] for part in (log.slip_m_s, log.force_n, log.normal)
    )
    np.testing.assert_allclose(slip_m_s, drag_m_s, atol=1e-4)
    np.testing.assert_allclose(normal, [0.0, 0.0, 1.0], atol=1e-6)
    assert force_n[2] == pytest.approx(1.01 * 9.81, rel=0.02)
    np.testing.assert_allclose(
        force_n[:2], -0.4 * force_n[2] * drag_m_s[:2] / np.linalg.norm(drag_m_s), rtol=0.02
    )


def test_a_fall_is_one_line() -> None:
    cliff = GroundModel(friction=0.9, time_constant_s=0.008, slope_deg=(45.0, 90.0))
    with pytest.raises(
        FallError, match=r"^quadruped-12kg falls in gait stand after \d\.\d\d s on this ground$"
    ):
        simulate_walker("quadruped-12kg", "stand", cliff, 1, 5.0)


def test_rough_ground_has_no_edge() -> None:
    """Set back with its ground, a robot has the same heights around it as before."""
    robot, rng = ROBOTS["hexapod-2kg"], np.random.default_rng(1)
    model = mujoco.MjModel.from_xml_string(robot.mjcf(GROUNDS["rough"], 1e-3))
    model.hfield_data[:] = simulate._rough_heights(robot, rng).ravel()
    data, cell_m = mujoco.MjData(model), simulate._cell_m(robot)

    def heights_m() -> list[float]:
        """Return the heights of the ground around the robot."""
        mujoco.mj_forward(model, data)
        only, down, hit = (
            np.array([1, 0, 0, 0, 0, 0], np.uint8),
            np.array([0.0, 0.0, -1.0]),
            np.zeros(1, np.int32),
        )
        around_m = 5.3 * cell_m * np.array([(0, 0), (1, 0), (0, 1), (-1, 0), (0, -1)])
        places = [np.array([*(data.qpos[:2] + at_m), 1.0]) for at_m in around_m]
        return [1.0 - mujoco.mj_ray(model, data, place, down, only, 1, -1, hit) for place in places]

    data.qpos[:3] = 41.3 * cell_m, -27.8 * cell_m, 1.2
    before_m, place_m = heights_m(), data.qpos[:2].copy()
    simulate._keep_on_field(model, data, cell_m)
    assert np.abs(data.qpos[:2]).max() < cell_m
    assert (np.abs(place_m) > 20 * cell_m).all()
    assert np.ptp(before_m) > 1e-3
    np.testing.assert_allclose(heights_m(), before_m, atol=1e-6)
