"""Age of the published forces against their error, over the service's whole chain.

A walk of six feet is converted at the service's pace (`conversions.py`), its network makes forces of the readings, and
a consumer holds the last force that it received. Beside the service's method stand simpler ones, and
other rates of conversions and of publishing.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

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
from footsense.sim.loads.ground_load import RampContact
from footsense.sim.loads.walk import measured_walk

if TYPE_CHECKING:
    from footsense.lab.report import StudyContext

#: Largest vertical force of a walk [N] and lean of its legs [deg].
PEAK_N, PITCH_DEG = 1.0, 10.0
#: Forces of steps [N], and their rise time [ns], for `settling_ms`.
PRESS_FORCES_N = ((0.0, 0.0, 0.8), (0.2, 0.1, 0.7), (-0.25, 0.1, 0.6), (0.1, -0.3, 0.7))
STEP_NS = 5_000_000
#: Start of the counted time of a walk: the windows have filled by then [ns].
_WALK_EVALUATION_START_NS = 1_100_000_000
#: Stride of the measured walk [ns].
_STRIDE_NS = 1_145_000_000
#: Load of the standing feet of which the noise is measured [N].
STANDING_FORCE_N = (0.1, 0.05, 0.5)

#: True force from which a direction is defined [N].
LOADED_THRESHOLD_N = 0.1
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


def _walk_loads(strides: int) -> TrueLoads:
    """Return the true loads of six feet in the measured walk, each at another phase of the stride."""
    feet = [
        partial(
            measured_walk(PEAK_N, PITCH_DEG, -4 * _STRIDE_NS - number * _STRIDE_NS // len(LEGS)).contact, leg
        )
        for number, leg in enumerate(LEGS)
    ]
    end_ns = _WALK_EVALUATION_START_NS + strides * _STRIDE_NS
    return TrueLoads.sample(feet, _WALK_EVALUATION_START_NS, end_ns)


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
        `held_age_p50_p99_ms` of its newest reading; at the time of sending the rms error `error_norm_rms_mn`, and the
        angle of loaded feet `direction_error_mean_p95_deg`; of the held force `held_error_norm_rms_mn`, and `lag_ms`,
        the shift of the truth that fits best.
    """
    counts = (published.sent_ns >= truth.evaluation_start_ns) & (published.sent_ns < truth.evaluation_end_ns)
    true_n = true_normals_and_forces_n(truth.feet, published.sent_ns[counts])[1]
    force_n = published.force_n[counts]
    angle_deg = _angles_deg(true_n, force_n)
    read_ms, held_n, held_age_ms = _held_forces(published, truth)
    first = round(read_ms[0])
    true_read_n = truth.sampled_force_n[first : first + len(read_ms)]
    return {
        "held_age_p50_p99_ms": np.percentile(held_age_ms, (50, 99)).tolist(),
        "error_norm_rms_mn": _rms_mn(force_n - true_n),
        "direction_error_mean_p95_deg": [float(angle_deg.mean()), float(np.percentile(angle_deg, 95))],
        "held_error_norm_rms_mn": _rms_mn(held_n - true_read_n),
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


def _by_method(truth: TrueLoads, context: "StudyContext") -> Iterator[dict[str, Any]]:
    """Yield latency and errors of every publishing method."""
    readings = {
        name: simulate_conversions(
            Specimen(context.response),
            truth.feet,
            CONVERSION_ORDERS[name],
            400,
            truth.evaluation_end_ns,
            _SEED,
        )
        for name in ("raster", "lo_shu")
    }
    for method, (degree, every, orders) in METHODS.items():
        for order in orders:
            forces = estimate_forces(readings[order], context.network, context.trained_inputs, degree)
            errors = latency_and_errors(forces.every_nth(every), truth)
            yield {"method": method, "scan_order": order, "errors": errors}


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
    """Return age and error of forces on the measured walk, by method (`walk`) and by rate and publishing (`points`).

    Args:
        context: Response table and network; in the quick form one stride, and one rate.
    """
    strides, points = (1 if context.quick else 4), list[dict[str, Any]]()
    truth = _walk_loads(strides)
    methods = list(_by_method(truth, context))
    context.report_progress("latency against error: methods")
    for rate_sps in _QUICK_RATES_SPS if context.quick else _RATES_SPS:
        points += _operating_points(rate_sps, truth, context)
        context.report_progress(f"latency against error: {rate_sps} S/s")
    step_ns, send_delay_ns = conversion_timing(400)
    return {
        "conversion_period_ms": step_ns * 1e-6,
        "send_delay_ms": send_delay_ns * 1e-6,
        "strides": strides,
        "walk": methods,
        "points": points,
    }
