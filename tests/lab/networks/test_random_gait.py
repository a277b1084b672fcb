"""Random gaits: loads that a foot on the ground can have, the same for the same seed."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from footsense.lab.training.random_gait import (
    FLANK_S,
    MAX_FRICTION_REL,
    STANCE_S,
    RandomGait,
    RandomStance,
)

MAX_N, DURATION_S = 2.0, 3.0
T_S = np.arange(0.0, DURATION_S, 2.7e-3)

seeds = st.integers(0, 100_000)


def gait(seed: int, max_n: float = MAX_N) -> RandomGait:
    return RandomGait(np.random.default_rng(seed), max_n, DURATION_S, shaking_share=0.5)


@given(seeds)
def test_every_load_is_one_of_a_foot_on_the_ground(seed: int) -> None:
    """It presses, at most as hard as the foot stands, and the friction holds it; the normal leans at most by 50 deg."""
    normal, force_n = gait(seed).loads(T_S)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0)
    assert (normal[:, 2] > np.cos(np.radians(50.1))).all()
    pressing_n = (force_n * normal).sum(axis=1)
    assert pressing_n.min() >= 0.0
    assert pressing_n.max() <= MAX_N * (1.0 + 1e-12)
    sideways_n = np.linalg.norm(force_n - pressing_n[:, None] * normal, axis=1)
    assert (sideways_n <= MAX_FRICTION_REL * pressing_n + 1e-9).all()


@given(seeds)
def test_in_the_air_there_is_nothing(seed: int) -> None:
    """Before the first stance and between two: exactly no force, and before the first the normal is up."""
    normal, force_n = gait(seed).loads(T_S)
    air = np.asarray(~force_n.any(axis=1))
    assert air[T_S < 0.1].all()
    np.testing.assert_array_equal(normal[air & (T_S < 0.1)], np.tile([0.0, 0.0, 1.0], ((T_S < 0.1).sum(), 1)))


def test_a_seed_is_a_gait() -> None:
    """The same seed gives the same bits, another another gait; a stronger foot is pressed as much harder."""
    for one, again in zip(gait(5).loads(T_S), gait(5).loads(T_S), strict=True):
        np.testing.assert_array_equal(one, again)
    assert (gait(5).loads(T_S).force_n != gait(6).loads(T_S).force_n).any()
    np.testing.assert_allclose(gait(5, 4.0).loads(T_S).force_n, 2.0 * gait(5).loads(T_S).force_n)


@given(seeds)
def test_a_stance_begins_and_ends_with_nothing(seed: int) -> None:
    """Its load grows from zero within the longest rise, and is over at its end."""
    stance = RandomStance(np.random.default_rng(seed), MAX_N)
    assert STANCE_S[0] <= stance.duration_s <= STANCE_S[1]
    around_s = np.array([-1e-9, 0.0, stance.duration_s - 1e-9, stance.duration_s, stance.duration_s + 1.0])
    np.testing.assert_allclose(stance.loads(around_s).force_n, 0.0, atol=1e-5)
    inside_s = np.linspace(0.0, stance.duration_s, 400)
    assert np.abs(stance.loads(inside_s).force_n).max() > 1e-3 * MAX_N


def test_the_gaits_differ_as_much_as_they_say() -> None:
    """Of 300 stances: short and long, light touches and heavy loads, fast and slow rises, leans and friction."""
    peaks_n, durations_s, leans_deg, friction, rises_s = [], [], [], [], []
    rng = np.random.default_rng(9)
    for _ in range(300):
        stance = RandomStance(rng, MAX_N)
        t_s = np.linspace(0.0, stance.duration_s, 2000)
        normal, force_n = stance.loads(t_s)
        pressing_n = (force_n * normal).sum(axis=1)
        top = pressing_n.argmax()
        peaks_n.append(pressing_n[top])
        durations_s.append(stance.duration_s)
        leans_deg.append(np.degrees(np.arccos(normal[top, 2])))
        friction.append(np.linalg.norm(force_n[top] / pressing_n[top] - normal[top]))
        rises_s.append(t_s[np.argmax(pressing_n > 0.5 * pressing_n[top])])
    assert min(peaks_n) < 0.02 * MAX_N
    assert max(peaks_n) > 0.5 * MAX_N
    assert min(durations_s) < 0.08
    assert max(durations_s) > 1.5
    assert 20.0 < np.percentile(leans_deg, 97) < 50.0
    assert max(friction) > 0.4
    assert np.percentile(rises_s, 5) < 2 * FLANK_S[0]
    assert np.percentile(rises_s, 95) > 0.3 * FLANK_S[1]
