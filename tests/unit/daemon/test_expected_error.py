"""What error is expected of a foot is what made feet have, and what a calibration leaves."""

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from footsense.config import DEFAULT
from footsense.daemon.models import load_models
from footsense.daemon.setup.expected_error import (
    ExpectedError,
)
from footsense.estimation.network import Network, steady_windows
from footsense.foot.calibration_files import FootCalibration, Manifest
from footsense.foot.directions import angles_between_deg, normalized
from footsense.foot.network_card import NETWORK_FILE
from footsense.foot.parameters import FootParameters
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Deviations, Specimen
from footsense.foot.type_folders import released_folder, released_names
from footsense.frames import Vector
from footsense.sim.fabrication import PAPER_TOLERANCES, SESSION_GAIN_REL, draw_deviations, with_session_gains
from footsense.sim.uncalibrated import uncertainty_by_wear, uncertainty_of_uncalibrated

N_FEET = 20
MADE = "2026-01-01T00:00:00Z"
LEANING = normalized(
    np.array([[0.0, 0.0, 1.0], [0.4, 0.0, 1.0], [0.0, 0.4, 1.0], [-0.3, -0.3, 1.0], [0.2, -0.1, 1.0]])
)


def errors_of(
    network: Network, response: FootResponse, feet: Iterable[Deviations], normals: Vector
) -> tuple[list[float], list[float]]:
    """Return each foot's mean errors of direction [deg] and size [1], under a quarter of the largest force."""
    design, force_n = response.design, 0.25 * network.card.max_trained_force_n * LEANING
    angles_deg, sizes_rel = [], []
    for deviations in feet:
        foot = Specimen(response, deviations)
        pressed_pf = foot.capacitance_pf(normals, force_n)
        free_um, pressed_um = map(design.plate_distance_um, (foot.unloaded_pf, pressed_pf))
        found_n = network.estimate(steady_windows((free_um - pressed_um) / design.gap_um)).force_n
        angles_deg.append(float(angles_between_deg(force_n, found_n).mean()))
        off_rel = np.linalg.norm(found_n, axis=1) / np.linalg.norm(force_n, axis=1) - 1.0
        sizes_rel.append(float(np.abs(off_rel).mean()))
    return angles_deg, sizes_rel


@pytest.mark.parametrize("name", released_names())
def test_a_foot_is_expected_to_err_as_made_and_worn_feet_do(name: str) -> None:
    """Made: those of seed 0 and the first numbers. Worn: known feet in another session, on ground that leans less."""
    folder = released_folder(name)
    response = FootResponse.load(folder / "response.npz")
    network = Network(folder / NETWORK_FILE, len(LEANING))
    made = [draw_deviations(response, PAPER_TOLERANCES, 0, number) for number in range(N_FEET)]
    worn = [with_session_gains(Deviations(), SESSION_GAIN_REL, 0, number, 1) for number in range(N_FEET)]
    of_made = uncertainty_of_uncalibrated(network, response, len(LEANING))
    of_worn = uncertainty_by_wear(network, response, len(LEANING))
    on_ground = normalized(LEANING + LEANING[0])
    for uncertainty, feet, normals in ((of_made, made, LEANING), (of_worn, worn, on_ground)):
        angles_deg, sizes_rel = errors_of(network, response, feet, normals)
        expected = ExpectedError.of(uncertainty)
        assert expected.direction_deg == pytest.approx(np.mean(angles_deg), rel=0.3)
        assert expected.size_rel == pytest.approx(np.mean(sizes_rel), rel=0.3)
        assert max(angles_deg) < 2.5 * expected.direction_deg


def calibration(error_rel: float, *, by_standing: bool, stiffness_rel: float = 0.0) -> FootCalibration:
    pf = np.full(9, 5.0)
    parameters = FootParameters(
        stray_pf=0.0 * pf,
        unloaded_pf=pf,
        gap_um=20.0 * pf,
        stiffness_rel=stiffness_rel,
        error_rel=error_rel,
    )
    manifest = Manifest(
        foot="foot-0007",
        foot_type="aoyagi-3x3",
        footsense="0",
        made=MADE,
        n_loads=40,
        n_sessions=1,
        held_out=None,
        recordings={"a.mcap": "0" * 64},
        by_standing=by_standing,
    )
    return FootCalibration(
        folder=Path(),
        manifest=manifest,
        parameters=parameters,
        network=Path(),
        network_sha256="",
        calibrated_at_c=math.nan,
    )


def test_a_calibration_leaves_its_error_and_standing_what_it_does_not_tell() -> None:
    models = load_models(DEFAULT)
    of_feet = [
        calibration(0.02, by_standing=False),
        calibration(0.02, by_standing=True),
        calibration(0.02, by_standing=True, stiffness_rel=0.1),
    ]
    models = replace(models, calibrations_by_leg=dict(zip(DEFAULT.legs, of_feet, strict=False)), at=MADE)
    pressed, stood, both, *others = map(ExpectedError.of, models.uncertainties)
    assert pressed.size_rel == pytest.approx(0.016, abs=1e-3)
    assert pressed.direction_deg == pytest.approx(1.44, abs=0.01)
    assert stood.size_rel == pytest.approx(0.8 * PAPER_TOLERANCES.stiffness_rel, rel=0.02)
    assert both.size_rel == pressed.size_rel
    assert both.direction_deg == stood.direction_deg > PAPER_TOLERANCES.mount_deg / math.sqrt(3.0)
    assert all(other.direction_deg > 4 * stood.direction_deg for other in others)


def test_what_a_calibration_knows_wears_off_within_days() -> None:
    """An hour costs a fifth of what another session does; a clock that is behind the calibration costs all of it."""
    found = calibration(0.0, by_standing=False)
    models = replace(load_models(DEFAULT), calibrations_by_leg=dict.fromkeys(DEFAULT.legs, found))

    def across_rel(at: str) -> float:
        return replace(models, at=at).uncertainties[0].across_rel

    worn = uncertainty_by_wear(models.network, models.response, len(DEFAULT.legs)).across_rel
    assert math.degrees(worn) > 3.0
    assert across_rel(MADE) == 0.0
    for an_hour in ("2026-01-01T01:00:00Z", "2025-12-31T23:00:01Z"):
        assert across_rel(an_hour) == pytest.approx(0.2 * worn, rel=0.05)
    assert across_rel("2026-01-02T00:00:00Z") == pytest.approx(0.8 * worn, rel=0.05)
    for far in ("2026-02-01T00:00:00Z", "2025-12-31T22:59:00Z", "1970-01-01T00:00:00Z"):
        assert across_rel(far) == pytest.approx(worn)
