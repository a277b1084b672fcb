"""Study `tracker`: whether least squares on the window or a Kalman filter improves on the network.

Nothing of it is in the daemon: it would be if a method took a third off the error within the time of a conversion.
"""

from collections.abc import Callable
from dataclasses import dataclass
from timeit import repeat
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d

from footsense.foot.directions import angles_between_deg
from footsense.foot.specimen import ContactLoads
from footsense.frames import LEGS, Mask, Vector
from footsense.lab.evaluation.contact_filter import ContactFilter
from footsense.lab.evaluation.contact_model import ContactMeasurementModel
from footsense.lab.evaluation.window_fit import fit_force_and_sigma, is_steady
from footsense.lab.former_page import Plots, Study, StudyContext
from footsense.lab.studies.accuracy.gaits import (
    MIN_DIRECTION_FORCE_N,
    TEST_GAIT_SEED,
    estimate_in_batches,
    held_out_walks,
    leg_loads_function,
)
from footsense.lab.training.gait_readings import (
    NOMINAL_SEND_DELAY_S,
    STEP_S,
    GaitReadings,
    ReadingConditions,
    concatenate_gaits,
    conversion_elements,
    simulate_gait_readings,
)
from footsense.lab.training.gait_windows import GaitWindows, complete_window_ends, windows_of
from footsense.lab.training.random_gait import RandomGait
from footsense.ports import LoadEstimate, Window

#: Random gaits, rows of steps, and conversions of each gait.
N_RANDOM, N_STEPS, CONVERSIONS = 80, 8, 600
_N_QUICK, _QUICK_CONVERSIONS = 2, 150
#: Steps: rise, time on the ground and in the air [s], force [N].
RISE_S, _ON_S, STEP_N = 0.005, 0.2, 1.0
#: Conversions of a contact that counts as older; sigma and time [s] that an error may not exceed.
SETTLED_CONTACT_CONVERSIONS, LARGE_ERROR_SIGMAS, MAX_ERROR_DURATION_S = 19, 5.0, 0.03
#: The rule: part of the error that has to go [1], on these loads, and longest time of a conversion of six legs [us].
REQUIRED_ERROR_REDUCTION_REL, MAX_CONVERSION_US = 1.0 / 3.0, 250.0
LOADS = ("random gaits", "measured walk", "tripod", "steps of 5 ms")
#: Methods: the network alone, fits, filters.
NETWORK, ONE, TWO, RESTING = "network", "one round", "two rounds", "two rounds, at rest"
FILTER, BOTH = "filter", "filter and network"
#: Least force of the network at which windows are fitted [N].
_MIN_FIT_FORCE_N = 0.03
#: Sigma of the filter in the weighed mean, over its own [1]: its errors and those of the network are alike.
_FILTER_SIGMA_FACTOR = 1.5
#: Calls of which the median time counts.
_N_TIMED_CALLS = 140

_Parts = TypeVar("_Parts", Window, LoadEstimate)


@dataclass(frozen=True, slots=True)
class MethodErrors:
    """Force errors of one method on one kind of load, from `MIN_DIRECTION_FORCE_N` on.

    Attributes:
        load_name: The load.
        method: The method.
        mean_direction_error_deg: Direction error, mean [deg].
        direction_error_p95_deg: The same, 95th percentile [deg].
        component_rms_errors_mn: Error of the force's components, rms [mN], shape (3,).
        within_2_sigma_share: Share of the components within two sigma [1].
        n_long_errors: Errors over five sigma that last longer than 30 ms.
    """

    load_name: str
    method: str
    mean_direction_error_deg: float
    direction_error_p95_deg: float
    component_rms_errors_mn: list[float]
    within_2_sigma_share: float
    n_long_errors: int


