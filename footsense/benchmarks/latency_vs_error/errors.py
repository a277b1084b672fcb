"""How far published forces were from what the feet felt, and how late they were, for the study `tradeoff`."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from footsense.benchmarks.latency_vs_error.chain import Felt, Published, Stamps, felt_by

Vector = NDArray[np.float64]

#: Truth from which a direction is defined, and from which a foot is on the ground [N].
LOADED_N, TOUCHING_N = 0.1, 0.02
#: Multiples of sigma that errors are held against.
SIGMAS = (1, 2, 3, 5)
#: Times at which a consumer looks [ns].
LOOK_NS = 1_000_000
#: How far the truth is shifted to find how late forces are [ms]: later, where a prediction overshoots, and earlier.
_AHEAD_MS, _BEHIND_MS = 30, 600


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """What one way of publishing was worth on one load.

    Attributes:
        age_ms: Age of the measurement when its force is sent, median [ms].
        age_used_ms: The same when a consumer looks, median and 99th percentile [ms].
        sent_mn: Error of fx, fy, fz at the time of sending, rms [mN].
        sent_total_mn: Length of that error, rms [mN].
        direction_deg: Angle to the truth at the time of sending, mean and 95th percentile, on a loaded foot [deg].
        used_total_mn: Length of the error at any time, the consumer holding the last force, rms [mN].
        used_direction_deg: Angle at any time, mean [deg].
        within_sigma: Share of components, foot on the ground, whose error at the time of sending is within each of
            `SIGMAS` [1].
        within_sigma_then: The same for the error at the time that the force speaks of.
        behind_ms: Shift of the truth that fits best to what the consumer holds [ms].
    """

    age_ms: float
    age_used_ms: tuple[float, float]
    sent_mn: tuple[float, float, float]
    sent_total_mn: float
    direction_deg: tuple[float, float]
    used_total_mn: float
    used_direction_deg: float
    within_sigma: tuple[float, ...]
    within_sigma_then: tuple[float, ...]
    behind_ms: float


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """What some feet feel, at the times at which a consumer looks.

    Attributes:
        feet: What each feels.
        begin_ns: From when on errors count [ns].
        end_ns: Until when [ns].
        look_n: Forces at every `LOOK_NS` from time 0 to 30 ms after the end [N], shape (times, feet, 3).
    """

    feet: Sequence[Felt]
    begin_ns: int
    end_ns: int
    look_n: Vector

    @classmethod
    def of(cls, feet: Sequence[Felt], begin_ns: int, end_ns: int) -> "Truth":
        """Return the truth of some feet between two times [ns]."""
        look_ns = np.arange(0, end_ns + _AHEAD_MS * 1_000_000, LOOK_NS)
        return cls(feet, begin_ns, end_ns, felt_by(feet, look_ns)[1])


def angles_deg(truth_n: Vector, found_n: Vector) -> Vector:
    """Return the angles between forces [deg], shape (n,), where the truth is loaded."""
    loaded = np.linalg.norm(truth_n, axis=-1) >= LOADED_N
    one, other = truth_n[loaded], found_n[loaded]
    sine = np.linalg.norm(np.cross(one, other), axis=-1)
    angle: Vector = np.degrees(np.arctan2(sine, (one * other).sum(axis=-1)))
    return angle


def held(published: Published, truth: Truth) -> tuple[Vector, Vector, Vector]:
    """Return what a consumer holds between the two times of a truth.

    Returns:
        When it looks [ms], shape (times,); the force that it holds [N], shape (times, feet, 3); its age [ms].
    """
    look_ns: Stamps = np.arange(truth.begin_ns, truth.end_ns, LOOK_NS)
    last = np.searchsorted(published.sent_ns, look_ns, side="right") - 1
    look_ms: Vector = look_ns / 1e6
    age_ms: Vector = (look_ns - published.t_ns[last]) / 1e6
    return look_ms, published.force_n[last], age_ms


def judge(published: Published, truth: Truth) -> Judged:
    """Return the errors of published forces between the two times of a truth."""
    counts = (published.sent_ns >= truth.begin_ns) & (published.sent_ns < truth.end_ns)
    true_force_n = felt_by(truth.feet, published.sent_ns[counts])[1]
    predicted = published.of_ns is published.sent_ns
    then_n = true_force_n if predicted else felt_by(truth.feet, published.of_ns[counts])[1]
    force_n, sigma_n = published.force_n[counts], published.sigma_n[counts]
    error_n = force_n - true_force_n
    angle_deg = angles_deg(true_force_n, force_n)
    look_ms, held_n, age_used_ms = held(published, truth)
    first = round(look_ms[0])
    looked_n = truth.look_n[first : first + len(look_ms)]
    return Judged(
        age_ms=float(np.median(published.sent_ns[counts] - published.t_ns[counts])) * 1e-6,
        age_used_ms=(float(np.median(age_used_ms)), float(np.percentile(age_used_ms, 99))),
        sent_mn=tuple((1e3 * np.sqrt((error_n**2).mean(axis=(0, 1)))).tolist()),
        sent_total_mn=rms_mn(error_n),
        direction_deg=(float(angle_deg.mean()), float(np.percentile(angle_deg, 95))),
        used_total_mn=rms_mn(held_n - looked_n),
        used_direction_deg=float(angles_deg(looked_n, held_n).mean()),
        within_sigma=_within(true_force_n, force_n, sigma_n),
        within_sigma_then=_within(then_n, force_n, sigma_n),
        behind_ms=_behind_ms(held_n, truth.look_n, first),
    )


def rms_mn(error_n: Vector) -> float:
    """Return the root mean square of the length of errors [N], shape (..., 3), in mN."""
    return 1e3 * float(np.sqrt((error_n**2).sum(axis=-1).mean()))


def _within(truth_n: Vector, found_n: Vector, sigma_n: Vector) -> tuple[float, ...]:
    """Return the share of components of feet on the ground that are within each of `SIGMAS` [1]."""
    touching = np.linalg.norm(truth_n, axis=-1) >= TOUCHING_N
    off = np.abs(found_n - truth_n)[touching] / sigma_n[touching]
    return tuple(float((off < k).mean()) for k in SIGMAS)


def _behind_ms(held_n: Vector, look_n: Vector, first: int) -> float:
    """Return by how much earlier the truth has to be taken to fit best [ms]; a parabola between whole ones."""
    shifts = np.arange(-_AHEAD_MS, min(_BEHIND_MS, first) + 1)
    misfit = np.array(
        [((held_n - look_n[first - k : first - k + len(held_n)]) ** 2).mean() for k in shifts.tolist()]
    )
    best = int(np.clip(misfit.argmin(), 1, len(shifts) - 2))
    left, middle, right = misfit[best - 1 : best + 2].tolist()
    between: float = 0.5 * (left - right) / (left - 2 * middle + right)
    return float(shifts[best]) + between


def settled_ms(published: Published, truth: Truth, begins_ns: Sequence[int]) -> Vector:
    """Return how long after a load began each foot's held force is within a tenth of it for good [ms], shape (feet,).

    Args:
        published: Forces.
        truth: What the feet felt; at its end each is under its full load.
        begins_ns: When the load of each began [ns].
    """
    look_ms, held_n, _ = held(published, truth)
    full_n = truth.look_n[round(look_ms[-1])]
    off = np.linalg.norm(held_n - full_n, axis=-1) > 0.1 * np.linalg.norm(full_n, axis=-1)
    last = len(off) - 1 - off[::-1].argmax(axis=0)
    settled: Vector = look_ms[last] + 1.0 - np.array(begins_ns) * 1e-6
    return settled
