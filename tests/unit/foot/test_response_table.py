"""The simulator's foot: a made-up response table, so that every number can be computed by hand."""

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from footsense.errors import ModelError
from footsense.foot.capacitor import Capacitor
from footsense.foot.directions import random_directions
from footsense.foot.response_table import FootResponse, n_basis_functions

DESIGN = Capacitor(gap_um=20.0, film_um=17.0, film_eps_r=2.7, electrode_area_mm2=16.0)
UP = np.array([0.0, 0.0, 1.0])


def made_up(seed: int = 0, degree: int = 4) -> FootResponse:
    """Return a response of random series, and of cells that yield each for itself, 40 um/N."""
    rng, half = np.random.default_rng(seed), 9
    own = np.zeros((half, half, 2 * half, 2 * half))
    row, column = np.indices((half, half))
    own[row, column, row, column] = 40.0
    return FootResponse(
        foot_type="made-up",
        design=DESIGN,
        ball_radius_mm=10.0,
        hertz_modulus_mpa=6.843,
        min_elevation_deg=30.0,
        fit_elevation_deg=12.0,
        degree=degree,
        quarter_series=rng.normal(size=(2, n_basis_functions(degree), half, half, 3)),
        quarter_compliance=own,
        provenance={"made": "up"},
    )


def random_normals(n: int) -> NDArray[np.float64]:
    """Return unit vectors above the elevation of the table."""
    return random_directions(np.random.default_rng(1), n, 30.0)


def test_is_linear_in_the_force_for_a_fixed_patch() -> None:
    """Forces with equal pressing part superpose; the tangential part does not change the patch."""
    foot = made_up()
    normal = random_normals(7)
    sideways = np.cross(normal, [0.3, 1.0, 0.2])
    both = foot.free_element_closures_um(normal, normal + sideways)
    mirrored = foot.free_element_closures_um(normal, normal - sideways)
    np.testing.assert_allclose(
        (both + mirrored) / 2.0, foot.free_element_closures_um(normal, normal), rtol=1e-12
    )


def test_the_patch_grows_as_hertz_says() -> None:
    """a^3 = 3 F R / (4 E*): 1 N on a 10 mm ball of 6.843 MPa is 1.031 mm, and d/F is linear in a^2."""
    foot = made_up()
    assert float(foot.patch_radius_mm(UP, UP)) == pytest.approx((0.75 * 10.0 / 6.843) ** (1 / 3), rel=1e-12)
    per_newton = [foot.free_element_closures_um(UP, UP * force) / force for force in (1.0, 8.0, 27.0)]
    # Patch radii 1 : 2 : 3, so a^2 steps 3 : 5.
    np.testing.assert_allclose((per_newton[1] - per_newton[0]) / 3.0, (per_newton[2] - per_newton[1]) / 5.0)


@pytest.mark.parametrize(
    ("normal", "message"),
    [
        ([0.0, 0.0, 2.0], "length 1"),
        ([0.0, 0.0, float("nan")], "length 1"),
        ([np.cos(np.radians(29)), 0.0, np.sin(np.radians(29))], "30 deg"),
        ([0.0, 0.0, -1.0], "30 deg"),
    ],
)
def test_refuses_what_the_table_does_not_cover(normal: list[float], message: str) -> None:
    """A contact outside the table is an error that names the limit, never an extrapolation."""
    with pytest.raises(ValueError, match=message):
        made_up().free_element_closures_um(np.array(normal), UP)


@pytest.mark.parametrize(
    ("axis", "image"), [(0, [6, 7, 8, 3, 4, 5, 0, 1, 2]), (1, [2, 1, 0, 5, 4, 3, 8, 7, 6])]
)
def test_a_mirrored_load_closes_the_mirrored_gaps(axis: int, image: list[int]) -> None:
    """The quarter tells the rest, whatever the series: rows swap front and rear, columns left and right."""
    foot = made_up()
    normal, force = random_normals(5), np.random.default_rng(3).normal(size=(5, 3))
    mirror = np.ones(3)
    mirror[axis] = -1.0
    mirrored = foot.free_element_closures_um(normal * mirror, force * mirror)
    np.testing.assert_allclose(
        mirrored[:, image], foot.free_element_closures_um(normal, force), rtol=1e-9, atol=1e-12
    )


def test_survives_the_file_and_writes_equal_bytes(tmp_path: Path) -> None:
    """What is saved comes back, and saving twice gives the same hash."""
    foot = made_up()
    foot.save(tmp_path / "a.npz")
    foot.save(tmp_path / "b.npz")
    back = FootResponse.load(tmp_path / "a.npz")
    assert back.sha256 == FootResponse.load(tmp_path / "b.npz").sha256 != ""
    assert (back.design, back.foot_type, back.provenance) == (DESIGN, "made-up", {"made": "up"})
    assert (back.quarter_series == foot.quarter_series).all()
    assert (back.closure_coefficients == foot.closure_coefficients).all()
    assert (back.compliance_um_per_n == foot.compliance_um_per_n).all()


def test_a_file_that_cannot_be_used_is_one_clear_error(tmp_path: Path) -> None:
    """None, another format and another degree are named, and how to get a good one; the fuzz tests damage the rest."""
    path = tmp_path / "response.npz"
    for key, value in (("", 0), ("format", 1), ("degree", 5)):
        if key:
            made_up().save(path)
            with np.load(path) as stored:
                parts = dict(stored)
            about = json.loads(str(parts["description"])) | {key: value}
            np.savez(path, **(parts | {"description": np.array(json.dumps(about))}))
        with pytest.raises(ModelError, match=r"response\.npz.*footsense lab build"):
            FootResponse.load(path)
