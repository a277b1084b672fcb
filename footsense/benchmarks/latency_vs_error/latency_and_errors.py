"""Latency and errors of published forces against the true load."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from footsense.benchmarks.latency_vs_error.chain import FootLoad, true_normals_and_forces_n
from footsense.benchmarks.latency_vs_error.publishing import PublishedForces
from footsense.foot.directions import angles_between_deg
from footsense.frames import Stamps, Vector

#: True force from which a direction is defined, and from which a foot is in contact [N].
LOADED_THRESHOLD_N, CONTACT_THRESHOLD_N = 0.1, 0.02
#: Multiples of sigma of which the coverage is counted.
SIGMA_MULTIPLES = (1, 2, 3, 5)
#: Period at which a consumer reads the last force [ns].
TRUTH_SAMPLE_PERIOD_NS = 1_000_000
#: Shifts of the truth in the search for the lag [ms]: later, for a force that runs ahead, and earlier.
_AHEAD_MS, _BEHIND_MS = 30, 600


@dataclass(frozen=True, slots=True, kw_only=True)
class LatencyAndErrors:
    """Latency and force errors of one method under one load; *held*: of the last force sent, at any time.

    Attributes:
        held_age_p50_p99_ms: Age of the newest reading in the held force, median and 99th percentile [ms].
        axis_error_rms_mn: Error of fx, fy, fz at the time of sending, rms [mN].
        error_norm_rms_mn: Length of that error, rms [mN].
        direction_error_mean_p95_deg: Angle to the true force at the time of sending, mean and 95th percentile, loaded
            feet [deg].
        held_error_norm_rms_mn: Length of the error of the held force, rms [mN].
        held_direction_error_mean_deg: Angle of the held force to the true one, mean [deg].
        share_within_sigmas: Share of force components, feet in contact, with an error within each of `SIGMA_MULTIPLES`
            at the time of sending [1].
        lag_ms: Shift of the truth that fits the held force best [ms].
    """

    held_age_p50_p99_ms: tuple[float, float]
    axis_error_rms_mn: tuple[float, float, float]
    error_norm_rms_mn: float
    direction_error_mean_p95_deg: tuple[float, float]
    held_error_norm_rms_mn: float
    held_direction_error_mean_deg: float
    share_within_sigmas: tuple[float, ...]
    lag_ms: float


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


def _held_forces(published: PublishedForces, truth: TrueLoads) -> tuple[Vector, Vector, Vector]:
    """Return, at each truth sample, the last force that a consumer has received (sample and hold).

    Returns:
        Times [ms], shape (times,); held forces [N], shape (times, feet, 3); ages of their newest readings [ms].
    """
    read_ns: Stamps = np.arange(truth.evaluation_start_ns, truth.evaluation_end_ns, TRUTH_SAMPLE_PERIOD_NS)
    last = np.searchsorted(published.sent_ns, read_ns, side="right") - 1
    return read_ns / 1e6, published.force_n[last], (read_ns - published.newest_reading_ns[last]) / 1e6


def latency_and_errors(published: PublishedForces, truth: TrueLoads) -> LatencyAndErrors:
    """Return latency and errors of published forces over the time span of the true loads."""
    counts = (published.sent_ns >= truth.evaluation_start_ns) & (published.sent_ns < truth.evaluation_end_ns)
    true_n = true_normals_and_forces_n(truth.feet, published.sent_ns[counts])[1]
    force_n = published.force_n[counts]
    angle_deg = _angles_deg(true_n, force_n)
    read_ms, held_n, held_age_ms = _held_forces(published, truth)
    first = round(read_ms[0])
    true_read_n = truth.sampled_force_n[first : first + len(read_ms)]
    return LatencyAndErrors(
        held_age_p50_p99_ms=(float(np.median(held_age_ms)), float(np.percentile(held_age_ms, 99))),
        axis_error_rms_mn=tuple((1e3 * np.sqrt(((force_n - true_n) ** 2).mean(axis=(0, 1)))).tolist()),
        error_norm_rms_mn=rms_mn(force_n - true_n),
        direction_error_mean_p95_deg=(float(angle_deg.mean()), float(np.percentile(angle_deg, 95))),
        held_error_norm_rms_mn=rms_mn(held_n - true_read_n),
        held_direction_error_mean_deg=float(_angles_deg(true_read_n, held_n).mean()),
        share_within_sigmas=_share_within_sigmas(true_n, force_n, published.sigma_n[counts]),
        lag_ms=_lag_ms(held_n, truth.sampled_force_n, first),
    )


def rms_mn(error_n: Vector) -> float:
    """Return the rms length of error vectors [N], shape (..., 3), in mN."""
    return 1e3 * float(np.sqrt((error_n**2).sum(axis=-1).mean()))


def _angles_deg(true_n: Vector, force_n: Vector) -> Vector:
    """Return the angle between true and estimated force of each loaded foot [deg], shape (n,)."""
    loaded = np.linalg.norm(true_n, axis=-1) >= LOADED_THRESHOLD_N
    return angles_between_deg(true_n[loaded], force_n[loaded])


def _share_within_sigmas(true_n: Vector, force_n: Vector, sigma_n: Vector) -> tuple[float, ...]:
    """Return the fraction of force errors of feet in contact within each of `SIGMA_MULTIPLES` [1]."""
    in_contact = np.linalg.norm(true_n, axis=-1) >= CONTACT_THRESHOLD_N
    error_sigmas = np.abs(force_n - true_n)[in_contact] / sigma_n[in_contact]
    return tuple(float((error_sigmas < k).mean()) for k in SIGMA_MULTIPLES)


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
