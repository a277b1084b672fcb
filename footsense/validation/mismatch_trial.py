"""Calibrate and test one simulated foot whose physics differ from the model that the calibration assumes.

The truth is a response table of its own and disturbances of foot, test stand and floor. The chain is the shipped one:
readings of a press's dwell, fit, network, residual test. The bytes of the chips are left out: twenty feet of the study
`experiment` take as long as the whole matrix.
"""

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from firmware_interface.chips import fdc1004
from footsense.calibration.calibrate import (
    WARNING_MEDIAN_MAHALANOBIS_DISTANCE,
    CalibrationResult,
    fit_foot_unchecked,
    require_plausible,
)
from footsense.calibration.evaluation import DesignModels, Estimates
from footsense.calibration.loads import LoadSet
from footsense.calibration.rubber_memory import correct_baselines_for_creep
from footsense.errors import CalibrationError
from footsense.estimation.elements import ConsistencyTest
from footsense.estimation.missing_elements import Imputation
from footsense.foot.directions import normalized, rotation
from footsense.foot.force_errors import GRAM_FORCE_N, evaluate_force_errors
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import ContactLoads, Deviations, Foot
from footsense.frames import ELEMENTS, Mask, Vector
from footsense.sim.fabrication import REMOUNT_RMS_DEG, FootTolerances, draw_deviations, with_new_mounting
from footsense.sim.loads.press_sequence import paper_presses
from footsense.sim.reference_sensor import (
    RESOLUTION_GF,
    draw_nonlinearity_amplitude_gf,
    nonlinearity_gf,
)
from footsense.sim.rubber import ViscoelasticRubber

if TYPE_CHECKING:
    from footsense.foot.parameters import FootParameters

#: Times of a press [s]: rise or fall, dwell, pause.
_RISE_S, _DWELL_S, _PAUSE_S = 0.05, 0.5, 0.5
#: Noise of a mean reading, of one reading and of a baseline [pF].
_MEAN_PF, _ONE_PF, _BASELINE_PF = 0.15e-3, 0.5e-3, 0.2e-3
#: Noise of a mean force over the reference's resolution, as the session finds it [1].
_PRESS_MEAN_NOISE_STEPS = 0.07
_FULL_SCALE_PF = fdc1004.capacitance_pf(fdc1004.CODE_MAX)
#: Time after which the residual test acts on what it sees [ns].
_RESIDUAL_TEST_DEBOUNCE_NS = 100_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbance:
    """Differences of foot, test stand and ground from what the calibration assumes.

    Attributes:
        sheet_rotation_deg: Turn of the sheet about the axis of the balls [deg].
        worn_cap_height_mm: Height of the cap that the ball has lost at its pole [mm].
        creep_factor: Creep over that assumed [1].
        hysteresis_factor: Play over that assumed [1].
        max_ground_capacitance_pf: Largest capacitance that the floor adds to every element of a foot in contact
            [pF]; a foot has between a quarter of it and all of it. The stick of the test stand adds none.
        cable_noise_pf: Noise of the cables in motion, rms, the same during one dwell [pF].
        reference_nonlinearity_rel: Nonlinearity of the reference over its rated value [1].
        press_mean_noise_rms_steps: Scatter of a press's mean force, rms, over the reference's resolution [1].
        press_lean_rms_deg: Angle between the contact's normal and the force of a press of the calibration, rms [deg].
        has_fringe_field: Whether the electrodes have a fringe field at their edges.
    """

    sheet_rotation_deg: float = 0.0
    worn_cap_height_mm: float = 0.0
    creep_factor: float = 1.0
    hysteresis_factor: float = 1.0
    max_ground_capacitance_pf: float = 0.0
    cable_noise_pf: float = 0.0
    reference_nonlinearity_rel: float = 0.0
    press_mean_noise_rms_steps: float = 0.07
    press_lean_rms_deg: float = 1.0
    has_fringe_field: bool = False


#: As the calibration supposes.
UNDISTURBED = Disturbance()


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialPlan:
    """Fabrication tolerances, seed, calibration presses and test loads of the mismatch trials.

    Attributes:
        tolerances: Fabrication tolerances.
        seed: Seed of all feet.
        every_nth_press: Use one of so many of the paper's 362 presses.
        n_loads_of_small_calibration: Loads of a second calibration; 0 for none.
        test_loads_by_name: Test loads by name.
    """

    tolerances: FootTolerances
    seed: int
    every_nth_press: int = 3
    n_loads_of_small_calibration: int = 20
    test_loads_by_name: dict[str, ContactLoads] = field(default_factory=dict)


