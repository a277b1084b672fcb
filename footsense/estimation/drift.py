"""Drift tracking: in confirmed swing the baseline of a leg follows its readings, with a known uncertainty.

A tare gives a baseline, and temperature moves it: by about 1.5 fF/K on every element, which is 1 mN/K. A baseline that
followed every slow reading would follow a robot that stands, and its load would fade within minutes. So it follows only
in confirmed swing, and even there only as fast as temperature moves:

- as a Kalman filter whose process is drift, but within `MAX_ANCHOR_DISTANCE_PF` of an anchor that runs after it at
  `MAX_DRIFT_PF_PER_S`. Over any time T a baseline moves by at most 2 MAX_ANCHOR_DISTANCE_PF + MAX_DRIFT_PF_PER_S T,
  whatever the readings do: 2 fF + 0.15 fF/s, or 1.3 mN + 0.1 mN/s.
- never farther from the free foot's expected readings than a tare may be.

It uses the reading before the last one, once the last one has confirmed that the foot was still in swing.

A load below the limit of drift and creep that rises as slowly as they do is taken for them, and removed at 0.1 mN/s.
The variance of a baseline grows with the time since it last followed.
"""

import math
from collections.abc import Iterable
from itertools import compress
from operator import attrgetter, sub

import numpy as np

from footsense.estimation.noise import ReadingNoise
from footsense.estimation.settings import (
    BASELINE_NOISE_PF,
    READING_NOISE_PF,
    SIGMAS,
    SLOW_PERIOD_NS,
    SMALL_SHARE,
    UNEVEN_DRIFT_SHARE,
    MountedFeet,
    Sensitivity,
    TareLimits,
)
from footsense.foot.capacitor import Capacitor
from footsense.frames import ELEMENTS, BaselineDrift, BaselineStatus, Cause, Mask, Stamps, Vector

#: Largest drift by temperature [pF]: 20 K at 1.5 fF/K. It is two standard deviations.
MAX_DRIFT_PF = 30e-3
#: Time constant with which a foot takes another temperature, as from the sun into the shade [s].
DRIFT_TIME_CONSTANT_S = 200.0
#: Fastest drift, that at the begin of the largest [pF/s]: 0.1 K/s.
MAX_DRIFT_PF_PER_S = MAX_DRIFT_PF / DRIFT_TIME_CONSTANT_S
#: Growth of the variance [pF^2/s]: after three time constants a drift is complete.
DRIFT_VARIANCE_PF2_PER_S = (MAX_DRIFT_PF / 2.0) ** 2 / (3.0 * DRIFT_TIME_CONSTANT_S)
#: Largest distance of a baseline from its anchor [pF]: what is not its noise.
MAX_ANCHOR_DISTANCE_PF = SIGMAS * BASELINE_NOISE_PF
#: Largest distance of an element's drift from the mean of its leg's [pF]: three standard deviations.
MAX_DRIFT_FROM_LEG_MEAN_PF = 3.0 * UNEVEN_DRIFT_SHARE * MAX_DRIFT_PF


def load_n_per_pf(design: Capacitor, sensitivity: Sensitivity) -> float:
    """Return the load along the leg for one picofarad more on every element of the free foot [N/pF]."""
    # dC / C = -d(distance) / distance.
    distance_um = float(design.plate_distance_um(np.array([design.unloaded_pf]))[0])
    return sensitivity.load_n_per_mean_closure * distance_um / design.unloaded_pf / design.gap_um


_Values = list[float]
_values_of = attrgetter("offset_pf", "moved_ns", "status")
_uncertainty_of = attrgetter("variance_pf2", "updated_ns", "left_pf")


