"""Response table of a foot type: gap closures under a contact force, as fitted to the finite-element model.

The solid is linear, so the closure of cell c under a force f whose contact lies at -R n is, as long as no gap closes,

    d_c = (G0_c(n) + a^2 G2_c(n)) . f,        a^3 = 3 |f . n| R / (4 E*)   (Hertz, rigid floor)

G0 is the response to a point force, and a^2 G2 the effect of the contact patch of radius a. Both come from the adjoint
solves of `footsense lab build`, as series in products of Chebyshev polynomials of the stereographic coordinates of n:
smooth over the pole, and evaluated without a search. Closed gaps are solved in `gap_contact.py`, with the compliance B
of the same solves. Cells of one quarter are stored, the others are their mirror images.
"""

import hashlib
import io
import json
import math
import zipfile
from dataclasses import asdict, dataclass, field
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from footsense.errors import ModelError
from footsense.foot.capacitor import Capacitor
from footsense.foot.directions import UNIT_LENGTH_TOLERANCE
from footsense.foot.gap_contact import CELLS_PER_SIDE, N_CELLS, element_means
from footsense.frames import ROWS, Vector
from footsense.regular_file import MAX_FILE_BYTES, read_regular

#: Cells along a side of the grid.
GRID_SIDE = ROWS * CELLS_PER_SIDE
#: Flat index (element by element) of each cell of the grid, shape (18, 18).
FLAT_OF_GRID: NDArray[np.intp] = (
    np.arange(GRID_SIDE**2)
    .reshape(ROWS, ROWS, CELLS_PER_SIDE, CELLS_PER_SIDE)
    .transpose(0, 2, 1, 3)
    .reshape(GRID_SIDE, GRID_SIDE)
)


