"""Screening of all candidates, vectorised: range, limiting factor, Cramer-Rao bound of the error.

The range is an estimate of `evaluation.force_range` without gap contact, so that hundreds of thousands of feet take
seconds; the contact patch has to be no wider than the response table holds, too.
Errors are the Cramer-Rao bound of one scan for an unknown force and contact (`evaluation.cramer_rao`), from the
smallest load to the largest.

Mean closures and their derivatives by force and contact are without gap contact. In the units of the solved feet (10
mm, 5.2 MPa) a foot's closure under a force f = N u of the normal load N, u . n = 1 with the contact's normal n, is

    d = s N [w0 + a^2 w2] . u,      s = A (5.2 / E) (10 / R)
    a^2 = 100 (3/4 (1 - nu^2) N / (E R^2))^(2/3)

with w0, w2 and their slopes by the normal the weighted sum of those of the solved shapes.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.foot.capacitor import EPS0_PF_UM_PER_MM2
from footsense.foot.directions import normalized, tangent_frame
from footsense.foot.gap_contact import element_means
from footsense.foot.response_table import series_basis, whole_series
from footsense.foot.specimen import ContactLoads
from footsense.frames import ELEMENTS, Vector
from footsense.lab.design.requirements import Requirements
from footsense.lab.design.shapes import (
    AMPLITUDE_INDEX_OF_ELEMENT,
    RADIUS_MM,
    RUBBER_POISSON,
    YOUNGS_MPA,
    FootShape,
    FootShapeLibrary,
    sheet_filling_pitch_mm,
)
from footsense.lab.evaluation.cramer_rao import closure_sigma_um
from footsense.lab.evaluation.force_range import MAX_READABLE_CLOSURE_REL
from footsense.lab.geometry import MIN_FITTED_ELEVATION_DEG, MIN_TABLE_ELEVATION_DEG, UM_PER_MM

#: Feet evaluated at once, which limits memory.
_FEET_PER_CALL = 2000
#: Loads between the smallest and the largest at which errors are evaluated, evenly in the logarithm.
_N_LOAD_LEVELS = 3
#: Largest force of the training over the largest normal load, so that it covers what an overload leaves; the patch has
#: to be in the table there too [1].
TRAINED_RANGE_FACTOR = 2.0
#: What ends a foot's range, by number.
LIMIT_NAMES = ("gap", "converter", "patch")
#: Step of the differences by the normal [rad], and degree of the series.
_STEP, _DEGREE = 1e-3, 12
#: Steps of the ball's diameter.
_N_BALL_DIAMETERS_TRIED = 9


class Candidates(NamedTuple):
    """Parameters of n candidate feet; every field has shape (n,).

    Attributes:
        ball_radius_mm: Radius of the ball [mm].
        electrode_over_pitch: Side of an electrode over the pitch [1].
        plate_mm: Thickness of a plate [mm].
        gap_um: Unloaded gap [um].
        film: Number of the film in the process's table.
        rubber: Number of the rubber in the table.
        sheet: Number of the sheet in the table.
        rubber_mpa: Young's modulus of the rubber [MPa].
        sheet_mpa: Young's modulus of the sheet [MPa].
        sheet_poisson: Poisson's ratio of the sheet [1].
        film_um: Thickness of the film [um].
        film_eps_r: Its permittivity [1].
    """

    ball_radius_mm: Vector
    electrode_over_pitch: Vector
    plate_mm: Vector
    gap_um: Vector
    film: NDArray[np.intp]
    rubber: NDArray[np.intp]
    sheet: NDArray[np.intp]
    rubber_mpa: Vector
    sheet_mpa: Vector
    sheet_poisson: Vector
    film_um: Vector
    film_eps_r: Vector

    def select(self, selection: NDArray[np.intp] | NDArray[np.bool_] | slice) -> "Candidates":
        """Return the candidates selected by a mask or by indices."""
        parts: list[Any] = [part[selection] for part in self]
        return Candidates(*parts)

    @property
    def pitch_mm(self) -> Vector:
        """Distance between the centres of neighbouring elements [mm]."""
        return sheet_filling_pitch_mm(self.electrode_over_pitch, self.ball_radius_mm)

    @property
    def electrode_mm(self) -> Vector:
        """Side length of an electrode [mm]."""
        return self.electrode_over_pitch * self.pitch_mm

    @property
    def eps0_area_pf_um(self) -> Vector:
        """Capacitance times plate distance of an element, eps0 A [pF um]."""
        return EPS0_PF_UM_PER_MM2 * self.electrode_mm**2

    @property
    def unloaded_distance_um(self) -> Vector:
        """Equivalent air distance of the unloaded electrodes [um]: gap plus film over its permittivity."""
        return self.gap_um + self.film_um / self.film_eps_r

    @property
    def unloaded_pf(self) -> Vector:
        """Capacitance of an unloaded element [pF]."""
        return self.eps0_area_pf_um / self.unloaded_distance_um

    @property
    def half_closed_pf(self) -> Vector:
        """Capacitance of an element whose gap is half closed [pF]."""
        return self.eps0_area_pf_um / (self.unloaded_distance_um - 0.5 * self.gap_um)

    @property
    def shape(self) -> FootShape:
        """Dimensionless shapes of the candidates, for the response library."""
        spacer_mm = (self.gap_um + self.film_um) / UM_PER_MM
        return FootShape(
            self.electrode_over_pitch,
            self.plate_mm / self.ball_radius_mm,
            spacer_mm / self.ball_radius_mm,
            self.sheet_mpa / self.rubber_mpa,
            self.sheet_poisson,
        )


def all_candidates(requirements: Requirements) -> Candidates:
    """Return every combination of available dimensions, materials and films, feasible or not."""
    low_mm, high_mm = requirements.ball_diameter_range_mm
    radii = np.unique(np.round(np.linspace(low_mm, high_mm, _N_BALL_DIAMETERS_TRIED) * 2.0) / 2.0) / 2.0
    process, materials = requirements.process, requirements.materials
    axes = (
        radii,
        np.array(process.fill_rel, float),
        np.array(process.plate_mm, float),
        np.array(process.gap_um, float),
        np.arange(len(process.film)),
        np.arange(len(materials.rubbers)),
        np.arange(len(materials.sheets)),
    )
    radius, fill, plate, gap, film, rubber, sheet = (
        part.ravel() for part in np.meshgrid(*axes, indexing="ij")
    )
    rubbers = [solid.material for solid in materials.rubbers]
    sheets = [solid.material for solid in materials.sheets]
    return Candidates(
        *(radius, fill, plate, gap, film, rubber, sheet),
        rubber_mpa=np.array([one.youngs_mpa for one in rubbers])[rubber],
        sheet_mpa=np.array([one.youngs_mpa for one in sheets])[sheet],
        sheet_poisson=np.array([one.poisson for one in sheets])[sheet],
        film_um=np.array([one.um for one in process.film])[film],
        film_eps_r=np.array([one.eps_r for one in process.film])[film],
    )


class Influence(NamedTuple):
    """Closure per newton of n feet under m loads, by element [um/N].

    Attributes:
        point_force_um_per_n: Of a point force, and its slopes by two turns of the normal [um/N], shape (n, m, 3, 3, 9).
        patch_correction_um_per_n: The same of the contact patch, for (F/N)^(2/3) = 1 [um/N].
    """

    point_force_um_per_n: Vector
    patch_correction_um_per_n: Vector


class ClosureModel:
    """Closures of candidate feet under given loads, interpolated from the shape library.

    Args:
        library: The solved shapes.
        loads: The loads, each of 1 N along its normal.

    Attributes:
        loads: The loads.
        unevenness: Variance of an electrode's cell closures over their squared mean, paper's shape, shape (m, 9).
    """

    def __init__(self, library: FootShapeLibrary, loads: ContactLoads) -> None:
        """Create the model: evaluate the solved shapes at the loads."""
        self._library, self.loads = library, loads
        self._across = np.stack(tangent_frame(loads.normal), axis=1)
        whole = [[whole_series(part, _DEGREE) for part in shape] for shape in library.series]
        # shapes, point or patch, products, xyz, elements
        series = element_means(np.moveaxis(np.array(whole), -1, -2))
        basis = self._basis()
        self._at = basis @ series.reshape(*series.shape[:3], -1)
        cells = np.einsum("mp,pec,mc->me", basis[: len(loads.normal)], whole[0][0], loads.force_n)
        cells = cells.reshape(len(cells), ELEMENTS, -1)
        self.unevenness = cells.var(axis=2) / cells.mean(axis=2) ** 2

    def _basis(self) -> Vector:
        """Return the response series' products at the normals, and their derivatives, (3 loads, products)."""
        normal, turns = self.loads.normal, _STEP * self._across.transpose(1, 0, 2)
        at, ahead, behind = (
            series_basis(each, _DEGREE, MIN_FITTED_ELEVATION_DEG)
            for each in (normal, normalized(normal + turns), normalized(normal - turns))
        )
        return np.concatenate([at, *((ahead - behind) / (2.0 * _STEP))])

    def influence(self, feet: Candidates) -> Influence:
        """Return the closures per newton of a batch of feet (12 kB of memory each)."""
        weights = self._library.interpolation_weights(feet.shape)
        amplitudes = self._library.interpolated_response_amplitudes_um_per_n(weights)
        amplitude = amplitudes[:, AMPLITUDE_INDEX_OF_ELEMENT]
        size = RADIUS_MM / feet.ball_radius_mm
        relative_compliance = (YOUNGS_MPA / feet.rubber_mpa) * size
        m = len(self.loads.normal)
        whole = (weights * relative_compliance[:, None]) @ self._at.reshape(len(self._at), -1)
        whole = whole.reshape(len(weights), 2, 3, m, 3, ELEMENTS).swapaxes(2, 3)
        whole = whole * amplitude[:, None, None, None, None, :]
        patch_rel2 = (0.75 * (1.0 - RUBBER_POISSON**2) / (feet.rubber_mpa * feet.ball_radius_mm**2)) ** (
            2.0 / 3.0
        )
        return Influence(whole[:, 0], RADIUS_MM**2 * patch_rel2[:, None, None, None, None] * whole[:, 1])

    def closures_and_jacobian_um(self, influence: Influence, load_n: float) -> tuple[Vector, Vector]:
        """Return closures [um], (n, m, 9), and their derivatives by the unknowns, (n, m, 9, 5).

        Args:
            influence: Of the feet.
            load_n: Normal load [N].

        Returns:
            The slopes are by the force's components over the normal load [um], then by two turns of the normal
            [um/rad].
        """
        normal, force = self.loads
        grown = load_n ** (2.0 / 3.0)
        unit = influence.point_force_um_per_n + grown * influence.patch_correction_um_per_n
        # per newton of normal load, at the normal and its turns: shape (n, m, 3 turns, 9)
        along = np.einsum("nmtce,mc->nmte", unit, force)
        patch = np.einsum("nmce,mc->nme", influence.patch_correction_um_per_n[:, :, 0], force)
        # The patch grows with the normal load: d(N^(2/3)) = 2/3 N^(2/3) dN / N.
        growth = (2.0 / 3.0) * grown * patch
        by_force = unit[:, :, 0] + growth[:, :, None, :] * normal[:, :, None]
        leaning = np.einsum("mtc,mc->mt", self._across, force)
        by_normal = along[:, :, 1:] + growth[:, :, None, :] * leaning[:, :, None]
        slopes = np.concatenate([by_force, by_normal], axis=2) * load_n
        return load_n * along[:, :, 0], np.moveaxis(slopes, 2, 3)


