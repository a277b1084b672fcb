"""Response table of a foot from sampled adjoint fields.

Four steps, each with its error stated in the table's provenance:

1. G0 of each symmetry class: the samples are fitted by a series (area-weighted least squares) in the products that
   have the class's parity.
2. The classes are added up to the response of single cells, the class that is not solved being a transpose.
3. Symmetry: the quarter's mesh does not know that x and y are alike, so the table and its transpose are averaged. How
   far they differed is the mesh's asymmetry, a measure of its error.
4. G2: the mean of G0 over a Hertz patch by quadrature on the sphere, minus G0, over 1 mm^2. For a Hertz
   pressure the mean of a smooth w is w + (a^2/10) lap w + O(a^4 / R^4), so one radius gives all.
"""

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import msgspec
import numpy as np

from footsense.foot.directions import tangent_frame
from footsense.foot.response_table import FootResponse, n_basis_functions, product_powers, series_basis
from footsense.frames import Vector
from footsense.lab.fem.adjoint import AdjointFields, solve_cell_closure_fields
from footsense.lab.fem.elasticity import BondedLayer
from footsense.lab.fem.mesh import MeshSize, build_mesh, quarter_grid
from footsense.lab.fem.quarter import (
    SOLVED_CLASSES,
    Parity,
    QuarterFoot,
    single_cell_series,
    transposed_series,
    whole_foot_compliance,
)
from footsense.lab.geometry import MIN_FITTED_ELEVATION_DEG, MIN_TABLE_ELEVATION_DEG, FootDesign

#: Total degree of the series. Higher ones fit the mesh's noise; see `interpolation_rel` in the provenance.
SERIES_DEGREE = 12
#: Radius of the patch that G2 is got from, over the ball's [1]: that of 0.9 N on the shipped foot.
FITTED_PATCH_RADIUS_REL = 0.1
#: Decimals that are kept of the table [um/N]: a parallel solve differs from run to run by 1e-9, and two builds are to
#: give the same bytes. What is cut off is below 0.1 nm per newton.
STORED_DECIMALS = 6


def fit_series(field: AdjointFields, degree: int = SERIES_DEGREE) -> Vector:
    """Return the series of an adjoint field [um/N], shape (products, cells of a quarter, 3), by least squares.

    Args:
        field: Samples on the quarter.
        degree: Degree of the series.
    """
    i, j = product_powers(degree)
    used = field.normal[:, 2] >= np.sin(np.radians(MIN_FITTED_ELEVATION_DEG))
    root = np.sqrt(field.weight_mm2[used])[:, None]
    basis = series_basis(field.normal[used], degree, MIN_FITTED_ELEVATION_DEG) * root
    series = np.zeros((n_basis_functions(degree), field.influence_um_per_n.shape[1], 3))
    for component in range(3):
        sign_x, sign_y = field.parity.mirror_image_signs(component)
        has_parity = (sign_x * (-1) ** i >= 0) & (sign_y * (-1) ** j >= 0)
        values = field.influence_um_per_n[used, :, component] * root
        series[has_parity, :, component] = np.linalg.lstsq(basis[:, has_parity], values, rcond=1e-10)[0]
    return series


def mean_over_patch(
    point_series: Vector, normal: Vector, radius_mm: float, foot_design: FootDesign
) -> Vector:
    """Return the point response averaged over Hertz pressure patches on the ball, p ~ sqrt(1 - r^2/a^2).

    Args:
        point_series: Coefficients of G0 of degree `SERIES_DEGREE`, shape (products, m).
        normal: Normals at the centre of the patch, shape (n, 3).
        radius_mm: Radius a of the patch [mm].
        foot_design: The foot, for its radius.

    Returns:
        Responses [um/N], shape (n, m).
    """
    # With s = sqrt(1 - r^2/a^2) the mean is int_0^1 3 s^2 <w>(s) ds: Gauss in s, equal steps around.
    gauss, weight = np.polynomial.legendre.leggauss(6)
    s, share = (gauss + 1.0) / 2.0, weight / 2.0 * 3.0 * ((gauss + 1.0) / 2.0) ** 2
    turn = 2.0 * np.pi * np.arange(12) / 12.0
    radial = np.sqrt(1.0 - s**2) * radius_mm / foot_design.ball_radius_mm
    first, second = tangent_frame(normal)
    basis = np.zeros((len(normal), len(point_series)))
    for distance, part in zip(radial, share, strict=True):
        for angle in turn:
            sideways = np.cos(angle) * first + np.sin(angle) * second
            around = np.sqrt(1.0 - distance**2) * normal + distance * sideways
            basis += part / 12.0 * series_basis(around, SERIES_DEGREE, MIN_FITTED_ELEVATION_DEG)
    return basis @ point_series


def patch_series(point: Vector, foot_design: FootDesign) -> Vector:
    """Return the series G2 of the contact patch [um/N per mm2] that belongs to a series G0, in its shape."""
    normal = spherical_cap_normals(MIN_TABLE_ELEVATION_DEG)
    basis = series_basis(normal, SERIES_DEGREE, MIN_FITTED_ELEVATION_DEG)
    flat, radius_mm = point.reshape(len(point), -1), FITTED_PATCH_RADIUS_REL * foot_design.ball_radius_mm
    growth = (mean_over_patch(flat, normal, radius_mm, foot_design) - basis @ flat) / radius_mm**2
    series = np.asarray(np.linalg.lstsq(basis, growth, rcond=1e-10)[0], np.float64)
    return series.reshape(point.shape)


