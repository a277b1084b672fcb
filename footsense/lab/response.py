"""From the sampled adjoint fields to the table that the simulator loads.

Three steps, each with its error stated in the table's provenance:

1. G0: the samples are fitted by a series (area-weighted least squares), which also averages the mesh's noise.
2. Symmetry: the sheet is square, so the eight copies of the series under the group D4 are averaged. How far
   they differed is the mesh's asymmetry, a measure of its error.
3. G2: the mean of G0 over a Hertz patch of 1 mm by quadrature on the sphere, minus G0, over 1 mm^2. For a Hertz
   pressure the mean of a smooth w is w + (a^2/10) lap w + O(a^4 / R^4), so one radius gives all.
"""

import numpy as np
from numpy.typing import NDArray

from footsense.lab.adjoint import SurfaceField
from footsense.lab.geometry import SoleDesign
from footsense.lab.solid import Solid
from footsense.sim.foot import FootResponse, n_products, series_basis

#: Total degree of the series. Higher ones fit the mesh's noise; see `interpolation_rel` in the provenance.
DEGREE = 16
#: Rim of the fitted disc [deg]: below the lowest contact by more than the largest patch (1.3 mm is 7.5 deg).
FIT_ELEVATION_DEG = 12.0
#: Lowest contact normal that the table answers for [deg].
MIN_ELEVATION_DEG = 25.0
#: Radius of the patch that G2 is got from [mm]: that of 0.9 N.
PATCH_MM = 1.0
#: Decimals that are kept of the coefficients [um/N]: a parallel solve differs from run to run by 1e-9, and two
#: builds are to give the same bytes. What is cut off is below 0.1 nm per newton.
DECIMALS = 6

#: The eight symmetries of the square, each as a 3 x 3 matrix that maps the foot frame onto itself.
SYMMETRIES: tuple[NDArray[np.float64], ...] = tuple(
    np.array(matrix, dtype=np.float64)
    for sx in (1, -1)
    for sy in (1, -1)
    for matrix in ([[sx, 0, 0], [0, sy, 0], [0, 0, 1]], [[0, sx, 0], [sy, 0, 0], [0, 0, 1]])
)


