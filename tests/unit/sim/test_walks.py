"""The loads of the scenes, and a foot whose gait cycle is computed once."""

import numpy as np
import pytest

from footsense.daemon.foot_types import released_path
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Specimen
from footsense.frames import LEGS
from footsense.sim.loads.gait_table import GaitTable
from footsense.sim.loads.ground_load import RampContact
from footsense.sim.loads.walk import Walk, measured_strides_by_side, measured_walk, smooth_stance_reaction
from footsense.sim.scene_loads import Standstill, Tripod

S = 1_000_000_000


def tripod() -> Walk:
    return Walk(dict.fromkeys(LEGS, smooth_stance_reaction(0.6, 1.2, 0.15)), S, 0.6, 10.0, from_ns=S // 2)


def test_three_legs_carry_at_any_time_and_change_with_the_others() -> None:
    """Two tripods, half a period apart; before the walk all feet are in the air."""
    walk = tripod()
    assert all(walk.contact(leg, S // 4).force_n[2] == 0 for leg in LEGS)
    early = {leg for leg in LEGS if walk.contact(leg, S // 2 + S // 4).force_n[2] > 0}
    late = {leg for leg in LEGS if walk.contact(leg, S // 2 + 3 * S // 4).force_n[2] > 0}
    assert early == {"lf", "rm", "lr"}
    assert late == {"rf", "lm", "rr"}


@pytest.mark.parametrize("walk", [tripod(), measured_walk(1.5, 10.0, 0)])
def test_normals_are_unit_and_friction_stays_in_its_cone(walk: Walk) -> None:
    """The ground only pushes, and the force leans from the normal by no more than feet grip."""
    for t_ns in range(0, 3 * S, 7_000_000):
        for leg in LEGS:
            normal, force_n = walk.contact(leg, t_ns)
            assert np.linalg.norm(normal) == pytest.approx(1.0)
            push_n = float(force_n @ normal)
            assert push_n >= 0
            if push_n > 0.05:
                assert np.linalg.norm(force_n - push_n * normal) < 0.5 * push_n


def test_a_leaning_leg_sees_the_vertical_in_its_own_frame() -> None:
    """At touchdown the foot is ahead: the ground pushes it backwards along z and forwards along x."""
    normal = tripod().contact("lf", S // 2 + 1).normal
    np.testing.assert_allclose(normal, [np.sin(np.radians(10)), 0, np.cos(np.radians(10))], atol=1e-6)


def test_the_measured_walk_is_what_was_measured_scaled() -> None:
    """The largest vertical force becomes 1.5 N, the shape stays: both feet have a stance of 0.8 s in 1.145 s."""
    strides = measured_strides_by_side()
    assert strides["right"].stride_s == pytest.approx(1.145, abs=2e-3)
    assert strides["left"].stance_s == pytest.approx(0.795, abs=5e-3)
    walk = measured_walk(1.5, 0.0, 0)
    fz_n = np.array(
        [[walk.contact(leg, t_ns).force_n[2] for leg in ("lf", "rf")] for t_ns in range(0, 2 * S, S // 1000)]
    )
    assert fz_n.max() == pytest.approx(1.5, abs=0.01)
    right = strides["right"].force_n[:, 2]
    assert fz_n[:, 1].max() == pytest.approx(1.5 * right.max() / 943.38, abs=0.01)


def test_a_ramp_grows_evenly_and_stays() -> None:
    """In the air before it begins, half of the force at half of the time, all of it from its end on."""
    ramp = RampContact((0.0, 0.6, 0.8), from_ns=S, rise_ns=S // 5)
    shares = [
        np.linalg.norm(ramp.contact("lf", t_ns).force_n) for t_ns in (S - 1, S + S // 10, S + S // 5, 9 * S)
    ]
    np.testing.assert_allclose(shares, [0.0, 0.5, 1.0, 1.0])


WALK = Tripod(period_s=1.2, duty_rel=0.6, peak_force_n=0.9, friction_rel=0.15, pitch_deg=10.0)
MS = 1_000_000


@pytest.mark.parametrize("relative_compliance", [1.0, 0.9983, 0.9277])
def test_the_table_is_the_foot(relative_compliance: float) -> None:
    """Less than a twentieth of a converter's noise, all over the stance and at a temperature between two tables."""
    foot, walk = Specimen(FootResponse.load(released_path("response.npz"))), WALK.build(0)
    table = GaitTable(foot, walk, "lf", (1.0, 0.92))
    phases = np.random.default_rng(1).uniform(0.0, 0.6, 100)
    contacts = [walk.contact_at_phase("lf", phase) for phase in phases.tolist()]
    exact_pf = foot.capacitance_pf(
        np.array([contact.normal for contact in contacts]),
        relative_compliance * np.array([contact.force_n for contact in contacts]),
    )
    found_pf = np.array([table.capacitance_pf(phase, relative_compliance) for phase in phases.tolist()])
    assert np.abs(found_pf - exact_pf).max() < 0.3e-3
    assert np.array_equal(table.capacitance_pf(None), foot.unloaded_pf)


def test_a_robot_that_stands_is_on_all_six_and_walks_on_as_if_it_had_not() -> None:
    """From the middle of the next stance on, with the force of that moment, for whole cycles."""
    walk = WALK.build(500 * MS)
    stands = Tripod(
        period_s=1.2, duty_rel=0.6, peak_force_n=0.9, stands=(Standstill(from_s=4.0, until_s=9.0),)
    ).build(500 * MS)
    for t_ns in (*range(0, 4_000 * MS, 7 * MS), *range(11_500 * MS, 14_000 * MS, 7 * MS)):
        assert all(
            stands.gait_phase_in_stance(leg, t_ns) == walk.gait_phase_in_stance(leg, t_ns) for leg in LEGS
        )
    for t_ns in range(5_200 * MS, 9_000 * MS, 50 * MS):
        assert {stands.gait_phase_in_stance(leg, t_ns) for leg in LEGS} == {0.3}