class ScreeningResult(NamedTuple):
    """Range [N], limiting factor and error bounds of n candidates.

    Attributes:
        range_n: Largest normal load under every load of the design [N], shape (n,).
        limiting_factor_index: What ends it, a number in `LIMIT_NAMES`, shape (n,).
        direction_error_bound_deg: Cramer-Rao bound of the direction, mean over loads [deg rms], shape (n,); NaN if the
            largest load is beyond the range.
    """

    range_n: Vector
    limiting_factor_index: NDArray[np.intp]
    direction_error_bound_deg: Vector


def patch_limit_n(feet: Candidates) -> Vector:
    """Return the normal load at which the contact patch reaches the response table's largest angle [N], shape (n,)."""
    widest = np.radians(MIN_TABLE_ELEVATION_DEG - MIN_FITTED_ELEVATION_DEG)
    limit: Vector = widest**3 * feet.rubber_mpa * feet.ball_radius_mm**2 / (0.75 * (1.0 - RUBBER_POISSON**2))
    return limit


def screen_candidates(
    library: FootShapeLibrary, requirements: Requirements, feet: Candidates
) -> ScreeningResult:
    """Return range and error bounds of every candidate."""
    model = ClosureModel(library, requirements.loads)
    parts = [
        _screen_batch(model, requirements, feet.select(slice(first, first + _FEET_PER_CALL)))
        for first in range(0, len(feet.gap_um), _FEET_PER_CALL)
    ]
    return ScreeningResult(*(np.concatenate(field) for field in zip(*parts, strict=True)))


