"""Feet of another physics through the whole chain: calibrated, read under leaning loads, refused where necessary."""

from dataclasses import replace

import numpy as np
import pytest

from footsense.foot.directions import normalized, random_directions
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.specimen import ContactLoads
from footsense.sim.fabrication import PAPER_TOLERANCES
from footsense.sim.loads.press_sequence import paper_presses
from footsense.validation.mismatch_trial import (
    UNDISTURBED,
    Disturbance,
    TrialPlan,
    run_mismatch_trial,
)
from tests.support.test_stand_loads import design


def _plan() -> TrialPlan:
    """Return a plan with centred and leaning test loads of 60 gf, at which no gap closes."""
    rng = np.random.default_rng(3)
    centred = 0.6 * paper_presses("verification")[::5]
    direction = random_directions(rng, 60, 50.0)
    normal = normalized(direction + np.radians(12.0) * rng.normal(size=direction.shape))
    leaning = ContactLoads(normal, 60.0 * GRAM_FORCE_N * direction)
    tests = {"centred": ContactLoads.centred(centred), "leaning": leaning}
    return TrialPlan(tolerances=PAPER_TOLERANCES, seed=8, every_nth_press=6, test_loads_by_name=tests)


@pytest.mark.parametrize(
    "disturbance", [UNDISTURBED, Disturbance(sheet_rotation_deg=3.0)], ids=["known", "turned"]
)
def test_a_calibrated_foot_reads_leaning_loads(disturbance: Disturbance) -> None:
    """It reads them several times better than the design's network, and says by how much it may err."""
    found = run_mismatch_trial(design(), design().response, disturbance, _plan(), 1)
    assert found["refused_all"] == 0.0
    for test in ("centred", "leaning"):
        assert found[f"{test}_all_deg"] < min(2.0, 0.25 * found[f"{test}_design_deg"])
        assert found[f"{test}_all_gf"] < 3.0
        assert found[f"{test}_all_within_2"] > 0.8


def test_the_rubber_and_the_worn_pole_change_what_is_read() -> None:
    """Each disturbance reaches the readings: none is a row without effect."""
    plan, models = replace(_plan(), every_nth_press=15, n_loads_of_small_calibration=0), design()
    plain = run_mismatch_trial(models, models.response, UNDISTURBED, plan, 2)
    for disturbance in (
        Disturbance(worn_cap_height_mm=0.3),
        Disturbance(creep_factor=3.0),
        Disturbance(hysteresis_factor=3.0),
        Disturbance(max_ground_capacitance_pf=0.2),
        Disturbance(cable_noise_pf=5e-3),
        Disturbance(reference_nonlinearity_rel=0.015),
        Disturbance(has_fringe_field=True),
    ):
        other = run_mismatch_trial(models, models.response, disturbance, plan, 2)
        assert abs(other["centred_all_deg"] - plain["centred_all_deg"]) > 1e-3