class _FootOnTestStand:
    """Simulated foot with viscoelastic rubber on a test stand, pressed load after load.

    Args:
        response: Its response.
        own: Its deviations.
        disturbance: Its disturbances.
        rng: Source of the noise.
    """

    def __init__(
        self, response: FootResponse, own: Deviations, disturbance: Disturbance, rng: np.random.Generator
    ) -> None:
        self._foot, self._mount, self._disturbance, self._rng = (
            Foot(response, own),
            own.mount,
            disturbance,
            rng,
        )
        self._flat_sine = 1.0 - disturbance.worn_cap_height_mm / response.ball_radius_mm
        self._min_sine = np.sin(np.radians(response.min_elevation_deg))
        self._bow_gf = draw_nonlinearity_amplitude_gf(rng, disturbance.reference_nonlinearity_rel)
        self._touchdown_pf = (
            disturbance.max_ground_capacitance_pf * rng.uniform(0.25, 1.0) * rng.uniform(0.7, 1.0, ELEMENTS)
        )

    def press(self, loads: ContactLoads, noise_pf: float, *, on_floor: bool) -> LoadSet:
        """Return the readings under loads, each pressed for a dwell and released.

        Args:
            loads: The loads.
            noise_pf: Noise of a reading [pF].
            on_floor: Whether the floor adds its capacitance.
        """
        rubber = ViscoelasticRubber(self._disturbance.creep_factor, self._disturbance.hysteresis_factor)
        step_ns = [round(1e9 * part) for part in (_PAUSE_S, _RISE_S, _DWELL_S / 2, _DWELL_S / 2, _RISE_S)]
        t_ns, normals, forces = 0, [], []
        for normal, force_n in zip(self._contact_normals(loads.normal), loads.force_n, strict=True):
            for duration_ns, share in zip(step_ns, (0.0, 1.0, 1.0, 1.0, 0.0), strict=True):
                t_ns += duration_ns
                effective = rubber.next_effective_load(t_ns, normal, share * force_n)
                normals.append(effective[0])
                forces.append(effective[1])
        pf = self._foot.capacitance_pf(np.array(normals), np.array(forces)).reshape(-1, 5, ELEMENTS)
        noise = self._rng.normal(size=(4, len(pf), ELEMENTS))
        at_pf = pf[:, 2] + noise_pf * noise[0] + self._disturbance.cable_noise_pf * noise[1]
        return LoadSet(
            force_n=self._reference_reading_n(loads.force_n, noise[3, :, :3]),
            sigma_n=np.full(loads.force_n.shape, _PRESS_MEAN_NOISE_STEPS * RESOLUTION_GF * GRAM_FORCE_N),
            capacitance_pf=at_pf + (self._touchdown_pf if on_floor else 0.0),
            baseline_pf=pf[:, 0] + _BASELINE_PF * noise[2],
        )

    def _contact_normals(self, normal: Vector) -> Vector:
        """Return the contact normals, shape (n, 3); on a worn ball those inside the flat move to its edge.

        A flat of radius a under a force f has its pressure in the middle only for tilts below f / (4/3 E* a^2), half
        a degree at 1 N: the centre of pressure of all others lies at its edge.
        """
        inside = normal @ self._mount.T
        lowered = inside.copy()
        flat = inside[:, 2] > self._flat_sine
        across = inside[flat, :2] / np.maximum(np.linalg.norm(inside[flat, :2], axis=1, keepdims=True), 1e-12)
        lowered[flat, :2] = np.sqrt(1.0 - self._flat_sine**2) * across
        lowered[flat, 2] = self._flat_sine
        low = lowered[:, 2] < self._min_sine
        lowered[low, :2] *= (
            np.sqrt(1.0 - self._min_sine**2) / np.linalg.norm(lowered[low, :2], axis=1)[:, None]
        )
        lowered[low, 2] = self._min_sine
        return normalized(lowered) @ self._mount

    def _reference_reading_n(self, force_n: Vector, unit_noise: Vector) -> Vector:
        """Return the reference sensor's readings under forces [N], shape (n, 3), with nonlinearity and noise."""
        load_gf = -force_n / GRAM_FORCE_N
        read_gf = load_gf + nonlinearity_gf(self._bow_gf, load_gf)
        read_gf += self._disturbance.press_mean_noise_rms_steps * RESOLUTION_GF * unit_noise
        return -read_gf * GRAM_FORCE_N