def _screen_batch(model: ClosureModel, requirements: Requirements, feet: Candidates) -> ScreeningResult:
    """Return range and error bounds of one batch of candidates."""
    influence = model.influence(feet)
    by_gap = _load_at_closure_n(model, influence, feet, MAX_READABLE_CLOSURE_REL * feet.gap_um)
    readable = feet.unloaded_distance_um - feet.eps0_area_pf_um / requirements.board.range_end_pf
    by_converter = _load_at_closure_n(model, influence, feet, np.maximum(readable, 1e-9))
    limits = np.stack([by_gap, by_converter, patch_limit_n(feet) / TRAINED_RANGE_FACTOR])
    range_n, limit = limits.min(axis=0), limits.argmin(axis=0)
    direction_deg = np.full(len(range_n), np.nan)
    able = np.flatnonzero(range_n >= requirements.max_load_n)
    if len(able):
        some = Influence(influence.point_force_um_per_n[able], influence.patch_correction_um_per_n[able])
        direction_deg[able] = _direction_error_bounds_deg(model, some, feet.select(able), requirements)
    return ScreeningResult(range_n, limit, direction_deg)


def _load_at_closure_n(
    model: ClosureModel, influence: Influence, feet: Candidates, closure_um: Vector
) -> Vector:
    """Return the least normal load at which some element reaches a given closure, over all loads [N], shape (n,).

    An electrode that bends reads as closed a little more than its mean: its closest parts count most.
    """
    point, patch = (
        np.einsum("nmce,mc->nme", one[:, :, 0], model.loads.force_n)
        for one in (influence.point_force_um_per_n, influence.patch_correction_um_per_n)
    )
    read, open_um = closure_um[:, None, None], feet.unloaded_distance_um[:, None, None]
    # The mean d of distances D - d that reads as r: d + v d^2 / (D - d) = r to second order, v the relative variance.
    even = 1.0 - model.unevenness
    total = open_um + read
    wanted = (total - np.sqrt(total**2 - 4.0 * even * read * open_um)) / (2.0 * even)
    most = 1e6
    load = np.clip(wanted / np.maximum(point, 1e-12), 0.0, most)
    for _ in range(12):
        # Newton for N point + N^(5/3) patch = wanted; the patch's part is small and may be negative.
        grown = load ** (2.0 / 3.0)
        slope = np.maximum(point + (5.0 / 3.0) * grown * patch, 0.2 * np.maximum(point, 1e-12))
        load = np.clip(load - (load * (point + grown * patch) - wanted) / slope, 0.0, most)
    least: Vector = load.min(axis=(1, 2))
    return least


def _direction_error_bounds_deg(
    model: ClosureModel, influence: Influence, feet: Candidates, requirements: Requirements
) -> Vector:
    """Return Cramer-Rao bounds of the direction [deg], averaged over loads, shape (n,)."""
    force, board = model.loads.force_n, requirements.board
    across = np.stack(tangent_frame(normalized(force)), axis=1)
    open_um, plates = feet.unloaded_distance_um[:, None, None], feet.eps0_area_pf_um[:, None, None]
    angles = []
    for load_n in np.geomspace(requirements.min_load_n, requirements.max_load_n, _N_LOAD_LEVELS):
        closure, slopes = model.closures_and_jacobian_um(influence, float(load_n))
        sigma_um = closure_sigma_um(open_um, plates, closure, board.noise_pf)
        whitened = slopes / sigma_um[..., None]
        information = np.einsum("nmei,nmej->nmij", whitened, whitened)
        covariance = np.linalg.inv(information)[..., :3, :3]  # over the squared normal load
        angles.append(np.einsum("mtc,nmcd,mtd->nm", across, covariance, across) / (force**2).sum(axis=1))
    bound_deg: Vector = np.degrees(np.sqrt(np.array(angles)).mean(axis=(0, 2)))
    return bound_deg
