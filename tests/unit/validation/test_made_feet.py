"""Made feet: pressed, calibrated, read under leaning loads; refused where the calibration cannot know them."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from footsense.calibration.recorded_session import read_session
from footsense.foot.directions import normalized, random_directions
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import ContactLoads, Deviations, Specimen
from footsense.sim.fabrication import (
    MIN_DRAWN_OVER_DESIGN,
    PAPER_TOLERANCES,
    FootTolerances,
    draw_deviations,
)
from footsense.sim.loads.press_sequence import paper_presses
from footsense.validation.made_feet import (
    EXACT_CONDITIONS,
    SEED,
    MadeFootPlan,
    PressConditions,
    PressedFoot,
    evaluate_made_foot,
)
from tests.support.test_stand_loads import design
from tests.system.simulated_test_stand import MADE, presses, record


def _plan() -> MadeFootPlan:
    """Return a plan with centred and leaning test loads of 60 gf, at which no gap closes."""
    rng = np.random.default_rng(3)
    centred = 0.6 * paper_presses("verification")[::5]
    direction = random_directions(rng, 60, 50.0)
    normal = normalized(direction + np.radians(12.0) * rng.normal(size=direction.shape))
    leaning = ContactLoads(normal, 60.0 * GRAM_FORCE_N * direction)
    upright = random_directions(rng, 15, 70.0)
    postures = ContactLoads.centred(np.linspace(0.2, 1.0, 15)[:, None] * upright)
    return MadeFootPlan(6, {"centred": ContactLoads.centred(centred), "leaning": leaning}, postures)


@pytest.fixture(scope="module")
def made_foot() -> dict[str, Any]:
    return evaluate_made_foot(design(), design().response, PressConditions(), _plan(), 1)


def test_a_calibrated_foot_reads_leaning_loads(made_foot: dict[str, Any]) -> None:
    """It reads them several times better than the design's network, and says by how much it may err."""
    assert not made_foot["calibrations"]["all"]["refused"]
    for errors in made_foot["errors"].values():
        assert errors["all"]["true_deg"] < min(2.0, 0.25 * errors["design"]["true_deg"])
        assert errors["all"]["true_gf"] < 3.0
        assert errors["all"]["within_2_sigma"] > 0.8


def test_a_foot_that_stood_reads_loads_but_for_its_mount(made_foot: dict[str, Any]) -> None:
    """Nobody measured a force; 3 deg rms of mount stay, and the stiffness does."""
    assert not made_foot["calibrations"]["standing"]["refused"]
    for errors in made_foot["errors"].values():
        assert errors["standing"]["true_deg"] < min(6.0, 0.4 * errors["design"]["true_deg"])


def test_a_careless_test_stand_is_refused() -> None:
    stand = PressConditions(force_noise_steps=1.1, lean_rms_deg=2.15)
    found = evaluate_made_foot(design(), design().response, stand, _plan()._replace(tests={}), 1)
    assert found["calibrations"]["all"]["refused"]
    assert not found["calibrations"]["all"]["warned"]


def test_loads_beyond_the_range_of_the_converter_have_no_force() -> None:
    """Of a foot with 9 pF beside each element, which add to what its gaps read."""

    def foot(truth: FootResponse, own: Deviations) -> Specimen:
        return Specimen(truth, replace(own, stray_pf=own.stray_pf + 9.0))

    light = ContactLoads.centred(0.6 * paper_presses("verification")[::12])
    plan = MadeFootPlan(20, {"light": light}, _plan().standing)
    errors = evaluate_made_foot(design(), design().response, PressConditions(), plan, 1, foot)["errors"][
        "light"
    ]
    assert {name: found["no_force"] for name, found in errors.items()} == dict.fromkeys(errors, 0.8667)


@pytest.mark.slow
@pytest.mark.parametrize(
    "conditions",
    [
        PressConditions(creep_factor=3.0),
        PressConditions(play_factor=3.0),
        PressConditions(max_floor_capacitance_pf=0.2),
        PressConditions(repeatability_rel=0.02),
        PressConditions(reference_nonlinearity_rel=0.0),
    ],
)
def test_each_condition_reaches_the_readings(conditions: PressConditions) -> None:
    plan, models = _plan()._replace(every_nth_press=15), design()
    plain, other = (
        evaluate_made_foot(models, models.response, one, plan, 2) for one in (PressConditions(), conditions)
    )
    errors, plain_errors = (found["errors"]["centred"]["all"] for found in (other, plain))
    assert abs(errors["true_deg"] - plain_errors["true_deg"]) > 1e-3


