"""Age of the published forces against their error, over the service's whole chain.

Walks, steps and ramps of feet are converted at the service's pace (`conversions.py`), its network makes forces of the
readings, and a consumer holds the last force that it received. Beside the service's method stand simpler ones, and
other rates of conversions and of publishing.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from firmware_interface.conversion_order import CONVERSION_ORDERS
from firmware_interface.wire_timing import FRAMES_PER_LEG, LONGEST_FRAME_BITS
from footsense.benchmarks.conversions import (
    FootLoad,
    PublishedForces,
    conversion_timing,
    estimate_forces,
    simulate_conversions,
    true_normals_and_forces_n,
)
from footsense.config import SMALL_BOARD
from footsense.foot.directions import angles_between_deg
from footsense.foot.specimen import Specimen
from footsense.frames import ELEMENTS, LEGS, Stamps, Vector
from footsense.sim.loads.ground_load import GroundContact, RampContact
from footsense.sim.loads.walk import Walk, measured_walk, smooth_stance_reaction

if TYPE_CHECKING:
    from footsense.lab.report import StudyContext

#: Largest vertical force of a walk [N] and lean of its legs [deg].
PEAK_N, PITCH_DEG = 1.0, 10.0
#: Forces of steps and ramps [N], and their rise times [ns].
PRESS_FORCES_N = ((0.0, 0.0, 0.8), (0.2, 0.1, 0.7), (-0.25, 0.1, 0.6), (0.1, -0.3, 0.7))
STEP_NS, RAMP_NS = 5_000_000, 200_000_000
#: Start of the counted time of a walk: the windows have filled by then [ns].
_WALK_EVALUATION_START_NS = 1_100_000_000
#: Start of the counted time of steps and ramps, start of the first load, end of the counted time [ns].
_COUNT_FROM_NS, _PRESS_NS, _COUNT_TO_NS = 200_000_000, 300_000_000, 800_000_000
#: Strides of the measured walk and of the tripod gait [ns].
_MEASURED_NS, _TRIPOD_NS = 1_145_000_000, 1_200_000_000
_DUTY_FACTOR = 0.6
_ROTATION_90_DEG = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
#: Load of the standing feet of which the noise is measured [N].
STANDING_FORCE_N = (0.1, 0.05, 0.5)

#: True force from which a direction is defined, and from which a foot is in contact [N].
LOADED_THRESHOLD_N, CONTACT_THRESHOLD_N = 0.1, 0.02
#: Multiples of sigma of which the coverage is counted.
SIGMA_MULTIPLES = (1, 2, 3, 5)
#: Period at which a consumer reads the last force [ns].
TRUTH_SAMPLE_PERIOD_NS = 1_000_000
#: Shifts of the truth in the search for the lag [ms]: later, for a force that runs ahead, and earlier.
_AHEAD_MS, _BEHIND_MS = 30, 600

#: Conversions for each published force: all, the service's default, and one force for each scan.
CONVERSIONS_PER_PUBLISHED_FORCE = (1, SMALL_BOARD.effective_publish_every, ELEMENTS)
#: Publishing methods by name: degree of the extrapolation, conversions for each force, and orders of the scan.
METHODS: dict[str, tuple[int | None, int, tuple[str, ...]]] = {
    "every conversion": (None, 1, ("raster", "lo_shu")),
    **{f"every {n}th": (None, n, ("lo_shu",)) for n in CONVERSIONS_PER_PUBLISHED_FORCE[1:]},
    "newest readings as they are": (0, 1, ("raster", "lo_shu")),
    "extrapolated by lines": (1, 1, ("lo_shu",)),
    "extrapolated by parabolas": (2, 1, ("lo_shu",)),
}
#: Conversions per second.
_RATES_SPS, _QUICK_RATES_SPS = (400, 200, 100), (400,)
_SEED, _OPERATING_POINT_SEED = 3, 5


@dataclass(frozen=True, slots=True, eq=False)
class TrueLoads:
    """True forces on some feet [N], sampled every `TRUTH_SAMPLE_PERIOD_NS`.

    Attributes:
        feet: Load of each foot.
        evaluation_start_ns: Start of the time in which errors count [ns].
        evaluation_end_ns: End of it [ns].
        sampled_force_n: Forces at every `TRUTH_SAMPLE_PERIOD_NS` from time 0 to 30 ms after the end [N], shape
            (times, feet, 3).
    """

    feet: Sequence[FootLoad]
    evaluation_start_ns: int
    evaluation_end_ns: int
    sampled_force_n: Vector

    @classmethod
    def sample(cls, feet: Sequence[FootLoad], start_ns: int, end_ns: int) -> "TrueLoads":
        """Return the true forces of some feet between two times [ns], sampled regularly."""
        read_ns = np.arange(0, end_ns + _AHEAD_MS * 1_000_000, TRUTH_SAMPLE_PERIOD_NS)
        return cls(feet, start_ns, end_ns, true_normals_and_forces_n(feet, read_ns)[1])


class _LoadCase(NamedTuple):
    title: str
    truth: TrueLoads
    load_starts_ns: tuple[int, ...] | None = None  # None for a walk


def _walk_loads(
    walk: Callable[[int], Walk], period_ns: int, strides: int, *, sideways: bool = False
) -> TrueLoads:
    """Return the true loads of six feet in a steady walk, each at another phase of the stride."""
    feet: list[FootLoad] = []
    for number, leg in enumerate(LEGS):
        contact = partial(walk(-4 * period_ns - number * period_ns // len(LEGS)).contact, leg)
        feet.append(partial(_contact_turned_left, contact) if sideways else contact)
    return TrueLoads.sample(feet, _WALK_EVALUATION_START_NS, _WALK_EVALUATION_START_NS + strides * period_ns)


def _contact_turned_left(contact: FootLoad, t_ns: int) -> GroundContact:
    """Return a foot's ground contact rotated 90 degrees to the left, as in a sideways walk."""
    return GroundContact(*(_ROTATION_90_DEG @ vector for vector in contact(t_ns)))