@dataclass(frozen=True, slots=True)
class Results:
    """Results of the study `tracker`: force errors and computing times of network, fits and filter.

    Attributes:
        n_random_gaits: Random gaits.
        errors: Errors by load and method.
        six_legs_us: Time of a conversion of six legs by method, the network included, median [us].
        steady_loaded_window_share: Share of the loaded windows at rest [1].
    """

    n_random_gaits: int
    errors: list[MethodErrors]
    six_legs_us: dict[str, float]
    steady_loaded_window_share: float


class _ForceEstimate(NamedTuple):
    """Estimated forces and their sigma [N], shapes (n, 3)."""

    force_n: Vector
    sigma_n: Vector


def _step_loads(rng: np.random.Generator) -> Callable[[Vector], ContactLoads]:
    """Return a function from times [s] to random loads that switch on and off."""
    around = rng.uniform(0.0, 2.0 * np.pi)

    def loads(t_s: Vector) -> ContactLoads:
        """Return the loads at the given times [s]."""
        rise = np.clip((t_s % (2.0 * _ON_S) - _ON_S) / RISE_S, 0.0, 1.0)
        normal, direction = (
            np.array([np.sin(lean) * np.cos(around), np.sin(lean) * np.sin(around), np.cos(lean)])
            for lean in np.radians([10.0, 20.0])
        )
        return ContactLoads(np.tile(normal, (len(t_s), 1)), STEP_N * rise[:, None] * direction)

    return loads


def _readings(context: StudyContext) -> tuple[GaitReadings, list[str]]:
    """Return the readings of all gaits, with the index of each gait's kind of load."""
    n_random, n = (_N_QUICK, _QUICK_CONVERSIONS) if context.quick else (N_RANDOM, CONVERSIONS)
    sources: list[tuple[str, Callable[[Vector], ContactLoads], np.random.Generator]] = []
    for own in np.random.SeedSequence(TEST_GAIT_SEED).spawn(n_random):
        rng = np.random.default_rng(own)
        sources.append((LOADS[0], RandomGait(rng, context.foot_design.loads.max_n, n * STEP_S).loads, rng))
    for name, walk in zip(LOADS[1:3], held_out_walks(), strict=True):
        sources += [
            (name, leg_loads_function(walk, leg), np.random.default_rng((TEST_GAIT_SEED, k)))
            for k, leg in enumerate(LEGS)
        ]
    for k in range(N_STEPS):
        rng = np.random.default_rng((TEST_GAIT_SEED, N_STEPS + k))
        sources.append((LOADS[3], _step_loads(rng), rng))
    gaits = [
        simulate_gait_readings(context.response, loads, ReadingConditions(), rng, n)
        for _, loads, rng in sources
    ]
    return concatenate_gaits(gaits), [name for name, _, _ in sources]


def _select_rows(parts: _Parts, chosen: NDArray[Any]) -> _Parts:
    """Return the selected rows of every array in a window or load."""
    return type(parts)(*(part[chosen] for part in parts))


def _fit_windows(
    model: ContactMeasurementModel, window: Window, network: LoadEstimate
) -> tuple[dict[str, _ForceEstimate], Mask]:
    """Return by method the fits' estimates (the network's for unloaded windows), and the mask of steady windows."""
    loaded = np.linalg.norm(network.force_n, axis=1) > _MIN_FIT_FORCE_N
    rest = loaded & is_steady(model, window)
    answers = {}
    for name, rounds, where in ((ONE, 1, loaded), (TWO, 2, loaded), (RESTING, 2, rest)):
        answers[name] = _ForceEstimate(network.force_n.copy(), network.sigma_n.copy())
        found = fit_force_and_sigma(model, _select_rows(window, where), _select_rows(network, where), rounds)
        for part, own in zip(answers[name], found, strict=True):
            part[where] = own
    return answers, rest