def run_mismatch_trial(
    models: DesignModels, truth: FootResponse, disturbance: Disturbance, plan: TrialPlan, number: int
) -> dict[str, float]:
    """Calibrate one foot whose physics differ from the model; return its force errors by name.

    Args:
        models: Models that the calibration knows.
        truth: The foot's true response.
        disturbance: Its true disturbances.
        plan: Feet and loads.
        number: Number of the foot.

    Returns:
        For each calibration, `all` and `few`: `refused_<c>` 0 or 1, `distance_<c>`, `said_<c>` 1 if `calibrate` says
        that this distance is more than usual; for each of these and `design`, and each test: `<test>_<c>_deg` and
        `_gf` against truth, `_within_2` the share of components within two sigma, `_unread` of the loads without a
        force, `_unexplained` of those that the residual test finds inconsistent.
    """
    rng = np.random.default_rng((plan.seed, number, 4))
    own = draw_deviations(truth, plan.tolerances, plan.seed, number)
    turned = rotation(np.array([0.0, 0.0, np.radians(disturbance.sheet_rotation_deg)]))
    own = Deviations(
        **{name: getattr(own, name) for name in ("gap_um", "film_um", "stray_pf", "stiffness_rel")},
        mount=turned @ own.mount,
        fringe=disturbance.has_fringe_field,
    )
    foot = _FootOnTestStand(truth, own, disturbance, rng)
    force_n = paper_presses("training")[:: plan.every_nth_press]
    direction = normalized(force_n)
    lean = (
        np.radians(disturbance.press_lean_rms_deg)
        * np.sqrt(0.5)
        * np.cross(rng.normal(size=direction.shape), direction)
    )
    pressed = foot.press(ContactLoads(normalized(direction + lean), force_n), _MEAN_PF, on_floor=False)
    rested = correct_baselines_for_creep(models.response, pressed)
    loads = rested.subset(_is_in_converter_range(rested))
    parameters_by_calibration: dict[str, FootParameters | None] = {"design": None}
    figures: dict[str, float] = {}
    for name, used in {
        "all": loads,
        "few": loads.subset(loads.space_filling_order()[: plan.n_loads_of_small_calibration]),
    }.items():
        if len(used) == 0:
            continue
        fit = fit_foot_unchecked(models, used)
        parameters_by_calibration[name] = fit.parameters
        figures |= {
            f"refused_{name}": float(_is_refused(fit)),
            f"distance_{name}": fit.median_mahalanobis_distance,
            f"said_{name}": float(fit.median_mahalanobis_distance > WARNING_MEDIAN_MAHALANOBIS_DISTANCE),
        }
    again = with_new_mounting(own, REMOUNT_RMS_DEG, plan.seed, number, 2)
    remade = _FootOnTestStand(truth, again, disturbance, np.random.default_rng((plan.seed, number, 5)))
    for test, test_loads in plan.test_loads_by_name.items():
        read = remade.press(test_loads, _ONE_PF, on_floor=True)
        # A robot tares rested feet, and its baseline hardly moves in the time of these loads.
        read = replace(read, baseline_pf=np.tile(read.baseline_pf[0], (len(read), 1)))
        for name, parameters in parameters_by_calibration.items():
            estimates = models.estimate(read, parameters)
            estimates.force_n[~_is_in_converter_range(read)] = np.nan
            judged = _force_error_figures(models, estimates, test_loads.force_n)
            figures |= {f"{test}_{name}_{figure}": value for figure, value in judged.items()}
    return figures


def _is_in_converter_range(loads: LoadSet) -> Mask:
    """Return the mask of the loads whose capacitances are within the converter's range, shape (n,)."""
    in_range: Mask = loads.capacitance_pf.max(axis=1) < _FULL_SCALE_PF
    return in_range


def _is_refused(fit: CalibrationResult) -> bool:
    """Return whether `footsense calibrate` would refuse this calibration."""
    try:
        require_plausible(fit)
    except CalibrationError:
        return True
    return False


def _force_error_figures(models: DesignModels, estimates: Estimates, true_n: Vector) -> dict[str, float]:
    """Return error figures of the estimated against the true forces [N], by name."""
    usable = estimates.has_force
    if not usable.any():
        return {"deg": np.nan, "gf": np.nan, "within_2": np.nan, "unread": 1.0, "unexplained": np.nan}
    force_n, true_n, sigma_n = estimates.force_n[usable], true_n[usable], estimates.sigma_n[usable]
    row = evaluate_force_errors(true_n, force_n)
    imputation = Imputation(models.network_for_rows(1).card.trained_inputs.moments)
    test = ConsistencyTest(len(force_n), imputation, _RESIDUAL_TEST_DEBOUNCE_NS)
    closure_rel, missing = estimates.closure_rel[usable], np.zeros((len(force_n), ELEMENTS), bool)
    for t_ns in range(0, 2 * _RESIDUAL_TEST_DEBOUNCE_NS, _RESIDUAL_TEST_DEBOUNCE_NS // 4):
        consistency: Any = test.test(closure_rel, np.zeros(len(force_n)), missing, t_ns)
    noticed = test.unexplained_legs | consistency.missing.any(axis=1)
    return {
        "deg": row.direction_deg,
        "gf": row.magnitude_gf,
        "within_2": float((np.abs(force_n - true_n) <= 2.0 * sigma_n).mean()),
        "unread": float(1.0 - usable.mean()),
        "unexplained": float(noticed.mean()),
    }