def spherical_cap_normals(lowest_deg: float, rings: int = 40, spokes: int = 96) -> Vector:
    """Return unit normals spread over the ball above a given elevation [deg], shape (rings * spokes, 3)."""
    elevation = np.radians(90.0 - (90.0 - lowest_deg) * (np.arange(rings) + 0.5) / rings)
    azimuth = 2.0 * np.pi * np.arange(spokes) / spokes
    e, a = (grid.ravel() for grid in np.meshgrid(elevation, azimuth, indexing="ij"))
    return np.column_stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def _relative_rms(difference: Vector, reference: Vector) -> float:
    """Return rms(difference) / rms(reference) [1], rounded to six decimals."""
    return round(float(np.sqrt(np.mean(difference**2) / np.mean(reference**2))), 6)


def _round_to_stored(table: Any) -> Vector:
    """Return values rounded to the stored decimals, without negative zeros (reproducible bytes)."""
    kept: Vector = np.round(table, STORED_DECIMALS) + 0.0
    return kept


def make_response(
    foot_design: FootDesign,
    size: MeshSize,
    report: Callable[[str], None] = lambda _: None,
    layer: BondedLayer | None = None,
) -> FootResponse:
    """Return the response table of a foot after solving it, with the fit errors in its provenance.

    Args:
        foot_design: The foot.
        size: Resolution of the mesh.
        report: Receives a line after each class.
        layer: Joins the plates; the spacer's bars if None.

    Raises:
        ModelError: The foot cannot be meshed, or its stiffness is singular.
    """
    mesh = build_mesh(foot_design, size)
    fields = {}
    for parity in SOLVED_CLASSES:
        quarter = QuarterFoot(foot_design, size, parity, mesh, layer)
        fields[parity] = solve_cell_closure_fields(quarter)
        report(
            f"class {parity.x:+d} {parity.y:+d}: {mesh.ne} elements, {quarter.n_unknowns} unknowns, "
            f"{fields[parity].compliance_um_per_n.shape[0]} solves"
        )
    return tabulate_response(
        foot_design, size, fields, {"elements": int(mesh.ne), "unknowns": quarter.n_unknowns}
    )


def tabulate_response(
    foot_design: FootDesign, size: MeshSize, fields: dict[Parity, AdjointFields], counts: dict[str, int]
) -> FootResponse:
    """Return the response table from sampled adjoint fields.

    Args:
        foot_design: The foot.
        size: Mesh of the fields.
        fields: The fields of the solved classes.
        counts: Elements and unknowns, for the provenance.
    """

    def table_of_degree(degree: int) -> Vector:
        """Return the series of all cells by a polynomial degree."""
        return single_cell_series(
            {p: quarter_grid(fit_series(f, degree), foot_design, 1) for p, f in fields.items()}, degree
        )

    raw = table_of_degree(SERIES_DEGREE)
    point = _round_to_stored((raw + transposed_series(raw, SERIES_DEGREE)) / 2.0)
    lower = table_of_degree(SERIES_DEGREE - 4)
    compliance = whole_foot_compliance(
        {
            p: quarter_grid(quarter_grid(f.compliance_um_per_n, foot_design, 0), foot_design, 2)
            for p, f in fields.items()
        }
    )
    compliance = (compliance + compliance.transpose(1, 0, 3, 2)) / 2.0
    normal = spherical_cap_normals(MIN_TABLE_ELEVATION_DEG)
    basis = series_basis(normal, SERIES_DEGREE, MIN_FITTED_ELEVATION_DEG)
    on_disc = basis @ point.reshape(len(point), -1)
    patch = patch_series(point, foot_design)
    shorter = series_basis(normal, SERIES_DEGREE - 4, MIN_FITTED_ELEVATION_DEG) @ lower.reshape(
        len(lower), -1
    )
    return FootResponse(
        foot_type=foot_design.foot_type,
        design=foot_design.capacitor,
        ball_radius_mm=foot_design.ball_radius_mm,
        hertz_modulus_mpa=foot_design.rubber.plane_strain_modulus_mpa,
        min_elevation_deg=MIN_TABLE_ELEVATION_DEG,
        fit_elevation_deg=MIN_FITTED_ELEVATION_DEG,
        degree=SERIES_DEGREE,
        quarter_series=np.stack([point, _round_to_stored(patch)]),
        quarter_compliance=_round_to_stored(compliance),
        provenance={
            "mesh": asdict(size),
            **film_provenance(foot_design),
            **counts,
            "mesh_asymmetry_rel": _relative_rms(basis @ raw.reshape(len(raw), -1) - on_disc, on_disc),
            "fit_residual_rel": max(_series_residual_rel(field) for field in fields.values()),
            "interpolation_rel": _relative_rms(shorter - on_disc, on_disc),
        },
    )


def film_provenance(foot_design: FootDesign) -> dict[str, dict[str, float]]:
    """Return the thin films that stiffen the plates, by name, for a response table's provenance."""
    films = {"gold": foot_design.gold, "parylene": foot_design.parylene}
    return {name: msgspec.structs.asdict(film) for name, film in films.items() if film is not None}


def _series_residual_rel(field: AdjointFields) -> float:
    """Return the relative rms error [1] of a symmetry class's series against the sampled influence."""
    seen = field.normal[:, 2] >= np.sin(np.radians(MIN_TABLE_ELEVATION_DEG))
    series = fit_series(field)
    basis = series_basis(field.normal[seen], SERIES_DEGREE, MIN_FITTED_ELEVATION_DEG)
    sampled = field.influence_um_per_n[seen]
    return _relative_rms(np.tensordot(basis, series, 1) - sampled, sampled)
