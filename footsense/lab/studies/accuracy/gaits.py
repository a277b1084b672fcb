"""Study `gaits`: force errors of the released network on gaits that it was not trained on.

Readings are made by the same foot response that the network was trained on, with noise and timing of the converters;
the daemon's fault detection and baselines are left out. A second truth, the whole daemon against simulated chips, is
the row *nothing* of the page of faults.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from footsense.estimation.missing_elements import Imputation
from footsense.foot.directions import angles_between_deg
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.specimen import ContactLoads
from footsense.frames import LEGS, Mask, Vector
from footsense.lab.evaluation.contact_model import normals_of_stereographic_points
from footsense.lab.evaluation.evaluate_models import HELD_OUT_SEED
from footsense.lab.former_page import Plots, Study, StudyContext
from footsense.lab.training.gait_readings import (
    STEP_S,
    GaitReadings,
    ReadingConditions,
    concatenate_gaits,
    random_gaits,
    select_gaits,
    simulate_gait_readings,
)
from footsense.lab.training.gait_windows import contact_and_normal_force, windows_of
from footsense.lab.training.load_cases import measured_closure_rel, paper_verification, random_loads
from footsense.ports import LoadEstimate, Window
from footsense.sim.loads.ground_load import ContactSource, RampContact
from footsense.sim.loads.walk import Walk, measured_walk, smooth_stance_reaction

#: Seed of the gaits that judge; training uses another.
TEST_GAIT_SEED = 990_001
#: Random gaits and conversions of each.
N_GAITS, N_QUICK, CONVERSIONS = 200, 6, 1100
#: A conversion counts as usual if its time is within this of 400 a second [1].
_NOMINAL_RATE_TOLERANCE_REL = 0.05
#: Conversions of a walk, per leg.
_WALK_CONVERSIONS = 2500
#: Least force of a direction, of a friction ratio, and least normal force of a contact normal [N].
MIN_DIRECTION_FORCE_N, MIN_FRICTION_FORCE_N, MIN_NORMAL_FORCE_N = 0.1, 0.3, 0.5
#: Windows of one call.
_WINDOWS_PER_CALL = 20_000
_WALK_START_NS = 200_000_000
#: Loads at rest.
_N_STEADY_LOADS = 6000


@dataclass(frozen=True, slots=True)
class GaitErrors:
    """Force errors of the network over all windows of one kind of gait.

    Attributes:
        name: The load.
        mean_direction_error_deg: Direction error from `MIN_DIRECTION_FORCE_N` on, mean [deg].
        direction_error_p95_deg: The same, 95th percentile [deg].
        component_rms_errors_mn: Error of the force's components, rms [mN], shape (3,).
        within_2_sigma_share: Share of the components within two sigma [1].
        beyond_5_sigma_share: Share beyond five [1].
        mean_abs_friction_ratio_error: Error of the friction ratio's size from `MIN_FRICTION_FORCE_N` on, mean [1].
        mean_contact_normal_error_deg: Error of the contact normal from `MIN_NORMAL_FORCE_N` on, mean [deg].
    """

    name: str
    mean_direction_error_deg: float
    direction_error_p95_deg: float
    component_rms_errors_mn: list[float]
    within_2_sigma_share: float
    beyond_5_sigma_share: float
    mean_abs_friction_ratio_error: float
    mean_contact_normal_error_deg: float


@dataclass(frozen=True, slots=True)
class SteadyLoadErrors:
    """Force errors under steady loads.

    Attributes:
        name: The loads.
        mean_direction_error_deg: Direction error, mean [deg].
        direction_error_p95_deg: The same, 95th percentile [deg].
        mean_magnitude_error_gf: Magnitude error, mean [gf].
    """

    name: str
    mean_direction_error_deg: float
    direction_error_p95_deg: float
    mean_magnitude_error_gf: float


@dataclass(frozen=True, slots=True)
class Results:
    """Results of the study `gaits`: force errors in gaits and under steady loads.

    Attributes:
        n_random_gaits: Random gaits.
        gaits: Errors in motion.
        steady_loads: Errors at rest.
    """

    n_random_gaits: int
    gaits: list[GaitErrors]
    steady_loads: list[SteadyLoadErrors]


class _InputFault(NamedTuple):
    """Fault put into the inputs of the network: missing elements, and random gain errors of elements [1, rms]."""

    missing: Mask
    gain_error_std_rel: float = 0.0


_NONE_MISSING = np.zeros(9, bool)
_NO_INPUT_FAULT = _InputFault(_NONE_MISSING)


def leg_loads_function(source: ContactSource, leg: str) -> Callable[[Vector], ContactLoads]:
    """Return a function from times [s] to the loads of one leg, built from a source of contacts."""

    def loads(t_s: Vector) -> ContactLoads:
        """Return the leg's loads at the given times [s]."""
        contacts = [source.contact(leg, int(t_ns)) for t_ns in (t_s * 1e9).tolist()]
        return ContactLoads(
            np.array([one.normal for one in contacts]), np.array([one.force_n for one in contacts])
        )

    return loads


