"""Simulated feet with fabrication tolerances: pressed on a test stand, calibrated, mounted anew and evaluated.

Fit, network and limits are those of `footsense test-stand calibrate`. A press is read once, in mid-dwell, with the
rubber's memory of the presses before; converters, bus and recording are left out, which takes a hundredth of the time.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from firmware_interface.chips import fdc1004
from footsense.calibration.calibrate import (
    WARNING_MEDIAN_MAHALANOBIS_DISTANCE,
    CalibrationResult,
    fit_foot_unchecked,
    require_plausible,
)
from footsense.calibration.evaluation import DesignModels
from footsense.calibration.loads import LoadSet
from footsense.calibration.rubber_memory import correct_baselines_for_creep
from footsense.calibration.standing.calibrate import calibrate_standing
from footsense.calibration.standing.recording import StandingLoads
from footsense.errors import CalibrationError
from footsense.estimation.settings import BASELINE_NOISE_PF
from footsense.foot.directions import normalized
from footsense.foot.force_errors import GRAM_FORCE_N, evaluate_force_errors
from footsense.foot.parameters import KNOWN_EXACTLY, FootParameters, variance_factors
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import ContactLoads, Deviations, Specimen
from footsense.frames import ELEMENTS, Mask, Vector
from footsense.sim.fabrication import (
    PAPER_TOLERANCES,
    REMOUNT_RMS_DEG,
    draw_deviations,
    uncertainty_of_parameters,
    with_new_mounting,
    with_session_gains,
)
from footsense.sim.loads.press_sequence import paper_presses
from footsense.sim.reference_sensor import (
    MAX_NONLINEARITY_REL,
    RESOLUTION_GF,
    draw_nonlinearity_amplitude_gf,
    nonlinearity_gf,
)
from footsense.sim.rubber import ElementCreep, RubberFactor, ViscoelasticRubber
from footsense.sim.uncalibrated import uncertainty_by_wear, uncertainty_of_uncalibrated

#: Pause before a press, its rise, both halves of its dwell, and its fall [ns]; load at the end of each [1].
_STEPS_NS = (500_000_000, 50_000_000, 250_000_000, 250_000_000, 50_000_000)
_STEP_LOADS = (0.0, 1.0, 1.0, 1.0, 0.0)
#: Steps at whose end the baseline and the press are read.
_READ_STEPS = [0, 2]
#: Noise of one reading, without a dwell's mean [pF].
_ONE_READING_PF = 0.5e-3
#: Scatter of a press's mean force that a calibration assumes, over the reference's resolution [1].
_ASSUMED_FORCE_NOISE_STEPS = 0.07
_FULL_SCALE_PF = fdc1004.capacitance_pf(fdc1004.CODE_MAX)
#: Loads of the small calibration.
N_FEW = 20
#: Of all feet and test stands; a foot's number is the other half.
SEED = 0

#: Trains on changes of capacitance [pF], shape (n, 9), and forces [N], shape (n, 3); returns those of other changes.
PerFootNetwork = Callable[[Vector, Vector, Vector], Vector]
#: A foot of a response table with its deviations.
FootModel = Callable[[FootResponse, Deviations], Specimen]


@dataclass(frozen=True, slots=True, kw_only=True)
class PressConditions:
    """What rubber, test stand and floor do; the default is what a calibration expects.

    Attributes:
        creep_factor: Creep of the rubber over that assumed [1], one number or one of each retardation time.
        play_factor: Play of the rubber over that assumed [1], one number or one of each operator.
        creep_spread_rel: Standard deviation of the creep of single elements beside that of the foot [1].
        gain_wander_rel: Rms change of the gain of each element between calibration and use [1].
        max_floor_capacitance_pf: Largest capacitance that a floor adds to every element of a foot in contact [pF]; a
            foot has between a quarter of it and all of it. The stick of the test stand adds none.
        reading_noise_pf: Noise of a press's mean reading, rms [pF].
        baseline_noise_pf: Noise of the unloaded reading, rms [pF].
        repeatability_rel: Scatter of each change of capacitance, rms, relative to it [1].
        reference_nonlinearity_rel: Nonlinearity of the reference over its rated value [1].
        force_noise_steps: Scatter of a press's mean force, rms, over the reference's resolution [1].
        lean_rms_deg: Angle between the contact's normal and the force of a press, rms [deg].
    """

    creep_factor: RubberFactor = 1.0
    play_factor: RubberFactor = 1.0
    creep_spread_rel: float = 0.0
    gain_wander_rel: float = 0.0
    max_floor_capacitance_pf: float = 0.0
    reading_noise_pf: float = 0.15e-3
    baseline_noise_pf: float = BASELINE_NOISE_PF
    repeatability_rel: float = 0.0
    reference_nonlinearity_rel: float = MAX_NONLINEARITY_REL
    force_noise_steps: float = _ASSUMED_FORCE_NOISE_STEPS
    lean_rms_deg: float = 1.0


#: Elastic rubber, and a test stand without error.
EXACT_CONDITIONS = PressConditions(
    creep_factor=0.0,
    play_factor=0.0,
    reading_noise_pf=0.0,
    baseline_noise_pf=0.0,
    reference_nonlinearity_rel=0.0,
    force_noise_steps=0.0,
    lean_rms_deg=0.0,
)


class PressedFoot:
    """A simulated foot on its test stand, pressed load after load.

    Args:
        foot: The foot.
        mount: Rotation from the leg's frame to the foot's, shape (3, 3).
        conditions: What rubber, test stand and floor do.
        rng: Source of the noise.
        number: Number of the foot.
    """

    def __init__(
        self,
        foot: Specimen,
        mount: Vector,
        conditions: PressConditions,
        rng: np.random.Generator,
        number: int = 0,
    ) -> None:
        self._number = number
        self._foot, self._mount, self._conditions, self._rng = foot, mount, conditions, rng
        self._min_sine = np.sin(np.radians(foot.response.min_elevation_deg))
        self._bow_gf = draw_nonlinearity_amplitude_gf(rng, conditions.reference_nonlinearity_rel)
        self._floor_pf = conditions.max_floor_capacitance_pf * (
            rng.uniform(0.25, 1.0) * rng.uniform(0.7, 1.0, ELEMENTS)
        )

    def press_with_stick(self, force_n: Vector) -> LoadSet:
        """Return the readings under forces [N], shape (n, 3), of a stick that leans a little."""
        direction, lean = normalized(force_n), np.radians(self._conditions.lean_rms_deg) * np.sqrt(0.5)
        normal = normalized(direction + lean * np.cross(self._rng.normal(size=direction.shape), direction))
        return self._press(ContactLoads(normal, force_n), self._conditions.reading_noise_pf)

    def stand_on_floor(self, loads: ContactLoads) -> LoadSet:
        """Return single readings under loads on the floor, with the baseline of a robot that tared rested feet."""
        read = self._press(loads, _ONE_READING_PF)
        baseline_pf = np.tile(read.baseline_pf[0], (len(read), 1))
        return replace(read, capacitance_pf=read.capacitance_pf + self._floor_pf, baseline_pf=baseline_pf)

    def _press(self, loads: ContactLoads, noise_pf: float) -> LoadSet:
        conditions, n = self._conditions, len(loads.force_n)
        read_pf = self._read_pf(loads)
        noise = self._rng.normal(size=(4, n, ELEMENTS))
        change_pf = (read_pf[:, 1] - read_pf[:, 0]) * (1.0 + conditions.repeatability_rel * noise[1])
        load_gf = -loads.force_n / GRAM_FORCE_N
        reference_gf = load_gf + nonlinearity_gf(self._bow_gf, load_gf)
        reference_gf += conditions.force_noise_steps * RESOLUTION_GF * noise[3, :, :3]
        return LoadSet(
            force_n=-reference_gf * GRAM_FORCE_N,
            sigma_n=np.full(loads.force_n.shape, _ASSUMED_FORCE_NOISE_STEPS * RESOLUTION_GF * GRAM_FORCE_N),
            capacitance_pf=read_pf[:, 0] + change_pf + noise_pf * noise[0],
            baseline_pf=read_pf[:, 0] + conditions.baseline_noise_pf * noise[2],
        )

    def _read_pf(self, loads: ContactLoads) -> Vector:
        """Return the capacitances at the steps that are read, without noise [pF], shape (n, 2, elements)."""
        n, creep_rel = len(loads.force_n), self._conditions.creep_spread_rel
        steps = list(range(len(_STEPS_NS))) if creep_rel else _READ_STEPS
        capacitance_pf = self._foot.capacitance_pf(*self._effective_loads(loads, steps))
        if creep_rel:  # of the foot, not of the stand: the same shares in each set of loads
            shares = np.random.default_rng((SEED, self._number, 6))
            creep = ElementCreep(creep_rel, self._foot.unloaded_pf, shares)
            ends_ns = np.cumsum(np.tile(_STEPS_NS, n)).tolist()
            pairs = zip(ends_ns, capacitance_pf, strict=True)
            capacitance_pf = np.array([creep.next_capacitance_pf(*pair) for pair in pairs])
        read_pf: Vector = capacitance_pf.reshape(n, len(steps), ELEMENTS)
        return read_pf[:, _READ_STEPS] if creep_rel else read_pf

    def _effective_loads(self, loads: ContactLoads, steps: list[int]) -> tuple[Vector, Vector]:
        """Return normals and forces of an elastic foot at the given steps of each press, in turn, shape (m, 3) each."""
        rubber = ViscoelasticRubber(self._conditions.creep_factor, self._conditions.play_factor)
        t_ns, normals, forces = 0, [], []
        for normal, force_n in zip(self._table_normals(loads.normal), loads.force_n, strict=True):
            for step, (duration_ns, share) in enumerate(zip(_STEPS_NS, _STEP_LOADS, strict=True)):
                t_ns += duration_ns
                effective = rubber.next_effective_load(t_ns, normal, share * force_n)
                if step in steps:
                    normals.append(effective[0])
                    forces.append(effective[1])
        return np.array(normals), np.array(forces)

    def _table_normals(self, normal: Vector) -> Vector:
        """Return the contact normals, shape (n, 3); those below the response table are lifted to its edge."""
        inside = normal @ self._mount.T
        low = inside[:, 2] < self._min_sine
        across = inside[low, :2] / np.linalg.norm(inside[low, :2], axis=1, keepdims=True)
        inside[low, :2] = np.sqrt(1.0 - self._min_sine**2) * across
        inside[low, 2] = self._min_sine
        return inside @ self._mount


class MadeFootPlan(NamedTuple):
    """Presses of the calibration, and test loads by name, of which the first is that of the paper.

    Attributes:
        every_nth_press: Use one of so many of the paper's 362 presses.
        tests: Test loads by name.
        standing: Loads at rest of the robot, of which the calibration without a reference knows the readings alone.
    """

    every_nth_press: int
    tests: Mapping[str, ContactLoads]
    standing: ContactLoads


def evaluate_made_foot(
    models: DesignModels,
    truth: FootResponse,
    conditions: PressConditions,
    plan: MadeFootPlan,
    number: int,
    foot_model: FootModel = Specimen,
    per_foot_network: PerFootNetwork | None = None,
) -> dict[str, Any]:
    """Make one foot with the paper's tolerances, calibrate it as shipped, and return its force errors.

    A calibration that is refused is evaluated all the same, and says so.

    Args:
        models: Models that the calibration knows.
        truth: Response that the foot has.
        conditions: What its rubber, test stand and floor do.
        plan: Its loads.
        number: Number of the foot.
        foot_model: Makes the foot.
        per_foot_network: Trains a network on this foot's presses alone; None for none.

    Returns:
        `n_loads`, the presses within the converter's range; by calibration, `few`, `all` and `standing`, in
        `calibrations`: `distance`, `warned`, `refused`; and in `errors`, by test and estimator (`design`, the
        calibrations, `own_network`; one by standing that is refused errs as the design),
        the mean errors `deg` and `gf` against the reference, `true_deg` and `true_gf` against truth, the share
        `no_force` of the loads that are left out because there is no force, and `within_2_sigma` of the components;
        None if there is no force at all.
    """
    own = draw_deviations(truth, PAPER_TOLERANCES, SEED, number)
    rng = np.random.default_rng((SEED, number, 4))
    stand = PressedFoot(foot_model(truth, own), own.mount, conditions, rng, number)
    loads = _pressed(models, stand, plan)
    few = loads.subset(loads.space_filling_order()[:N_FEW])
    fits = {"few": fit_foot_unchecked(models, few), "all": fit_foot_unchecked(models, loads)}
    parameters = {"design": None} | {name: fit.parameters for name, fit in fits.items()}
    parameters["standing"], judged_standing = _calibrated_by_standing(models, stand, plan.standing)
    known = (models.network_for_rows(1), models.response, 1)
    wear = uncertainty_by_wear(*known) if conditions.gain_wander_rel else KNOWN_EXACTLY
    unknown = {
        name: uncertainty_of_uncalibrated(*known)
        if foot is None
        else uncertainty_of_parameters(foot, pressed=name != "standing").plus(wear)
        for name, foot in parameters.items()
    }
    again = with_new_mounting(own, REMOUNT_RMS_DEG, SEED, number, 2)
    again = with_session_gains(again, conditions.gain_wander_rel, SEED, number, 1)
    rng = np.random.default_rng((SEED, number, 5))
    remounted = PressedFoot(foot_model(truth, again), again.mount, conditions, rng, number)
    errors: dict[str, dict[str, dict[str, float] | None]] = {}
    for test, test_loads in plan.tests.items():
        read = remounted.stand_on_floor(test_loads)
        in_range = _is_in_converter_range(read)
        errors[test] = {}
        for name, foot in parameters.items():
            force_n, sigma_n = models.estimate(read, foot)
            of_all, of_own = variance_factors([unknown[name]])
            sigma_n = np.sqrt(
                sigma_n**2 + of_all * (force_n**2).sum(axis=1, keepdims=True) + of_own * force_n**2
            )
            force_n[~in_range] = np.nan
            errors[test][name] = found = _errors(read.force_n, test_loads.force_n, force_n)
            if found is not None:
                off = np.abs(force_n - test_loads.force_n) / sigma_n
                found["within_2_sigma"] = round(float((off[np.isfinite(off)] <= 2.0).mean()), 4)
        if per_foot_network is not None:
            change_pf, test_pf = (one.capacitance_pf - one.baseline_pf for one in (loads, read))
            force_n = per_foot_network(change_pf, loads.force_n, test_pf)
            force_n[~in_range] = np.nan
            errors[test]["own_network"] = _errors(read.force_n, test_loads.force_n, force_n)
    return {
        "n_loads": len(loads),
        "calibrations": {name: _judged(fit) for name, fit in fits.items()} | {"standing": judged_standing},
        "errors": errors,
    }


def calibrate_made_foot(
    models: DesignModels, plan: MadeFootPlan, number: int
) -> tuple[FootParameters, FootParameters | None]:
    """Return the parameters of a made foot that was pressed, and that stood, None if those are refused.

    Args:
        models: Models that the calibration knows; the foot has their response.
        plan: Its loads.
        number: Number of the foot.
    """
    own, rng = (
        draw_deviations(models.response, PAPER_TOLERANCES, SEED, number),
        np.random.default_rng((SEED, number, 4)),
    )
    stand = PressedFoot(Specimen(models.response, own), own.mount, PressConditions(), rng, number)
    pressed = fit_foot_unchecked(models, _pressed(models, stand, plan)).parameters
    return pressed, _calibrated_by_standing(models, stand, plan.standing)[0]


def _pressed(models: DesignModels, stand: PressedFoot, plan: MadeFootPlan) -> LoadSet:
    """Return the presses of a plan that are within the converter's range."""
    pressed = stand.press_with_stick(paper_presses("training")[:: plan.every_nth_press])
    loads = correct_baselines_for_creep(models.response, pressed)
    return loads.subset(_is_in_converter_range(loads))