def baseline_sigma_pf(variance_pf2: Vector | float, updated_ns: Stamps | int, now_ns: int) -> Vector:
    """Return the standard deviation of baselines at a time [pF], same shape as their variances.

    Args:
        variance_pf2: Variance at the last update [pF^2], NaN without a baseline.
        updated_ns: Time of that update [ns].
        now_ns: The time [ns].
    """
    sigma_pf: Vector = np.sqrt(
        variance_pf2 + DRIFT_VARIANCE_PF2_PER_S * np.maximum(now_ns - updated_ns, 0) * 1e-9
    )
    return sigma_pf


class LegBaseline:
    """Baseline of one leg, with its variance and drift tracking.

    Args:
        unloaded_pf: Expected reading of each element of the free foot [pF], shape (elements,).
        limits: Limits of a tare, which readings that it follows keep too.

    Attributes:
        baseline_pf: Unloaded capacitance without stray [pF], shape (elements,), NaN where there is none; replaced,
            never written to.
        status: State of the drift tracking.
        moved_ns: Time of the last tare or move [ns]; 0 without a baseline.
        offset_pf: Distance since the last tare, mean over the elements and worst element [pF]; NaN without a baseline.
        left_pf: What the readings of each element in swing differ from the baseline [pF]: more than drift explains,
            such as a cable that has moved.
        variance_pf2: Variance at `updated_ns` [pF^2], NaN without a baseline.
        updated_ns: Time of the last filter step [ns].
    """

    def __init__(self, unloaded_pf: Vector, limits: TareLimits) -> None:
        self._unloaded_pf = unloaded_pf.tolist()
        self._unloaded_limit_pf = limits.unloaded_limit_pf(unloaded_pf).tolist()
        self._quiet_pf2 = limits.quiet_variance_pf2
        self._newest_weight = limits.newest_weight
        self._shift_pf = SIGMAS * math.sqrt(limits.quiet_variance_pf2)
        self.discard()

    def discard(self) -> None:
        """Discard the baseline, as the leg may carry another foot."""
        self.baseline_pf: Vector = np.full(ELEMENTS, np.nan)
        self._tared_pf, self._anchor_pf = [math.nan] * ELEMENTS, [math.nan] * ELEMENTS
        self.status = BaselineStatus.NONE
        self.moved_ns = 0
        self.offset_pf = (math.nan, math.nan)
        self.left_pf = [0.0] * ELEMENTS
        self.variance_pf2 = math.nan
        self.updated_ns = 0
        self._before: tuple[list[float], int] | None = None
        self._step_pf2 = [0.0] * ELEMENTS

    def set_tared(self, baseline_pf: Vector, t_ns: int) -> None:
        """Set the baseline to the result of a tare [pF], shape (elements,); NaN elements keep their old baseline."""
        self.baseline_pf = np.where(np.isnan(baseline_pf), self.baseline_pf, baseline_pf)
        self._tared_pf, self._anchor_pf = self.baseline_pf.tolist(), self.baseline_pf.tolist()
        self.moved_ns = self.updated_ns = t_ns
        self.offset_pf = (0.0, 0.0)
        self.left_pf = [0.0] * ELEMENTS
        self.variance_pf2 = BASELINE_NOISE_PF**2
        self.pause_tracking()

    def pause_tracking(self) -> None:
        """Pause drift tracking and leave the baseline unchanged."""
        self._before = None
        self.status = BaselineStatus.HELD

    def observe_swing(self, capacitance_pf: Vector, t_ns: Stamps, held: BaselineStatus | None) -> bool:
        """Compare readings in swing with the baseline, and let that follow them; return whether it did either.

        Nothing happens until every element has been read anew since the last call that counted.

        Args:
            capacitance_pf: Readings without stray [pF], shape (elements,), NaN where there is none to be used.
            t_ns: Stamp of each [ns], same shape.
            held: Why the baseline does not follow them, its status then; None if it does.

        Returns:
            Whether the baseline, or what is left of it, was updated.
        """
        # In plain Python numbers: for nine elements, arrays take longer.
        stamps_ns, reading_pf = t_ns.tolist(), capacitance_pf.tolist()
        newest_ns = max(stamps_ns)
        before, self._before = self._before, (reading_pf, newest_ns)
        if before is None:
            return False
        before_pf, before_ns = before
        steps_pf = list(map(sub, reading_pf, before_pf))
        known = list(map(math.isfinite, steps_pf))
        if min(compress(stamps_ns, known), default=newest_ns) <= before_ns:
            self._before = before
            return False
        steps_pf2, weight = [0.5 * step_pf * step_pf for step_pf in steps_pf], self._newest_weight
        self._step_pf2 = [
            mean_pf2 + weight * (step_pf2 - mean_pf2) if is_known else 0.0
            for mean_pf2, step_pf2, is_known in zip(self._step_pf2, steps_pf2, known, strict=True)
        ]
        if not max(self._step_pf2) <= self._quiet_pf2:
            self.status = BaselineStatus.NOT_QUIET
            return False
        above_pf, shift_pf = map(sub, before_pf, self.baseline_pf.tolist()), self._shift_pf
        # A shift counts at once, and fades: a swing of a fast gait is over after two or three of these calls.
        self.left_pf = [
            pf
            if abs(pf - left_pf) >= shift_pf and abs(pf) > abs(left_pf)
            else left_pf + weight * (pf - left_pf)
            if math.isfinite(pf)
            else left_pf
            for left_pf, pf in zip(self.left_pf, above_pf, strict=True)
        ]
        if held is not None:
            self.status = held
            return True
        self.status = BaselineStatus.TRACKING
        self._update_baseline(before_pf, reading_pf, steps_pf2, newest_ns)
        moved_pf = list(filter(math.isfinite, map(sub, self.baseline_pf.tolist(), self._tared_pf)))
        self.offset_pf = (_sum(moved_pf) / len(moved_pf), max(moved_pf, key=abs))
        return True

    def _update_baseline(self, before_pf: _Values, newest_pf: _Values, steps_pf2: _Values, t_ns: int) -> None:
        """Update baseline and variance of the known elements from their readings (Kalman filter).

        An element that became usable after the tare gets a baseline, if it is unloaded and quiet.
        """
        elapsed_s = max(t_ns - self.updated_ns, 0) * 1e-9
        reach_pf = MAX_DRIFT_PF_PER_S * elapsed_s
        variance_pf2 = self.variance_pf2 + DRIFT_VARIANCE_PF2_PER_S * elapsed_s
        gain = variance_pf2 / (variance_pf2 + READING_NOISE_PF**2)
        baseline_pf, anchors_pf = self.baseline_pf.tolist(), self._anchor_pf
        moved_pf, innovations_pf = [0.0] * ELEMENTS, [0.0] * ELEMENTS
        any_followed, unloaded, limits = False, self._unloaded_pf, self._unloaded_limit_pf
        elements = zip(baseline_pf, before_pf, newest_pf, steps_pf2, unloaded, limits, strict=True)
        for element, (base_pf, pf, newer_pf, step_pf2, unloaded_pf, limit_pf) in enumerate(elements):
            if math.isnan(base_pf):
                mean_pf = (newer_pf + pf) / 2
                if step_pf2 <= self._quiet_pf2 and abs(mean_pf - unloaded_pf) <= limit_pf:
                    baseline_pf[element] = self._tared_pf[element] = anchors_pf[element] = mean_pf
                continue
            anchor_pf = anchors_pf[element]
            step_pf = base_pf - anchor_pf
            anchor_pf += math.copysign(reach_pf, step_pf) if abs(step_pf) > reach_pf else step_pf
            anchors_pf[element] = anchor_pf
            least_pf, most_pf = anchor_pf - MAX_ANCHOR_DISTANCE_PF, anchor_pf + MAX_ANCHOR_DISTANCE_PF
            wanted_pf = base_pf + gain * (pf - base_pf)
            wanted_pf = least_pf if wanted_pf < least_pf else wanted_pf
            wanted_pf = most_pf if wanted_pf > most_pf else wanted_pf
            distance_pf = abs(wanted_pf - unloaded_pf)
            if distance_pf > limit_pf and distance_pf > abs(base_pf - unloaded_pf):
                self.status = BaselineStatus.DRIFT_TOO_LARGE
            elif math.isfinite(step_pf2):
                any_followed = True
                innovations_pf[element] = abs(pf - base_pf)
                moved_pf[element] = abs(wanted_pf - base_pf)
                baseline_pf[element] = base_pf + (wanted_pf - base_pf)
        self.baseline_pf, self.updated_ns = np.array(baseline_pf), t_ns
        # The margin cuts the step, not the uncertainty: the variance shrinks by the share that was really moved.
        innovation_sum_pf = _sum(innovations_pf)
        share = _sum(moved_pf) / innovation_sum_pf if innovation_sum_pf > 0.0 else gain * any_followed
        self.variance_pf2 = (1.0 - share) ** 2 * variance_pf2 + share**2 * READING_NOISE_PF**2
        if share > 0.0:
            self.moved_ns = t_ns