def element_map(symmetry: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return m with: element e of the foot comes to lie on element m[e] when the foot is mapped by `symmetry`."""
    row, column = np.divmod(np.arange(9), 3)
    place = symmetry[:2, :2] @ np.stack([1 - row, 1 - column])
    mapped: NDArray[np.intp] = (3 * (1 - place[0]) + (1 - place[1])).astype(np.intp)
    return mapped


def fit_series(field: SurfaceField, degree: int = DEGREE) -> NDArray[np.float64]:
    """Return the coefficients of G0 [um/N], shape (products, 9, 3), by area-weighted least squares."""
    used = field.normal[:, 2] >= np.sin(np.radians(FIT_ELEVATION_DEG))
    root = np.sqrt(field.weight_mm2[used])[:, None]
    basis = series_basis(field.normal[used], degree, FIT_ELEVATION_DEG) * root
    values = field.influence[used].reshape(-1, 27) * root
    coefficients: NDArray[np.float64] = np.linalg.lstsq(basis, values, rcond=1e-10)[0]
    return coefficients.reshape(-1, 9, 3)


def symmetrise(coefficients: NDArray[np.float64], degree: int = DEGREE) -> NDArray[np.float64]:
    """Return a series averaged over the square's symmetries.

    For a symmetry g: w_{g e}(g n) = g w_e(n). On the disc g acts on (X, Y), so it permutes the products and
    changes their signs.

    Args:
        coefficients: Series of one field, shape (products, 9, 3).
        degree: Its degree.

    Returns:
        The average of the eight copies, same shape.
    """
    square = np.zeros((degree + 1, degree + 1, 9, 3))
    i, j = np.indices((degree + 1, degree + 1))
    kept = i + j <= degree
    square[kept] = coefficients
    copies = []
    for g in SYMMETRIES:
        swaps = g[0, 0] == 0.0
        signs = g[:2, :2].sum(axis=0)  # sign of X and of Y under g
        turned = square * (signs[0] ** i * signs[1] ** j)[..., None, None]
        turned = turned.transpose(1, 0, 2, 3) if swaps else turned
        copy = np.empty_like(turned)
        copy[:, :, element_map(g)] = turned @ g.T
        copies.append(copy[kept])
    average: NDArray[np.float64] = np.mean(copies, axis=0)
    return average


def patch_mean(
    point_series: NDArray[np.float64], normal: NDArray[np.float64], radius_mm: float, sole: SoleDesign
) -> NDArray[np.float64]:
    """Return the mean of the point response over a Hertz patch, p ~ sqrt(1 - r^2/a^2), on the sphere.

    Args:
        point_series: Coefficients of G0, shape (products, 9, 3).
        normal: Normals at the centre of the patch, shape (n, 3).
        radius_mm: Radius a of the patch [mm].
        sole: The foot, for its radius.

    Returns:
        Responses [um/N], shape (n, 9, 3).
    """
    # With s = sqrt(1 - r^2/a^2) the mean is int_0^1 3 s^2 <w>(s) ds: Gauss in s, equal steps around.
    gauss, weight = np.polynomial.legendre.leggauss(6)
    s, share = (gauss + 1.0) / 2.0, weight / 2.0 * 3.0 * ((gauss + 1.0) / 2.0) ** 2
    turn = 2.0 * np.pi * np.arange(12) / 12.0
    radial = np.sqrt(1.0 - s**2) * radius_mm / sole.ball_radius_mm
    helper = np.where(np.abs(normal[:, :1]) < 0.5, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    first = np.cross(normal, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normal, first)
    mean = np.zeros((len(normal), 9, 3))
    for distance, part in zip(radial, share, strict=True):
        for angle in turn:
            sideways = np.cos(angle) * first + np.sin(angle) * second
            around = np.sqrt(1.0 - distance**2) * normal + distance * sideways
            mean += part / 12.0 * _values(point_series, around)
    return mean


def _degree_of(series: NDArray[np.float64]) -> int:
    """Return the degree whose number of products the series has."""
    return next(degree for degree in range(64) if n_products(degree) == len(series))


def disc_normals(lowest_deg: float, rings: int = 40, spokes: int = 96) -> NDArray[np.float64]:
    """Return unit normals spread over the cap above an elevation [deg], shape (rings * spokes, 3)."""
    elevation = np.radians(90.0 - (90.0 - lowest_deg) * (np.arange(rings) + 0.5) / rings)
    azimuth = 2.0 * np.pi * np.arange(spokes) / spokes
    e, a = (grid.ravel() for grid in np.meshgrid(elevation, azimuth, indexing="ij"))
    return np.column_stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def _values(series: NDArray[np.float64], normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the series [um/N] at unit normals (n, 3), shape (n, 9, 3)."""
    basis = series_basis(normal, _degree_of(series), FIT_ELEVATION_DEG)
    values: NDArray[np.float64] = basis @ series.reshape(-1, 27)
    return values.reshape(-1, 9, 3)


def _rms_rel(difference: NDArray[np.float64], reference: NDArray[np.float64]) -> float:
    """Return the rms of a difference over the rms of what it differs from, to six digits after the point."""
    return round(float(np.sqrt(np.mean(difference**2) / np.mean(reference**2))), 6)


def make_response(solid: Solid, field: SurfaceField) -> FootResponse:
    """Return the response table of a foot, symmetrised, with its errors in the provenance."""
    sole = solid.sole
    raw = fit_series(field)
    point = np.round(symmetrise(raw), DECIMALS) + 0.0  # without -0.0, which would be other bytes
    normal = disc_normals(MIN_ELEVATION_DEG)
    on_disc = _values(point, normal)
    lower = symmetrise(fit_series(field, DEGREE - 4), DEGREE - 4)
    seen = field.normal[:, 2] >= np.sin(np.radians(MIN_ELEVATION_DEG))
    sampled = field.influence[seen]
    basis = series_basis(normal, DEGREE, FIT_ELEVATION_DEG)
    growth = (patch_mean(point, normal, PATCH_MM, sole) - on_disc) / PATCH_MM**2
    patch, *_ = np.linalg.lstsq(basis, growth.reshape(-1, 27), rcond=1e-10)
    return FootResponse(
        foot_type=sole.foot_type,
        design=sole.capacitor,
        ball_radius_mm=sole.ball_radius_mm,
        hertz_modulus_mpa=sole.rubber.hertz_mpa,
        min_elevation_deg=MIN_ELEVATION_DEG,
        fit_elevation_deg=FIT_ELEVATION_DEG,
        degree=DEGREE,
        coefficients=np.stack([point, np.round(patch, DECIMALS).reshape(-1, 9, 3) + 0.0]),
        provenance={
            "mesh_mm": {
                "ball": solid.size.ball_mm,
                "plate": solid.size.plate_mm,
                "surface": solid.size.surface_mm,
                "bar": solid.size.bar_mm,
            },
            "order": solid.size.order,
            "elements": int(solid.mesh.ne),
            "unknowns": solid.n_unknowns,
            "mesh_asymmetry_rel": _rms_rel(_values(raw, normal) - on_disc, on_disc),
            "fit_residual_rel": _rms_rel(_values(point, field.normal[seen]) - sampled, sampled),
            "interpolation_rel": _rms_rel(_values(lower, normal) - on_disc, on_disc),
        },
    )
