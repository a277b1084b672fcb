"""Load cases with their closures: the paper's two sets, and random loads for training.

The paper's loads are centred (the force goes through the middle of the ball, so the contact normal is parallel to
it) and have three magnitudes. A walking foot sees more: any magnitude, and contacts whose normal is tilted away
from the force by friction and uneven ground, which turn the pattern of closures far more than an inclined centred
force does. The network has to tell the two apart, so its training needs both.
"""

from dataclasses import dataclass

import numpy as np

from firmware_interface.chips import fdc1004
from footsense.errors import ModelError
from footsense.estimation import settings
from footsense.foot.capacitor import Capacitor
from footsense.foot.directions import normalized, paper_directions, random_directions
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import ContactLoads, Specimen
from footsense.frames import Vector
from footsense.lab.geometry import LoadRange
from footsense.lab.symmetry import SYMMETRIES, element_permutation

#: Noise of one conversion, and of the baseline [pF, rms], as the card's sigma is measured with.
NOISE_PF, BASELINE_NOISE_PF = settings.READING_NOISE_PF, settings.BASELINE_NOISE_PF
#: Full scale of the converter [pF]; beyond, the daemon reports `saturated`.
FULL_SCALE_PF = fdc1004.capacitance_pf(fdc1004.CODE_MAX)
#: Loads that are turned into closures at once, which limits memory.
_LOADS_PER_CALL = 2048
#: Most loads drawn for each wanted one: a foot that saturates under 19 of 20 loads is unsuited to them.
_MAX_DRAWS_PER_LOAD = 20


@dataclass(frozen=True, slots=True, eq=False)
class Cases:
    """Forces [N] on a foot, and the gap closures [um] under each force.

    Attributes:
        force_n: Ground reaction on the foot [N], shape (n, 3).
        closure_um: Closure that the capacitance of each element stands for [um], shape (n, elements): the mean closure
            as long as the electrode stays flat, a little more where it bends.
    """

    force_n: Vector
    closure_um: Vector

    def with_symmetric_copies(self) -> "Cases":
        """Return the cases with their seven images under the square's symmetries, shape (8 n, ...)."""
        closures = []
        for symmetry in SYMMETRIES:
            image = np.empty_like(self.closure_um)
            image[:, element_permutation(symmetry)] = self.closure_um
            closures.append(image)
        return Cases(np.concatenate([self.force_n @ g.T for g in SYMMETRIES]), np.concatenate(closures))


@dataclass(frozen=True, slots=True, eq=False)
class LeaningCases(Cases):
    """Load cases whose contact normals may lean away from the force.

    Attributes:
        normal: Inward unit normal of the ball at the contact, shape (n, 3).
    """

    normal: Vector


def sensed_closure_um(foot: Specimen, normal: Vector, force_n: Vector) -> Vector:
    """Return the closures that the service would compute [um], (n, elements), from simulated capacitances.

    Args:
        foot: The specimen.
        normal: Contact normals, shape (n, 3).
        force_n: Forces [N], shape (n, 3).
    """
    parts = []
    for first in range(0, len(force_n), _LOADS_PER_CALL):
        some = slice(first, first + _LOADS_PER_CALL)
        parts.append(foot.capacitance_pf(normal[some], force_n[some]))
    return foot.response.design.closure_um(np.concatenate(parts), foot.unloaded_pf)


def _centred_cases(response: FootResponse, direction: Vector, magnitudes_gf: list[float]) -> Cases:
    """Return the cases of centred loads on the designed foot: every direction at every magnitude."""
    force = np.concatenate([direction * magnitude * GRAM_FORCE_N for magnitude in magnitudes_gf])
    normal = np.tile(direction, (len(magnitudes_gf), 1))
    return Cases(force, sensed_closure_um(Specimen(response), normal, force))


def paper_training(response: FootResponse, *, force_unit: float = 1.0) -> Cases:
    """Return the paper's 362 training cases (section III F): 181 directions at 50 and 150 gf, times a force unit."""
    return _centred_cases(response, paper_directions("training"), [50.0 * force_unit, 150.0 * force_unit])


def paper_verification(response: FootResponse, *, force_unit: float = 1.0) -> Cases:
    """Return the paper's 180 test cases (section III F): angles shifted by 5 deg, 100 gf, times a force unit."""
    return _centred_cases(response, paper_directions("verification"), [100.0 * force_unit])