def _run_filter(
    model: ContactMeasurementModel, readings: GaitReadings, is_complete: Mask, network: LoadEstimate
) -> _ForceEstimate:
    """Return the Kalman filter's estimates after every conversion with a complete window."""
    n_gaits, n = is_complete.shape
    by_time = [np.zeros((n_gaits, n, part.shape[1])) for part in network]
    for part, values in zip(by_time, network, strict=True):
        part[is_complete] = values
    force_n, sigma_n = np.zeros((2, n_gaits, n, 3))
    tracker = ContactFilter(model, n_gaits, STEP_S, NOMINAL_SEND_DELAY_S)
    for k, element in enumerate(conversion_elements(0, n).tolist()):
        tracker.update(element, readings.closure_rel[:, k].astype(np.float64))
        tracker.restart_where_inconsistent(LoadEstimate(*(part[:, k] for part in by_time)), is_complete[:, k])
        force_n[:, k], sigma_n[:, k] = tracker.force_and_sigma_n()
    return _ForceEstimate(force_n[is_complete], sigma_n[is_complete])


def _variance_weighted_mean(filtered: _ForceEstimate, network: LoadEstimate) -> _ForceEstimate:
    """Return the inverse-variance weighted mean of filter and network, with the smaller sigma."""
    sigma_n = _FILTER_SIGMA_FACTOR * filtered.sigma_n
    share = network.sigma_n**2 / (network.sigma_n**2 + sigma_n**2)
    return _ForceEstimate(
        share * filtered.force_n + (1.0 - share) * network.force_n, np.minimum(sigma_n, network.sigma_n)
    )


def _n_long_runs(beyond: Mask) -> int:
    """Return the number of runs of true values that last longer than `MAX_ERROR_DURATION_S`."""
    edges = np.diff(np.pad(beyond, ((0, 0), (1, 1))).astype(int), axis=1)
    lasting = np.argwhere(edges < 0)[:, 1] - np.argwhere(edges > 0)[:, 1]
    return int((lasting * STEP_S > MAX_ERROR_DURATION_S).sum())


def _method_errors(
    load: str,
    method: str,
    estimate: _ForceEstimate,
    windows: GaitWindows,
    is_complete: Mask,
    is_evaluated: Mask,
) -> MethodErrors:
    """Return the errors of one method over the evaluated windows of one kind of load."""
    off_n = estimate.force_n - windows.force_n
    sigmas = np.abs(off_n / estimate.sigma_n)
    beyond = np.zeros(is_complete.shape, bool)
    beyond[is_complete] = is_evaluated & (sigmas > LARGE_ERROR_SIGMAS).any(axis=1)
    direction_deg = angles_between_deg(estimate.force_n[is_evaluated], windows.force_n[is_evaluated])
    return MethodErrors(
        load_name=load,
        method=method,
        mean_direction_error_deg=float(direction_deg.mean()),
        direction_error_p95_deg=float(np.percentile(direction_deg, 95)),
        component_rms_errors_mn=(1e3 * np.sqrt((off_n[is_evaluated] ** 2).mean(axis=0))).tolist(),
        within_2_sigma_share=float((sigmas[is_evaluated] < 2.0).mean()),
        n_long_errors=_n_long_runs(beyond),
    )


def _six_leg_times_us(
    context: StudyContext, model: ContactMeasurementModel, six: Window, conversions: NDArray[Any]
) -> dict[str, float]:
    """Return by method the median computing time of one conversion of six legs, network included [us].

    Args:
        context: The network.
        model: Model of the readings.
        six: Windows of six legs under load.
        conversions: Closures that six legs read one after the other [1], shape (6, conversions).
    """
    network = context.network.estimate(six)
    tracker = ContactFilter(model, len(LEGS), STEP_S, NOMINAL_SEND_DELAY_S)
    following = iter(zip(conversion_elements(0, conversions.shape[1]).tolist(), conversions.T, strict=True))

    def track() -> None:
        """Update the Kalman filters of six legs by one conversion."""
        tracker.update(*next(following))
        tracker.restart_where_inconsistent(network, np.zeros(len(LEGS), bool))
        tracker.force_and_sigma_n()

    calls: list[Callable[[], object]] = [
        lambda: context.network.estimate(six),
        lambda: fit_force_and_sigma(model, six, network, 1),
        lambda: fit_force_and_sigma(model, six, network, 2),
        track,
    ]
    network_us, *added_us = (
        1e6 * float(np.median(repeat(call, number=1, repeat=_N_TIMED_CALLS))) for call in calls
    )
    one, two, tracked = (network_us + us for us in added_us)
    return {NETWORK: network_us, ONE: one, TWO: two, RESTING: two, FILTER: tracked, BOTH: tracked}