@cache
def product_powers(degree: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the degrees i and j of every basis function T_i(X) T_j(Y), in the order of the series."""
    i, j = np.indices((degree + 1, degree + 1))
    kept = i + j <= degree
    return i[kept].astype(np.intp), j[kept].astype(np.intp)


def mirrored_series(series: Vector, degree: int, axis: int) -> Vector:
    """Return the series coefficients of the mirror images of some cells.

    For a mirror g: w_{g c}(g n) = g w_c(n). It changes the sign of one coordinate of n and of one component of w.

    Args:
        series: Coefficients, products first, force component last.
        degree: Degree of the series.
        axis: 0 for x -> -x, 1 for y -> -y.

    Returns:
        Coefficients of the images, same shape.
    """
    odd = product_powers(degree)[axis] % 2 == 1
    image = np.where(odd.reshape(-1, *[1] * (series.ndim - 1)), -series, series)
    image[..., axis] *= -1.0
    return image


def whole_series(quarter: Vector, degree: int) -> Vector:
    """Return the series coefficients of all cells, shape (products, 324, 3), from those of one quarter of the foot.

    Args:
        quarter: Coefficients of the cells of the quarter x > 0, y > 0, shape (products, 9, 9, 3), or of all cells of a
            foot that is not symmetric, shape (products, 18, 18, 3).
        degree: Degree of the series.
    """
    flat = np.empty((len(quarter), GRID_SIDE**2, 3))
    if quarter.shape[1] == GRID_SIDE:
        flat[:, FLAT_OF_GRID] = quarter
        return flat
    half = np.concatenate([quarter, mirrored_series(quarter, degree, 0)[:, ::-1]], axis=1)
    whole = np.concatenate([half, mirrored_series(half, degree, 1)[:, :, ::-1]], axis=2)
    flat[:, FLAT_OF_GRID] = whole
    return flat


def whole_compliance(quarter: Vector) -> Vector:
    """Return the compliance matrix of all cells, shape (324, 324), from the rows of one quarter of the foot.

    Args:
        quarter: Closure of every cell of the grid under a force on a cell of the quarter, shape (9, 9, 18, 18), or on
            any cell of a foot that is not symmetric, shape (18, 18, 18, 18).
    """
    whole = quarter
    if len(quarter) != GRID_SIDE:
        half = np.concatenate([quarter, quarter[::-1, :, ::-1]], axis=0)
        whole = np.concatenate([half, half[:, ::-1, :, ::-1]], axis=1)
    order = FLAT_OF_GRID.ravel()
    flat = np.empty((GRID_SIDE**2, GRID_SIDE**2))
    flat[np.ix_(order, order)] = whole.reshape(flat.shape)
    return flat


#: Version of the file's layout.
FORMAT = 2


#: Arrays of the file, by the names of the fields.
_ARRAY_NAMES = ("quarter_series", "quarter_compliance")
#: Other fields of the file, beside the design.
_DESCRIPTION_KEYS = (
    *("foot_type", "ball_radius_mm", "hertz_modulus_mpa", "min_elevation_deg"),
    *("fit_elevation_deg", "degree", "provenance"),
)


def _unpack(content: bytes) -> dict[str, Any]:
    """Return the description and the arrays in the bytes of a response file.

    Raises:
        ValueError: It unpacks to too much, or is of another format.
    """
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        if sum(info.file_size for info in archive.infolist()) > MAX_FILE_BYTES:
            raise ValueError(f"it unpacks to more than {MAX_FILE_BYTES} bytes")
    with np.load(io.BytesIO(content), allow_pickle=False) as stored:
        about = json.loads(str(stored["description"]))
        arrays = {name: np.asarray(stored[name], dtype=np.float64) for name in _ARRAY_NAMES}
    if about.pop("format") != FORMAT:
        raise ValueError(f"it is not of format {FORMAT}")
    return {**about, **arrays}


def contact_radius_mm(
    pressing_n: Vector | float, ball_radius_mm: float, contact_modulus_mpa: float
) -> Vector:
    """Return the radius a of the Hertz contact patch [mm], same shape as the force: a^3 = 3 F R / (4 E*).

    Args:
        pressing_n: Force along the contact normal [N], at least 0.
        ball_radius_mm: Radius R of the ball [mm].
        contact_modulus_mpa: E* = E / (1 - nu^2) of the ball's rubber [MPa].

    Source:
        K. L. Johnson, Contact Mechanics, 1985, equation (4.22).
    """
    radius_mm: Vector = np.cbrt(3.0 / 4.0 * ball_radius_mm / contact_modulus_mpa * pressing_n)
    return radius_mm


def n_basis_functions(degree: int) -> int:
    """Return the number of basis functions T_i T_j with i + j <= degree."""
    return (degree + 1) * (degree + 2) // 2


def series_basis(normal: Vector, degree: int, fit_elevation_deg: float) -> Vector:
    """Return the basis functions T_i(X) T_j(Y), i + j <= degree, of a unit vector's stereographic coordinates.

    (X, Y) = (n_x, n_y) / (1 + n_z), scaled so that the circle of elevation `fit_elevation_deg` has radius 1.

    Args:
        normal: Unit vectors [1], shape (..., 3), none below that circle.
        degree: Total degree of the series.
        fit_elevation_deg: Elevation [deg] of the rim of the disc on which the series was fitted.

    Returns:
        Products, shape (..., (degree + 1)(degree + 2)/2), i the slow index.
    """
    rim = math.radians(fit_elevation_deg)
    scale = (1.0 + math.sin(rim)) / math.cos(rim)
    plane = normal[..., :2] * (scale / (1.0 + normal[..., 2:]))
    order = np.arange(degree + 1.0)
    chebyshev = np.cos(np.arccos(np.minimum(np.maximum(plane, -1.0), 1.0))[..., None] * order)
    i, j = product_powers(degree)
    products: Vector = chebyshev[..., 0, :][..., i] * chebyshev[..., 1, :][..., j]
    return products


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FootResponse:
    """Response of a foot type to a contact force: gap closures without contact, and cell compliance.

    Attributes:
        foot_type: Name of the type, the same as in the network's card.
        design: Dimensions of the capacitors.
        ball_radius_mm: Radius R of the ball [mm].
        hertz_modulus_mpa: E* = E / (1 - nu^2) of the rubber against a rigid floor [MPa].
        min_elevation_deg: Lowest elevation of the contact normal [deg].
        fit_elevation_deg: Elevation of the rim of the disc on which the series was fitted [deg].
        degree: Total degree of the series.
        quarter_series: Series of G0 [um/N] and G2 [um/(N mm2)] of a quarter's cells, shape (2, products, 9, 9, 3); of
            all cells, 18 in place of 9, for a foot that is not symmetric.
        quarter_compliance: Closure of all cells under a force on a cell of the quarter [um/N], shape (9, 9, 18, 18);
            on any cell, (18, 18, 18, 18), for a foot that is not symmetric.
        closure_coefficients: The same for all cells, force component before cell: shape (2, products, 3 * 324).
        compliance_um_per_n: The matrix B of `gap_contact.py`, shape (324, 324).
        provenance: Mesh, order, unknowns and interpolation error, as JSON values.
        sha256: Hash of the file that it was loaded from, empty without one.
    """

    foot_type: str
    design: Capacitor
    ball_radius_mm: float
    hertz_modulus_mpa: float
    min_elevation_deg: float
    fit_elevation_deg: float
    degree: int
    quarter_series: Vector
    quarter_compliance: Vector
    provenance: dict[str, Any]
    sha256: str = ""
    closure_coefficients: Vector = field(init=False)
    compliance_um_per_n: Vector = field(init=False)
    #: The last single contact and its closures per newton: a test stand holds one contact for thousands of scans.
    _last_contact: list[Any] = field(init=False, default_factory=lambda: [b"", None])

    def __post_init__(self) -> None:
        """Check the shapes, and expand the stored quarter to the whole foot by symmetry.

        Raises:
            ValueError: The arrays do not fit the degree, or are not finite.
        """
        half = GRID_SIDE if len(self.quarter_compliance) == GRID_SIDE else GRID_SIDE // 2
        wanted = {
            "quarter_series": (2, n_basis_functions(self.degree), half, half, 3),
            "quarter_compliance": (half, half, GRID_SIDE, GRID_SIDE),
        }
        for name, shape in wanted.items():
            array = getattr(self, name)
            if array.shape != shape or not np.isfinite(array).all():
                raise ValueError(
                    f"{name} of degree {self.degree} is finite, of shape {shape}, got {array.shape}"
                )
        whole = np.stack([whole_series(part, self.degree) for part in self.quarter_series])
        object.__setattr__(
            self, "closure_coefficients", whole.transpose(0, 1, 3, 2).reshape(*whole.shape[:2], -1)
        )
        object.__setattr__(self, "compliance_um_per_n", whole_compliance(self.quarter_compliance))

    @classmethod
    def load(cls, path: Path) -> "FootResponse":
        """Load a response table from a file.

        Args:
            path: File written by `save`.

        Returns:
            The response, with the hash of the file.

        Raises:
            ModelError: The file is missing, cut short, of another format, or its parts do not fit together.
        """
        rebuild = "rebuild it with `footsense lab build`"
        try:
            content = read_regular(path)
        except OSError as error:
            raise ModelError(f"cannot read the foot response {path}: {error.strerror}; {rebuild}") from error
        try:
            return _of_content(content)
        except Exception as error:  # zipfile, numpy and json raise a dozen types without a common base
            raise ModelError(f"{path} is no whole foot response ({error}); {rebuild}") from error

    def save(self, path: Path) -> None:
        """Write the response table to a file, reproducibly: equal content gives equal bytes."""
        about = {"format": FORMAT, "design": asdict(self.design)}
        about |= {name: getattr(self, name) for name in _DESCRIPTION_KEYS}
        text = np.array(json.dumps(about, sort_keys=True))
        with path.open("wb") as stream:
            np.savez(stream, description=text, **{name: getattr(self, name) for name in _ARRAY_NAMES})

    def patch_radius_mm(self, normal: Vector, force_n: Vector) -> Vector:
        """Return the radius of the Hertz contact patch [mm], shape (...), of loads as in `free_element_closures_um`."""
        pressing = np.abs((normal * force_n).sum(axis=-1))
        return contact_radius_mm(pressing, self.ball_radius_mm, self.hertz_modulus_mpa)

    def free_closure_um(self, normal: Vector, force_n: Vector) -> Vector:
        """Return the closure of each cell under a load as if the gaps were infinitely deep [um].

        Args:
            normal: Unit normal of the ball at the contact, pointing into the ball [1, foot frame], shape
                (..., 3); the contact is at -R normal from the centre of the ground-side hemisphere.
            force_n: Ground reaction on the foot [N, foot frame], shape (..., 3); friction and off-centre
                contact are the angle between the two. Shape (k, ..., 3) for k forces at each contact.

        Returns:
            Closure d0 of each cell [um], shape (..., 324) or (k, ..., 324), positive when the gap narrows; may exceed
            the gap.

        Raises:
            ValueError: A normal is not a unit vector or lies below `min_elevation_deg`.
        """
        length_squared = np.einsum("...i,...i", normal, normal)
        # min and max of one number pass the NaN through, and a NaN fails both comparisons.
        if not (np.abs(length_squared - 1.0).max(initial=0.0) <= 2.0 * UNIT_LENGTH_TOLERANCE):
            raise ValueError(f"a contact normal has length 1, got {np.sqrt(length_squared)}")
        lowest = math.sin(math.radians(self.min_elevation_deg)) - UNIT_LENGTH_TOLERANCE
        if not (normal[..., 2].min(initial=1.0) >= lowest):
            raise ValueError(
                f"the response reaches down to an elevation of {self.min_elevation_deg:g} deg of the contact "
                f"normal (its z at least {lowest:.4f}), got z = {normal[..., 2].min():.4f}"
            )
        if len(normal) == 1 and normal.ndim == force_n.ndim == 2:
            return self._free_closure_of_one_contact_um(normal, force_n)
        basis = series_basis(normal, self.degree, self.fit_elevation_deg)
        radius_squared = self.patch_radius_mm(normal, force_n)[..., None] ** 2
        if force_n.ndim > normal.ndim:
            point, patch = basis @ self.closure_coefficients.reshape(
                2, 1, *self.closure_coefficients.shape[1:]
            )
            shape = (*basis.shape[:-1], 3, N_CELLS)
            of_point, of_patch = (
                (force_n[..., None, :] @ part.reshape(shape))[..., 0, :] for part in (point, patch)
            )
            several: Vector = of_point + radius_squared * of_patch
            return several
        # One product for the point force and what the patch adds: the series are long, the basis is short.
        weighted = np.concatenate([basis, radius_squared * basis], axis=-1)
        shape = (*basis.shape[:-1], 3, N_CELLS)
        unit_n = (weighted @ self.closure_coefficients.reshape(-1, 3 * N_CELLS)).reshape(shape)
        closure: Vector = (force_n[..., None, :] @ unit_n)[..., 0, :]
        return closure

    def _free_closure_of_one_contact_um(self, normal: Vector, force_n: Vector) -> Vector:
        """Return the free cell closures of one load [um], shape (1, 324); caches the last normal's coefficients."""
        where = normal.tobytes()
        if self._last_contact[0] != where:
            basis = series_basis(normal, self.degree, self.fit_elevation_deg)[0]
            self._last_contact[:] = where, basis @ self.closure_coefficients.reshape(2, len(basis), -1)
        point, patch = self._last_contact[1].reshape(2, 3, N_CELLS)
        radius_squared = self.patch_radius_mm(normal, force_n)[0] ** 2
        closure: Vector = force_n @ (point + radius_squared * patch)
        return closure

    def free_element_closures_um(self, normal: Vector, force_n: Vector) -> Vector:
        """Return the mean closure of each element under loads [um], shape (..., 9), without gap contact."""
        return element_means(self.free_closure_um(normal, force_n))


# A simulated robot reads the table of its feet, and the service the same file.
@lru_cache(maxsize=1)
def _of_content(content: bytes) -> FootResponse:
    """Return the response of a file's content."""
    parts = _unpack(content)
    parts["design"] = Capacitor(**parts["design"])
    return FootResponse(**parts, sha256=hashlib.sha256(content).hexdigest())