def leaning_normals(loads: LoadRange, rng: np.random.Generator, direction: Vector) -> Vector:
    """Return random contact normals that lean from the force directions, within the friction angle."""
    n, typical_deg = len(direction), loads.typical_lean_deg
    # A Rayleigh distribution cut off at the friction angle, by inversion.
    within = -np.expm1(-0.5 * (loads.friction_angle_deg / typical_deg) ** 2)
    angle = np.radians(typical_deg) * np.sqrt(-2.0 * np.log1p(-within * rng.uniform(size=n)))
    angle[rng.uniform(size=n) < loads.centred_share] = 0.0
    sideways = normalized(np.cross(direction, rng.normal(size=(n, 3))))
    normal: Vector = np.cos(angle)[:, None] * direction + np.sin(angle)[:, None] * sideways
    return normal


def leaning_loads(
    loads: LoadRange, n: int, sizes_gf: tuple[float, float], min_elevation_deg: float, seed: int
) -> ContactLoads:
    """Return up to n random leaning loads with evenly distributed sizes, whatever the converter can read.

    Args:
        loads: How far a normal leans.
        n: How many.
        sizes_gf: Least and largest force [gf].
        min_elevation_deg: Lowest elevation of force and normal [deg].
        seed: Seed of the loads.
    """
    rng = np.random.default_rng(seed)
    direction = random_directions(rng, 4 * n, min_elevation_deg)
    normal = leaning_normals(loads, rng, direction)
    reached = np.flatnonzero(normal[:, 2] >= np.sin(np.radians(min_elevation_deg)))[:n]
    size_n = GRAM_FORCE_N * rng.uniform(*sizes_gf, (len(reached), 1))
    return ContactLoads(normal[reached], size_n * direction[reached])


def random_loads(
    response: FootResponse, loads: LoadRange, n: int, seed: int, *, max_overloaded: int = 0
) -> LeaningCases:
    """Return n random load cases within the converter's range, but for a number of elements.

    Half of the magnitudes are uniform up to the largest, half uniform in the logarithm from a light touch, so that
    light and firm steps are equally frequent. Gaps may close in part; loads that drive more elements beyond the
    converter's full scale are drawn again. The others' closures are those of the full scale: at least so much.

    Raises:
        ModelError: Hardly any of the loads is within the converter's range.
    """
    rng = np.random.default_rng(seed)
    foot = Specimen(response)
    lowest_z = np.sin(np.radians(loads.min_elevation_deg))
    full_scale_um = response.design.closure_um(np.array([FULL_SCALE_PF]), foot.unloaded_pf)
    kept: list[tuple[Vector, ...]] = []
    found = 0
    for _ in range(_MAX_DRAWS_PER_LOAD):
        direction = random_directions(rng, n, loads.min_elevation_deg)
        normal = leaning_normals(loads, rng, direction)
        even = rng.uniform(size=n) < 0.5
        even_n = rng.uniform(0.0, loads.max_n, n)
        magnitude = np.where(
            even, even_n, np.exp(rng.uniform(np.log(loads.min_training_force_n), np.log(loads.max_n), n))
        )
        reached = normal[:, 2] >= lowest_z
        force, normal = (direction * magnitude[:, None])[reached], normal[reached]
        closure = sensed_closure_um(foot, normal, force)
        in_range = (closure >= full_scale_um).sum(axis=1) <= max_overloaded
        kept.append(tuple(part[in_range] for part in (force, np.minimum(closure, full_scale_um), normal)))
        found += int(in_range.sum())
        if found >= n:
            return LeaningCases(*(np.concatenate(part)[:n] for part in zip(*kept, strict=True)))
    raise ModelError(
        f"{response.foot_type}: of loads up to {loads.max_n:g} N the converter can tell "
        f"{found / (_MAX_DRAWS_PER_LOAD * n):.1%}; lower loads.max_n, or make the foot stiffer or its gap thicker"
    )


def measured_closure_rel(design: Capacitor, closure_um: Vector, rng: np.random.Generator) -> Vector:
    """Return closures over the gap [1] with the noise of capacitance and baseline added."""
    measured = design.capacitance_pf(closure_um) + NOISE_PF * rng.normal(size=closure_um.shape)
    baseline = design.unloaded_pf + BASELINE_NOISE_PF * rng.normal(size=closure_um.shape)
    return design.closure_um(measured, baseline) / design.gap_um


def closure_of_designed_foot_um(design: Capacitor, change_pf: Vector) -> Vector:
    """Return the closures [um] that cause the given capacitance changes [pF] on the designed foot.

    Estimators of capacitance changes take closures and the design; these closures give them the measured changes.
    """
    unloaded_pf = np.array(design.unloaded_pf)
    return design.closure_um(unloaded_pf + change_pf, unloaded_pf)