def direction_error_reductions_rel(errors: list[MethodErrors], method: str) -> list[float]:
    """Return by what share a method lowers the network's direction error on each of `LOADS` [1]."""
    found = {(one.load_name, one.method): one.mean_direction_error_deg for one in errors}
    return [1.0 - found[load, method] / found[load, NETWORK] for load in LOADS]


def n_long_errors(errors: list[MethodErrors], method: str) -> int:
    """Return the number of long-lasting errors of a method over all of `LOADS`."""
    return sum(one.n_long_errors for one in errors if one.method == method and one.load_name in LOADS)


def meets_adoption_criteria(results: Results, method: str) -> bool:
    """Return whether a method improves enough on the network to be adopted."""
    gained = min(direction_error_reductions_rel(results.errors, method)) >= REQUIRED_ERROR_REDUCTION_REL
    return (
        gained
        and results.six_legs_us[method] <= MAX_CONVERSION_US
        and not n_long_errors(results.errors, method)
    )


def compute(context: StudyContext) -> tuple[Results, Plots]:
    """Return errors and times of network, least-squares fits and Kalman filter on the same windows."""
    model = ContactMeasurementModel(context.response)
    readings, names = _readings(context)
    windows, whole = windows_of(readings), complete_window_ends(readings)
    window = Window(windows.closure_rel, windows.age_s, np.zeros((len(windows.gait), 9), bool))
    network = estimate_in_batches(context, window)
    context.report_progress("tracker: gaits read")
    fits, rest = _fit_windows(model, window, network)
    context.report_progress("tracker: windows fitted")
    filtered = _run_filter(model, readings, whole, network)
    context.report_progress("tracker: gaits tracked")
    answers = {
        NETWORK: _ForceEstimate(*network[:2]),
        **fits,
        FILTER: filtered,
        BOTH: _variance_weighted_mean(filtered, network),
    }
    loaded = np.linalg.norm(windows.force_n, axis=1) > MIN_DIRECTION_FORCE_N
    judged = {name: loaded & (np.array(names)[windows.gait] == name) for name in LOADS}
    in_contact = readings.true_force_at_sending_n.any(axis=2).astype(int)
    older = (
        minimum_filter1d(
            in_contact,
            SETTLED_CONTACT_CONVERSIONS,
            axis=1,
            origin=SETTLED_CONTACT_CONVERSIONS // 2,
            mode="constant",
        )[whole]
        > 0
    )
    random, walked = judged[LOADS[0]], np.flatnonzero(judged[LOADS[1]])
    judged |= {"random gaits, older contact": random & older, "random gaits, at rest": random & rest}
    errors = [
        _method_errors(load, method, answer, windows, whole, where)
        for load, where in judged.items()
        if where.any()
        for method, answer in answers.items()
    ]
    six = _select_rows(window, walked[np.linspace(0, len(walked) - 1, len(LEGS)).astype(int)])
    conversions = readings.closure_rel[np.array(names) == LOADS[1]].astype(np.float64)
    return Results(
        n_random_gaits=names.count(LOADS[0]),
        errors=errors,
        six_legs_us=_six_leg_times_us(context, model, six, conversions),
        steady_loaded_window_share=float(rest[random].mean()),
    ), {}


STUDY = Study(name="tracker", title="Beyond the network: fits and filters", compute=compute)