def held_out_walks() -> tuple[ContactSource, ContactSource]:
    """Return the two test walks as contact sources: the measured walk and the tripod scene."""
    tripod = Walk(
        dict.fromkeys(LEGS, smooth_stance_reaction(0.6, 1.0, 0.15)),
        period_ns=1_200_000_000,
        duty_rel=0.6,
        pitch_deg=10.0,
        from_ns=_WALK_START_NS,
    )
    return measured_walk(1.0, 10.0, _WALK_START_NS), tripod


def _walk_readings(
    context: StudyContext, source: ContactSource, legs: tuple[str, ...], timing: ReadingConditions
) -> GaitReadings:
    """Return simulated readings of the given legs in a walk."""
    n = 400 if context.quick else _WALK_CONVERSIONS
    return concatenate_gaits(
        [
            simulate_gait_readings(
                context.response,
                leg_loads_function(source, leg),
                timing,
                np.random.default_rng((TEST_GAIT_SEED, k)),
                n,
            )
            for k, leg in enumerate(legs)
        ]
    )


def estimate_in_batches(context: StudyContext, window: Window) -> LoadEstimate:
    """Return the network's estimates, in batches of bounded size."""
    some = [
        slice(first, first + _WINDOWS_PER_CALL) for first in range(0, len(window.missing), _WINDOWS_PER_CALL)
    ]
    parts = [
        context.network.estimate(Window(window.closure_rel[k], window.age_s[k], window.missing[k]))
        for k in some
    ]
    return LoadEstimate(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def _gait_errors(
    context: StudyContext, name: str, gaits: GaitReadings, input_fault: _InputFault = _NO_INPUT_FAULT
) -> GaitErrors:
    """Return the network's force errors on gaits, with an optional input fault."""
    windows = windows_of(gaits)
    closure_rel, force_n, normal = windows.closure_rel, windows.force_n, windows.normal
    if input_fault.gain_error_std_rel:
        # A foot of its own for each gait.
        gains = input_fault.gain_error_std_rel * np.random.default_rng(TEST_GAIT_SEED).normal(
            size=(len(gaits.conversion_order_index), 9)
        )
        closure_rel = closure_rel * (1.0 + gains[windows.gait])[:, None]
    imputation = Imputation(context.trained_inputs.moments)
    missing = np.tile(input_fault.missing, (len(closure_rel), 1))
    closure_rel = closure_rel @ imputation.matrix(input_fault.missing).T
    load = estimate_in_batches(context, Window(closure_rel, windows.age_s, missing))
    loaded = np.linalg.norm(force_n, axis=1) > MIN_DIRECTION_FORCE_N
    error_n = (load.force_n - force_n)[loaded]
    off = np.abs(error_n / load.sigma_n[loaded])
    direction_deg = angles_between_deg(load.force_n[loaded], force_n[loaded])
    true_contact, pressing_n = contact_and_normal_force(force_n, normal)
    firm, firmer = pressing_n > MIN_FRICTION_FORCE_N, pressing_n > MIN_NORMAL_FORCE_N
    found = normals_of_stereographic_points(load.contact_point_and_friction[:, :2])
    friction = _friction_ratio(load.contact_point_and_friction[:, 2:], found) - _friction_ratio(
        true_contact[:, 2:], normal
    )
    return GaitErrors(
        name=name,
        mean_direction_error_deg=float(direction_deg.mean()),
        direction_error_p95_deg=float(np.percentile(direction_deg, 95)),
        component_rms_errors_mn=(1e3 * np.sqrt((error_n**2).mean(axis=0))).tolist(),
        within_2_sigma_share=float((off < 2.0).mean()),
        beyond_5_sigma_share=float((off > 5.0).mean()),
        mean_abs_friction_ratio_error=float(np.abs(friction[firm]).mean()),
        mean_contact_normal_error_deg=float(angles_between_deg(found[firmer], normal[firmer]).mean()),
    )


def _friction_ratio(ratio: Vector, normal: Vector) -> Vector:
    """Return tangential over normal force [1], shape (n,), from in-plane components, shape (n, 2)."""
    along = (normal[:, :2] * ratio).sum(axis=1) / normal[:, 2]
    friction_ratio: Vector = np.sqrt((ratio**2).sum(axis=1) + along**2)
    return friction_ratio


def _steady_load_errors(context: StudyContext) -> list[SteadyLoadErrors]:
    """Return the network's force errors under steady loads, each reading with independent noise."""
    response, loads = context.response, context.foot_design.loads
    rng = np.random.default_rng(HELD_OUT_SEED)
    wide = random_loads(response, loads, 500 if context.quick else _N_STEADY_LOADS, HELD_OUT_SEED)
    rows = []
    for name, cases in (("wide loads", wide), ("the paper's 180", paper_verification(response))):
        judged = np.linalg.norm(cases.force_n, axis=1) >= loads.min_evaluated_force_n
        force_n, closure_um = cases.force_n[judged], cases.closure_um[judged]
        readings = [measured_closure_rel(response.design, closure_um, rng) for _ in range(3)]
        timing = windows_of(
            _walk_readings(context, RampContact((0.0, 0.0, 0.5), 0), ("rf",), ReadingConditions())
        )
        age_s = timing.age_s[np.arange(len(force_n)) % len(timing.age_s)]
        window = Window(np.stack(readings, axis=1), age_s, np.zeros((len(force_n), 9), bool))
        found_n = estimate_in_batches(context, window).force_n
        direction_deg = angles_between_deg(found_n, force_n)
        off_n = np.abs(np.linalg.norm(found_n, axis=1) - np.linalg.norm(force_n, axis=1))
        rows.append(
            SteadyLoadErrors(
                name,
                float(direction_deg.mean()),
                float(np.percentile(direction_deg, 95)),
                float(off_n.mean()) / GRAM_FORCE_N,
            )
        )
    return rows


def compute(context: StudyContext) -> tuple[Results, Plots]:
    """Return the network's errors on random gaits, walks, walks with imperfect feet, and steady loads."""
    n_gaits = N_QUICK if context.quick else N_GAITS
    random = random_gaits(
        context.response, TEST_GAIT_SEED, n_gaits, CONVERSIONS, context.foot_design.loads.max_n
    )
    at_usual_pace = (random.conversion_order_index == 0) & (
        np.abs(random.step_s / STEP_S - 1.0) < _NOMINAL_RATE_TOLERANCE_REL
    )
    usual = select_gaits(random, at_usual_pace)
    context.report_progress("gaits: random gaits read")
    walk, tripod = held_out_walks()
    sides = ("rf", "lf")
    walked = _walk_readings(context, walk, sides, ReadingConditions())
    middle, row = np.arange(9) == 4, np.arange(9) < 3
    rows = [
        _gait_errors(context, "random gaits", usual),
        _gait_errors(context, "random gaits at another pace", select_gaits(random, ~at_usual_pace)),
        _gait_errors(context, "measured walk", walked),
        _gait_errors(context, "tripod", _walk_readings(context, tripod, ("rf",), ReadingConditions())),
        _gait_errors(
            context,
            "walk, rubber creeps and lags",
            _walk_readings(context, walk, sides, ReadingConditions(viscous_rel=1.0)),
        ),
        _gait_errors(context, "walk, middle element missing", walked, _InputFault(middle)),
        _gait_errors(context, "walk, row 0 missing", walked, _InputFault(row)),
        *(
            _gait_errors(
                context,
                f"walk, gains off by {100 * gain_rel:g} %",
                walked,
                _InputFault(_NONE_MISSING, gain_rel),
            )
            for gain_rel in (0.003, 0.01, 0.03)
        ),
        _gait_errors(context, "random gaits, gains off by 1 %", usual, _InputFault(_NONE_MISSING, 0.01)),
    ]
    context.report_progress("gaits: judged in motion")
    return Results(n_random_gaits=n_gaits, gaits=rows, steady_loads=_steady_load_errors(context)), {}


STUDY = Study(name="gaits", title="Force in motion", compute=compute, command="gaits")