def _press_case(title: str, rise_ns: int, n_phases: int) -> _LoadCase:
    """Return the true loads of feet pressed in several directions, at several phases of the scan."""
    scan_ns = ELEMENTS * conversion_timing(400).step_ns
    cases = [
        (force_n, _PRESS_NS + phase * scan_ns // n_phases)
        for force_n, phase in product(PRESS_FORCES_N, range(n_phases))
    ]
    feet = [partial(RampContact(force_n, start_ns, rise_ns).contact, LEGS[0]) for force_n, start_ns in cases]
    truth = TrueLoads.sample(feet, _COUNT_FROM_NS, _COUNT_TO_NS)
    return _LoadCase(title, truth, tuple(start_ns for _, start_ns in cases))


def _load_cases(strides: int, phases: int) -> dict[str, _LoadCase]:
    """Return the loads by name, with that many counted strides and phases of a scan at which a foot is pressed."""
    reactions = dict.fromkeys(LEGS, smooth_stance_reaction(_DUTY_FACTOR, PEAK_N, 0.15))
    tripod = partial(Walk, reactions, _TRIPOD_NS, _DUTY_FACTOR, PITCH_DEG)
    ahead, sideways = (
        _walk_loads(partial(measured_walk, PEAK_N, PITCH_DEG), _MEASURED_NS, strides, sideways=left)
        for left in (False, True)
    )
    return {
        "measured_walk": _LoadCase("Measured walk", ahead),
        "sideways": _LoadCase("Measured walk to the left: legs lean along the columns", sideways),
        "tripod": _LoadCase("Tripod gait with rounded stances", _walk_loads(tripod, _TRIPOD_NS, strides)),
        "step": _press_case("A step: full load within 5 ms", STEP_NS, phases),
        "ramp": _press_case("A ramp: full load within 200 ms", RAMP_NS, phases),
    }


def _held_forces(published: PublishedForces, truth: TrueLoads) -> tuple[Vector, Vector, Vector]:
    """Return, at each truth sample, the last force that a consumer has received (sample and hold).

    Returns:
        Times [ms], shape (times,); held forces [N], shape (times, feet, 3); ages of their newest readings [ms].
    """
    read_ns: Stamps = np.arange(truth.evaluation_start_ns, truth.evaluation_end_ns, TRUTH_SAMPLE_PERIOD_NS)
    last = np.searchsorted(published.sent_ns, read_ns, side="right") - 1
    return read_ns / 1e6, published.force_n[last], (read_ns - published.newest_reading_ns[last]) / 1e6


def latency_and_errors(published: PublishedForces, truth: TrueLoads) -> dict[str, Any]:
    """Return latency and errors of published forces over the counted time; *held*: of the last one sent, at any time.

    Returns:
        `held_age_p50_p99_ms` of its newest reading; at the time of sending the rms errors `axis_error_rms_mn`,
        `error_norm_rms_mn`, the angle of loaded feet `direction_error_mean_p95_deg`, and the share of components, feet
        in contact, within each of `SIGMA_MULTIPLES` (`share_within_sigmas`); of the held force
        `held_error_norm_rms_mn`, `held_direction_error_mean_deg`, and `lag_ms`, the shift of the truth that fits best.
    """
    counts = (published.sent_ns >= truth.evaluation_start_ns) & (published.sent_ns < truth.evaluation_end_ns)
    true_n = true_normals_and_forces_n(truth.feet, published.sent_ns[counts])[1]
    force_n, sigma_n = published.force_n[counts], published.sigma_n[counts]
    angle_deg = _angles_deg(true_n, force_n)
    in_contact = np.linalg.norm(true_n, axis=-1) >= CONTACT_THRESHOLD_N
    error_sigmas = np.abs(force_n - true_n)[in_contact] / sigma_n[in_contact]
    read_ms, held_n, held_age_ms = _held_forces(published, truth)
    first = round(read_ms[0])
    true_read_n = truth.sampled_force_n[first : first + len(read_ms)]
    return {
        "held_age_p50_p99_ms": np.percentile(held_age_ms, (50, 99)).tolist(),
        "axis_error_rms_mn": (1e3 * np.sqrt(((force_n - true_n) ** 2).mean(axis=(0, 1)))).tolist(),
        "error_norm_rms_mn": _rms_mn(force_n - true_n),
        "direction_error_mean_p95_deg": [float(angle_deg.mean()), float(np.percentile(angle_deg, 95))],
        "held_error_norm_rms_mn": _rms_mn(held_n - true_read_n),
        "held_direction_error_mean_deg": float(_angles_deg(true_read_n, held_n).mean()),
        "share_within_sigmas": [float((error_sigmas < k).mean()) for k in SIGMA_MULTIPLES],
        "lag_ms": _lag_ms(held_n, truth.sampled_force_n, first),
    }


def _rms_mn(error_n: Vector) -> float:
    """Return the rms length of error vectors [N], shape (..., 3), in mN."""
    return 1e3 * float(np.sqrt((error_n**2).sum(axis=-1).mean()))


def _angles_deg(true_n: Vector, force_n: Vector) -> Vector:
    """Return the angle between true and estimated force of each loaded foot [deg], shape (n,)."""
    loaded = np.linalg.norm(true_n, axis=-1) >= LOADED_THRESHOLD_N
    return angles_between_deg(true_n[loaded], force_n[loaded])


def _lag_ms(held_n: Vector, sampled_n: Vector, first: int) -> float:
    """Return the time shift of the true force that best fits the received force [ms], refined by a parabola."""
    shifts = np.arange(-_AHEAD_MS, min(_BEHIND_MS, first) + 1)
    misfit = np.array(
        [((held_n - sampled_n[first - k : first - k + len(held_n)]) ** 2).mean() for k in shifts.tolist()]
    )
    best = int(np.clip(misfit.argmin(), 1, len(shifts) - 2))
    left, middle, right = misfit[best - 1 : best + 2].tolist()
    subsample_shift: float = 0.5 * (left - right) / (left - 2 * middle + right)
    return float(shifts[best]) + subsample_shift


def settling_ms(published: PublishedForces, truth: TrueLoads, starts_ns: Sequence[int]) -> Vector:
    """Return the time from load start until the received force stays within 10 % of the load [ms], shape (feet,).

    Args:
        published: Forces.
        truth: True loads, at the end of which each foot carries its full load.
        starts_ns: Start of each load [ns].
    """
    read_ms, held_n, _ = _held_forces(published, truth)
    full_n = truth.sampled_force_n[round(read_ms[-1])]
    off = np.linalg.norm(held_n - full_n, axis=-1) > 0.1 * np.linalg.norm(full_n, axis=-1)
    last = len(off) - 1 - off[::-1].argmax(axis=0)
    settled: Vector = read_ms[last] + 1.0 - np.array(starts_ns) * 1e-6
    return settled


def _by_method(load: _LoadCase, context: "StudyContext") -> Iterator[dict[str, Any]]:
    """Yield latency and errors of every publishing method under one load, and its settling time after a step."""
    foot, truth = Specimen(context.response), load.truth
    readings = {
        name: simulate_conversions(
            foot, truth.feet, CONVERSION_ORDERS[name], 400, truth.evaluation_end_ns, _SEED
        )
        for name in ("raster", "lo_shu")
    }
    for method, (degree, every, orders) in METHODS.items():
        for order in orders:
            forces = estimate_forces(readings[order], context.network, context.trained_inputs, degree)
            published, settling = forces.every_nth(every), None
            if load.load_starts_ns is not None:
                each_ms = settling_ms(published, truth, load.load_starts_ns)
                settling = [float(np.median(each_ms)), float(each_ms.max())]
            yield {
                "method": method,
                "scan_order": order,
                "errors": latency_and_errors(published, truth),
                "settling_median_max_ms": settling,
            }


def _operating_points(rate_sps: int, truth: TrueLoads, context: "StudyContext") -> Iterator[dict[str, Any]]:
    """Yield force rate, load of CAN, noise of a standing foot and errors on a walk, by conversions per force."""
    standing_feet: Sequence[FootLoad] = [
        partial(RampContact(STANDING_FORCE_N, 0).contact, leg) for leg in LEGS
    ]
    foot, order = Specimen(context.response), CONVERSION_ORDERS["lo_shu"]
    walk, standing = (
        estimate_forces(
            simulate_conversions(foot, feet, order, rate_sps, truth.evaluation_end_ns, seed),
            context.network,
            context.trained_inputs,
        )
        for seed, feet in enumerate((truth.feet, standing_feet), _OPERATING_POINT_SEED)
    )
    standing_n = standing.force_n[standing.sent_ns >= truth.evaluation_start_ns]
    for every in CONVERSIONS_PER_PUBLISHED_FORCE:
        forces_hz = 1e9 / conversion_timing(rate_sps).step_ns / every
        yield {
            "rate_sps": rate_sps,
            "publish_every": every,
            "forces_hz": forces_hz,
            "can_kbit_s": forces_hz * len(LEGS) * FRAMES_PER_LEG * LONGEST_FRAME_BITS * 1e-3,
            "standing_noise_norm_rms_mn": _rms_mn(standing_n - standing_n.mean(axis=0)),
            "walk": latency_and_errors(walk.every_nth(every), truth),
        }


def measure_latency_vs_error(context: "StudyContext") -> dict[str, Any]:
    """Return age and error of the forces, by load and method (`loads`) and by rate and publishing (`points`).

    Args:
        context: Response table and network; in the quick form one stride, two phases of a step, one rate.
    """
    strides, phases = (1, 2) if context.quick else (4, 6)
    loads, points = {}, list[dict[str, Any]]()
    cases = _load_cases(strides, phases)
    for name, load in cases.items():
        methods = list(_by_method(load, context))
        loads[name] = {"title": load.title, "n_feet": len(load.truth.feet), "methods": methods}
        context.report_progress(f"latency against error: {name}")
    for rate_sps in _QUICK_RATES_SPS if context.quick else _RATES_SPS:
        points += _operating_points(rate_sps, cases["measured_walk"].truth, context)
        context.report_progress(f"latency against error: {rate_sps} S/s")
    step_ns, send_delay_ns = conversion_timing(400)
    return {
        "conversion_period_ms": step_ns * 1e-6,
        "send_delay_ms": send_delay_ns * 1e-6,
        "strides": strides,
        "scan_phases": phases,
        "loads": loads,
        "points": points,
    }