def test_an_exact_stand_reads_the_foot_itself() -> None:
    response = design().response
    own = draw_deviations(response, PAPER_TOLERANCES, SEED, 0)
    force_n = paper_presses("verification")[::20]
    foot = Specimen(response, own)
    pressed = PressedFoot(foot, own.mount, EXACT_CONDITIONS, np.random.default_rng(0))
    read = pressed.press_with_stick(force_n)
    np.testing.assert_allclose(read.force_n, force_n, atol=1e-12)
    np.testing.assert_allclose(read.capacitance_pf, foot.capacitance_pf(normalized(force_n), force_n))
    np.testing.assert_allclose(read.baseline_pf, np.tile(foot.unloaded_pf, (len(force_n), 1)))


@pytest.mark.slow
def test_a_press_through_chips_bus_and_recording_reads_the_same(tmp_path: Path) -> None:
    """What the shortcut leaves out changes a reading by less than a hundredth."""
    response = design().response
    own = draw_deviations(response, MADE.tolerances, MADE.seed, MADE.first)
    session = read_session(record(tmp_path / "session.mcap"), "foot-0007")
    foot = PressedFoot(
        Specimen(response, own, contact=False), own.mount, EXACT_CONDITIONS, np.random.default_rng(0)
    )
    read = foot.press_with_stick(np.array(presses(24)))
    recorded = session.loads
    change_pf, recorded_pf = (one.capacitance_pf - one.baseline_pf for one in (read, recorded))
    matches = np.linalg.norm(read.force_n[None] - recorded.force_n[:, None], axis=2).argmin(axis=1)
    assert len(set(matches.tolist())) == len(recorded) > 15
    off_pf = np.abs(recorded_pf - change_pf[matches])
    assert np.median(off_pf) < 0.01 * np.median(recorded_pf)


def test_each_foot_is_reproducible_by_itself() -> None:
    """By number and seed; at twice the tolerance twice the deviation, whatever else is inexact."""
    response = design().response
    once = draw_deviations(response, FootTolerances(gap_um=0.5), 7, 3)
    mixed = draw_deviations(response, FootTolerances(gap_um=1.0, mount_deg=3.0, film_um=1.0), 7, 3)
    np.testing.assert_allclose(mixed.gap_um, 2.0 * once.gap_um, rtol=1e-12)
    np.testing.assert_allclose(mixed.mount @ mixed.mount.T, np.eye(3), atol=1e-12)
    for seed, number in ((7, 4), (8, 3)):
        other = draw_deviations(response, FootTolerances(gap_um=0.5), seed, number)
        assert not np.allclose(once.gap_um, other.gap_um)


def test_feet_have_the_stated_distribution() -> None:
    """The rms values over many feet; what cannot be made is drawn again."""
    response = design().response
    tolerances = FootTolerances(gap_um=2.0, stray_pf=0.1, stiffness_rel=0.1, mount_deg=2.0)
    feet = [draw_deviations(response, tolerances, 1, foot) for foot in range(400)]
    rms = [float(np.sqrt(np.mean(np.square([getattr(f, k) for f in feet])))) for k in ("gap_um", "stray_pf")]
    np.testing.assert_allclose(rms, [2.0, 0.1], rtol=0.05)
    turned_deg = np.degrees(np.arccos([(np.trace(f.mount) - 1.0) / 2.0 for f in feet]))
    np.testing.assert_allclose(np.sqrt(np.mean(turned_deg**2)), 2.0, rtol=0.05)
    wide = FootTolerances(gap_um=20.0, mount_deg=20.0)
    wild = [draw_deviations(response, wide, 1, foot) for foot in range(20)]
    assert min(f.gap_um.min() for f in wild) >= (MIN_DRAWN_OVER_DESIGN - 1.0) * response.design.gap_um
    assert min(f.mount[2, 2] for f in wild) >= np.cos(np.radians(15.0))