def _calibrated_by_standing(
    models: DesignModels, stand: PressedFoot, loads: ContactLoads
) -> tuple[FootParameters | None, dict[str, float]]:
    """Return the parameters of a foot that stood, None if they are refused, and how its loads fit."""
    read = stand.stand_on_floor(loads)
    read = read.subset(_is_in_converter_range(read))
    try:
        found = calibrate_standing(models, StandingLoads(read.capacitance_pf, read.baseline_pf), None)
    except CalibrationError:
        return None, {"distance": 0.0, "warned": False, "refused": True}
    distance = round(float(np.median(found.fit.mahalanobis_distance)), 3)
    return found.parameters, {"distance": distance, "warned": False, "refused": False}


def _is_in_converter_range(loads: LoadSet) -> Mask:
    """Return the mask of the loads whose capacitances are within the converter's range, shape (n,)."""
    in_range: Mask = loads.capacitance_pf.max(axis=1) < _FULL_SCALE_PF
    return in_range


def _judged(fit: CalibrationResult) -> dict[str, float]:
    """Return the distance of a calibration's loads, and whether the calibration would warn of it or refuse it."""
    distance = fit.median_mahalanobis_distance
    try:
        require_plausible(fit)
    except CalibrationError:
        refused = True
    else:
        refused = False
    warned = not refused and distance > WARNING_MEDIAN_MAHALANOBIS_DISTANCE
    return {"distance": round(distance, 3), "warned": warned, "refused": refused}


def _errors(reference_n: Vector, true_n: Vector, force_n: Vector) -> dict[str, float] | None:
    """Return mean errors against the reference and truth of forces, NaN where there is none; None if all are NaN."""
    usable = np.isfinite(force_n).all(axis=1)
    if not usable.any():
        return None
    by_reference, by_truth = (
        evaluate_force_errors(one_n[usable], force_n[usable]) for one_n in (reference_n, true_n)
    )
    return {
        "deg": round(by_reference.direction_deg, 4),
        "gf": round(by_reference.magnitude_gf, 4),
        "true_deg": round(by_truth.direction_deg, 4),
        "true_gf": round(by_truth.magnitude_gf, 4),
        "no_force": round(float(1.0 - usable.mean()), 4),
    }