def _sum(values: _Values) -> float:
    # In the order in which NumPy adds nine numbers, for which to make an array takes four times as long.
    a, b, c, d, e, f, g, h, i = values + [0.0] * (ELEMENTS - len(values))
    return ((a + b) + (c + d)) + ((e + f) + (g + h)) + i


class UnloadedFeet:
    """What all feet read unloaded: the baseline of each leg, and the arrays that follow from them.

    Args:
        feet: The feet.
        design: The capacitors.
        limits: Limits of a tare.
        sensitivity: Forces per closure.
        noise: Noise of each leg's readings, measured while it runs.

    Attributes:
        legs: Baseline of each leg; `update` has to follow a change.
        baseline_pf: Unloaded capacitances without stray [pF], shape (legs, elements), NaN where there is none; not
            written to.
        plate_distance_rel: Plate distances over the gap [1], shape (legs, elements).
        untared_legs: Legs without any baseline, shape (legs,).
        untared_elements_of_tared_legs: Elements without a baseline on legs that have others, shape (legs, elements).
        complete: Whether every element of every leg has a baseline.
        sigma_n: Standard deviation of each leg's force by its baseline, by what its readings in swing differ from that,
            and by noise [N], shape (legs, 3), NaN without a baseline.
        noise_ff: Noise of each leg's readings [fF], shape (legs,).
        max_errors_n: Largest error of each leg's load by its baseline [N].
        sigma_due_ns: Time from which both are to be updated [ns].
        drift: Published status and drift.
        cause: Cause of each leg whose force can be used, shape (legs,): ELEMENT_DRIFTS where an element drifts unlike
            the others, NOISY where readings have more noise than a tare allows, else NONE.
    """

    def __init__(
        self,
        feet: MountedFeet,
        design: Capacitor,
        limits: TareLimits,
        sensitivity: Sensitivity,
        noise: ReadingNoise,
    ) -> None:
        self._design, self._gain_rel, self._sensitivity = design, feet.gain_rel, sensitivity
        # One row an element, a column each component of each load.
        self._n_per_closure = sensitivity.force_n_per_closure.transpose(1, 0, 2).reshape(ELEMENTS, -1)
        self._noise, self._quiet_pf2 = noise, limits.quiet_variance_pf2
        self.noise_ff = np.zeros(len(feet.names))
        self._noisy: Mask = np.zeros(len(feet.names), bool)
        self.legs = [LegBaseline(leg_pf, limits) for leg_pf in feet.unloaded_pf]
        # Near the unloaded distance, where the error of a baseline matters.
        self._closure_per_pf = float(design.plate_distance_um(feet.unloaded_pf).mean()) / (
            design.gap_um * float(feet.unloaded_pf.mean())
        )
        self.sigma_n = np.full((len(feet.names), 3), np.nan)
        self.max_errors_n: list[float] = []
        self.sigma_due_ns = 0
        self.complete = False
        self._apart = [False] * len(feet.names)
        self._set_cause()
        self.baseline_pf: Vector = np.full(feet.unloaded_pf.shape, np.nan)
        self.plate_distance_rel = self.baseline_pf.copy()
        self.update(())

    def update(self, moved: Iterable[int]) -> None:
        """Derive the arrays from the baselines that have moved, but for what a tenth of a second changes little."""
        self.baseline_pf = self.baseline_pf.copy()
        for leg in moved:
            self.baseline_pf[leg] = leg_pf = self.legs[leg].baseline_pf
            distance_um = self._design.plate_distance_um(leg_pf)
            self.plate_distance_rel[leg] = distance_um / self._design.gap_um / self._gain_rel[leg]
        without_baseline: Mask = np.isnan(self.baseline_pf)
        was_complete, self.complete = self.complete, not np.count_nonzero(without_baseline)
        if not (was_complete and self.complete):
            self.untared_legs: Mask = np.asarray(without_baseline.all(axis=1))
            self.untared_elements_of_tared_legs: Mask = without_baseline & ~self.untared_legs[:, None]
        offset_pf, moved_ns, status = zip(*map(_values_of, self.legs), strict=True)
        codes = np.frombuffer(bytes(status), np.uint8)
        mean_pf, worst_pf = map(np.array, zip(*offset_pf, strict=True))
        self.drift = BaselineDrift(codes, mean_pf, worst_pf, np.array(moved_ns, np.int64))
        apart = [abs(worst_pf - mean_pf) > MAX_DRIFT_FROM_LEG_MEAN_PF for mean_pf, worst_pf in offset_pf]
        if apart != self._apart:
            self._apart = apart
            self._set_cause()

    def _set_cause(self) -> None:
        cause = np.where(self._noisy, np.uint8(Cause.NOISY), np.uint8(Cause.NONE))
        self.cause = np.where(self._apart, np.uint8(Cause.ELEMENT_DRIFTS), cause)

    def update_sigma(self, now_ns: int) -> None:
        """Set `sigma_n`, `max_errors_n`, `noise_ff` and `cause` for the present tenth of a second."""
        # Of the coming period, which ends at a time that does not depend on the legs.
        self.sigma_due_ns = (now_ns // SLOW_PERIOD_NS + 1) * SLOW_PERIOD_NS
        variance_pf2, updated_ns, left_pf = map(np.array, zip(*map(_uncertainty_of, self.legs), strict=True))
        sigma_pf = baseline_sigma_pf(variance_pf2, updated_ns, self.sigma_due_ns)
        n_per_pf = self._closure_per_pf * self._sensitivity.load_n_per_mean_closure
        self.max_errors_n = (n_per_pf * np.minimum(3.0 * sigma_pf, MAX_DRIFT_PF)).tolist()
        noise_rel = np.sqrt(self._noise.variance_rel)
        self.noise_ff = noise_rel / self._closure_per_pf * 1e3
        # One that is noisy is quiet again when it is well below the limit.
        shown_pf = self.noise_ff * 1e-3 / np.where(self._noisy, 1.0 - SMALL_SHARE, 1.0)
        noisy = ~(shown_pf * shown_pf <= self._quiet_pf2)
        if noisy.tobytes() != self._noisy.tobytes():
            self._noisy = noisy
            self._set_cause()
        baseline_rel = sigma_pf * self._closure_per_pf
        by_baseline_n = baseline_rel[:, None] * self._sensitivity.force_sigma_n_per_baseline_error
        by_noise_n = noise_rel[:, None] * self._sensitivity.force_sigma_n_per_reading_noise
        n_loads = len(self._sensitivity.force_n_per_closure)
        left_n = self._closure_per_pf * (left_pf @ self._n_per_closure).reshape(len(left_pf), n_loads, 3)
        left_n2 = np.add.reduce(np.square(left_n), axis=1) / n_loads
        self.sigma_n = np.sqrt(by_baseline_n**2 + by_noise_n**2 + left_n2)
