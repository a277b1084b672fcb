"""A foot whose gait cycle is computed once, and a walk that stands."""

import numpy as np
import pytest

from footsense.daemon.foot_types import released_path
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Foot
from footsense.frames import LEGS
from footsense.sim.loads.gait_table import GaitTable
from footsense.sim.scene_loads import Standstill, Tripod

WALK = Tripod(period_s=1.2, duty_rel=0.6, peak_force_n=0.9, friction_rel=0.15, pitch_deg=10.0)
MS = 1_000_000


@pytest.mark.parametrize("relative_compliance", [1.0, 0.9983, 0.9277])
def test_the_table_is_the_foot(relative_compliance: float) -> None:
    """Less than a twentieth of a converter's noise, all over the stance and at a temperature between two tables."""
    foot, walk = Foot(FootResponse.load(released_path("response.npz"))), WALK.build(0)
    table = GaitTable(foot, walk, "lf", (1.0, 0.92))
    phases = np.random.default_rng(1).uniform(0.0, 0.6, 300)
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
