"""The plain block, the soft film and two contacts against statics and symmetry."""

from dataclasses import replace
from itertools import pairwise

import ngsolve as ng
import numpy as np
import pytest

from footsense.foot.response_table import series_basis
from footsense.lab.evaluation.film_against_gaps import FILM_FACES
from footsense.lab.evaluation.off_centre import leaning_normals_to_a_side
from footsense.lab.fem.elasticity import BondedLayer
from footsense.lab.fem.mesh import COARSE_MESH, build_mesh
from footsense.lab.fem.paper_sensors import (
    COARSE_BLOCK_MESH,
    PAPER_SENSOR_ARRAYS,
    SensorArray,
    pressure_patterns,
    stress_series,
)
from footsense.lab.fem.quarter import Parity, QuarterFoot
from footsense.lab.geometry import MIN_FITTED_ELEVATION_DEG, Material
from footsense.lab.response import SERIES_DEGREE
from tests.lab.released import FOOT_DESIGN

pytestmark = [pytest.mark.lab, pytest.mark.slow]

FILM_SIZE = replace(COARSE_MESH, edge_layers=0)


def test_a_cut_through_the_block_carries_the_whole_load() -> None:
    """Elements that cover all of the block feel -f_z together, and a pattern turns with its load."""
    tiles = SensorArray("tiles", 3, FOOT_DESIGN.sheet_mm / 3.0, FOOT_DESIGN.sheet_mm / 3.0)
    series = stress_series(FOOT_DESIGN, [tiles], COARSE_BLOCK_MESH)["tiles"]
    normal = np.array([[0.3, 0.2, np.sqrt(0.87)], [0.0, 0.0, 1.0]])
    per_force = np.tensordot(series_basis(normal, SERIES_DEGREE, MIN_FITTED_ELEVATION_DEG), series, 1).sum(
        axis=(1, 2)
    )
    np.testing.assert_allclose(per_force * tiles.element_side_mm**2, [[0.0, 0.0, -1.0]] * 2, atol=1e-3)
    there, turned = pressure_patterns(
        FOOT_DESIGN, series, np.array([[0.3, 0.2, np.sqrt(0.87)], [-0.2, 0.3, np.sqrt(0.87)]])
    )
    quarter_turn = np.rot90(there.reshape(3, 3))
    np.testing.assert_allclose(turned.reshape(3, 3), quarter_turn, atol=1e-9)


def test_elements_lie_on_the_block() -> None:
    """No element reaches over the edge, or over its neighbour."""
    for sensor in PAPER_SENSOR_ARRAYS:
        halves = sensor.half_axis_element_borders_mm()
        assert halves[0][1] <= FOOT_DESIGN.sheet_mm / 2.0 + 1e-12
        assert all(inner[1] < outer[0] for outer, inner in pairwise(halves))


@pytest.mark.parametrize("poisson", [0.49, 0.4999])
def test_a_film_150_times_softer_than_its_plates_solves(poisson: float) -> None:
    """Finite, symmetric, in balance: what the film carries is a quarter's share of a load of one newton.

    Nor does it lock: under rigid plates it would close by t f / (M A). That they bend may change it by a tenth, and
    where it is hardly compressible its rim, from which it flows, by more.
    """
    film = BondedLayer(Material(0.020, poisson), FOOT_DESIGN.spacer_mm, FILM_FACES)
    mesh = build_mesh(FOOT_DESIGN, FILM_SIZE)
    quarter = QuarterFoot(FOOT_DESIGN, FILM_SIZE, Parity(1, 1), mesh, film)
    area_mm2 = ng.Integrate(ng.CF(1.0) * ng.ds("curved_ground"), quarter.mesh)
    load = quarter.traction_load(ng.CF((0.0, 0.0, 0.25 / area_mm2)))
    moved = quarter.solve(load)
    ground, leg, *_ = moved.components
    carried_n = ng.Integrate(film.traction(ground - leg)[2] * ng.ds(film.face_pattern), quarter.mesh)
    assert carried_n == pytest.approx(0.25, rel=1e-6)
    assert quarter.residual_rel(load, moved) < 1e-8
    electrodes = ng.ds("cell.*")
    closure_mm = ng.Integrate((ground[2] - leg[2]) * electrodes, mesh) / ng.Integrate(
        ng.CF(1.0) * electrodes, mesh
    )
    rigid_mm = film.thickness_mm / (film.material.confined_modulus_mpa * FOOT_DESIGN.sheet_mm**2)
    assert closure_mm == pytest.approx(rigid_mm, rel=0.1) if poisson < 0.499 else closure_mm > rigid_mm
    functionals = [quarter.closure_functional(name, 1.0) for name in ("cell0", "cell40")]
    first, second = (quarter.solve(functional) for functional in functionals)
    crossed = functionals[1].vec.InnerProduct(first.vec), functionals[0].vec.InnerProduct(second.vec)
    assert np.isfinite(crossed).all()
    assert crossed[0] == pytest.approx(crossed[1], rel=1e-6)


def test_a_lean_is_the_angle_that_was_asked_for() -> None:
    """Unit normals at the lean from the force, on four sides that balance."""
    force = np.array([[0.3, -0.2, 0.9]])
    normals = np.concatenate(
        [leaning_normals_to_a_side(force, 20.0, turn) for turn in (0.0, 90.0, 180.0, 270.0)]
    )
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    along = force[0] / np.linalg.norm(force)
    np.testing.assert_allclose(normals @ along, np.cos(np.radians(20.0)))
    np.testing.assert_allclose(normals.sum(axis=0), 4.0 * np.cos(np.radians(20.0)) * along)
