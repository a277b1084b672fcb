"""Ground that sticks, creeps and slides, and the gaits on it."""

import numpy as np
import pytest

from footsense.lab.evaluation.rough_gait import INTEGRATION_STEP_S, RoughGait, SlidingGround, SwingShake

GROUND = SlidingGround(
    kinetic_friction=0.4, static_over_kinetic_friction=1.2, leg_stiffness_n_per_mm=0.5, max_creep_mm_per_s=0.0
)


def test_a_foot_sticks_below_the_cone() -> None:
    """The force is the demanded one, and nothing slides."""
    demand_n = np.outer(np.linspace(0.0, 0.47, 100), [0.6, 0.8])
    force_n, slid_mm = GROUND.tangential_n_and_slid_mm(np.ones(100), demand_n)
    assert np.allclose(force_n, demand_n)
    assert slid_mm[-1] == 0.0


def test_a_dragged_foot_slides_at_the_cone() -> None:
    """10 mm of drag: the spring takes what the cone allows, the foot slides the rest, slower friction when it moves."""
    drag_mm = np.linspace(0.0, 10.0, 1000)
    force_n, slid_mm = GROUND.tangential_n_and_slid_mm(np.ones(1000), 0.5 * np.outer(drag_mm, [1.0, 0.0]))
    assert np.max(force_n) == pytest.approx(0.48, abs=0.01)
    assert np.max(force_n[200:]) <= 0.48
    assert slid_mm[-1] == pytest.approx(10.0 - force_n[-1, 0] / 0.5)


def test_creep_relaxes_the_spring() -> None:
    """A held drag at 0.9 of the cone creeps at 0.9 to the fourth of the rate at the cone."""
    creeping = SlidingGround(
        kinetic_friction=0.4,
        static_over_kinetic_friction=1.0,
        leg_stiffness_n_per_mm=0.5,
        max_creep_mm_per_s=1.0,
    )
    _, slid_mm = creeping.tangential_n_and_slid_mm(np.ones(10), np.tile([0.36, 0.0], (10, 1)))
    assert slid_mm[0] == pytest.approx(0.9**4 * INTEGRATION_STEP_S)
    assert slid_mm[-1] < 10.0 * slid_mm[0]


def test_forces_stay_in_the_cone_of_their_ground() -> None:
    """Of every stance of some gaits; way slid and stance number tell the truth; the same seed gives the same."""
    t_s = np.arange(0.0, 5.0, 2.7e-3)
    for seed in range(6):
        gait, again = (RoughGait(np.random.default_rng(seed), 2.0, 5.0) for _ in range(2))
        loads, slides = gait.loads(t_s), gait.true_slip(t_s)
        assert np.array_equal(loads.force_n, again.loads(t_s).force_n)
        assert np.allclose(np.linalg.norm(loads.normal, axis=1), 1.0)
        pressing_n = (loads.normal * loads.force_n).sum(axis=1)
        tangential_n = np.linalg.norm(loads.force_n - pressing_n[:, None] * loads.normal, axis=1)
        stands = (slides.stance_number >= 0) & (pressing_n > 0.01)
        assert stands.any()
        # Between two steps of the integration, force and cone are interpolated.
        assert (tangential_n <= 1.16 * slides.kinetic_friction * pressing_n + 0.02)[stands].all()
        assert np.degrees(np.arccos(loads.normal[stands, 2].min())) <= 45.1
        for number in np.unique(slides.stance_number[slides.stance_number >= 0]):
            assert (np.diff(slides.slid_mm[slides.stance_number == number]) >= 0.0).all()


def test_a_swing_shakes_and_a_stance_does_not() -> None:
    """Some millinewtons of inertia in swing, none where there is no swing."""
    t_s = np.arange(0.0, 2.0, 1e-3)
    shake = SwingShake(np.random.default_rng(1), 2.0)
    force_n = shake.force_n(t_s, np.where(t_s < 1.0, t_s, np.nan))
    assert 1e-3 < np.abs(force_n).max() < 0.05
    assert not force_n[t_s >= 1.0].any()
