"""Which elements of the feet can be used: by their readings alone, and by those of the other elements.

**Masks of elements**, each of the shape (legs, elements):

- `opened`, `over_range`: what the reading alone shows. Pressing adds capacitance, and a force that leans, of 1.5 times
  the range with the friction of rubber, takes 57 % of it at most: an element that has lost 65 % is open.
- `overloaded`: over-range ones, and those with a larger closure than the network was trained for.
- `excluded`: elements that have contradicted the others, until they agree again.
- `unusable`: what a tare leaves out: sets with open or excluded elements, and with over-range ones without a baseline.
- `missing`: what the network does without, always one of `MISSING_SETS` or nothing: sets with open or excluded
  elements and those without a baseline; the test adds those that it isolates in this frame, the pipeline those whose
  readings are interrupted.

**By the other elements.** A foot has nine elements and a load far fewer unknowns, so each closure follows roughly from
the others. With S = E[x x^T] over the loads of a foot, the least-squares prediction of x_i from all others leaves the
residual (S^-1 x)_i / (S^-1)_ii: one matrix product tests all elements at once. Over the loads that a foot is trained
for the residual is at most 14 % of the others' closures.

The elements are read one after the other, so a load in motion leaves a residual as well, at most about as large as the
closures move from one reading to the next: the limit is wider by that. A larger residual has a cause: an electrode that
came off and no longer moves, one that drifts, a flipped bit, or a line that broke during the scan. So an element, row
or column without which the rest is consistent is suspected. An impact of some milliseconds, which two or three elements
see, leaves the same residual for a scan. So an element is isolated, and named, if it still contradicts the others when
it is read again a scan later, and stands still. Until then, and where no set explains the residuals, the state stays
and sigma is wider. It is so from a quarter of the limit on: an element that has just come off, and stands still under a
load that rolls away, is wrong before it contradicts the others.

One that stays isolated is excluded, until it has been consistent for a while both under load and unloaded: unloaded, an
element stuck at its baseline reads right, and under load, where the limit is wider, a drifting one may. A foot that
stands or hangs for long shows only one of both: after ten seconds an element that is consistent there is readmitted.

An overloaded element is closed at least as far as it reads. It predicts no other, and contradicts only if the others
predict less: then it is shorted, or its gap is full of water.
"""

import math
from typing import NamedTuple

import numpy as np

from footsense.estimation.missing_elements import (
    MAX_OVERLOADED,
    MISSING_SETS,
    Imputation,
    missing_sets_containing,
)
from footsense.estimation.network import Readings
from footsense.estimation.settings import MountedFeet
from footsense.frames import ELEMENTS, ROWS, CapFrame, Mask, Reading, Vector

#: Capacitance below which an element is open, over its unloaded capacitance [1].
OPEN_ELEMENT_THRESHOLD_REL = 0.35

#: Limit of an element's residual: over its gap [1], and over the root mean square of the others [1].
RESIDUAL_LIMIT, RESIDUAL_LIMIT_REL = 0.03, 0.4
#: Residual from which it is added to sigma, over the gap [1], and over the root mean square of the others [1]: sigma of
#: healthy feet in a tripod gait grows by 3 %.
UNCERTAIN_RESIDUAL, UNCERTAIN_RESIDUAL_REL = 0.01, 0.1
#: Predicted closure from which the motion of an element can be tested [1].
MIN_PREDICTED_MOTION_REL = 0.08
#: Time for which an excluded element has to be consistent, loaded and unloaded each, until it is readmitted [ns].
READMITTED_AFTER_NS = 300_000_000
#: The same where the load does not change, or is too small to tell [ns].
READMITTED_CONSTANT_LOAD_AFTER_NS = 10_000_000_000
#: Rate at which it loses that time while it is inconsistent [1].
READMISSION_TIME_LOSS_RATE = 4
#: Time for which an element is suspected before it is isolated, over the time of a step [1]: a scan.
CAUSE_CONFIRMATION_TIME_REL = 0.25
#: A reading stands still that differs from the two before by less than this share of its residual [1].
STEADY_BELOW_SHARE_OF_RESIDUAL = 0.25
#: An element that moves less than this share of what the others predict is stuck [1].
STUCK_BELOW_SHARE_OF_PREDICTED = 0.3

# The sets of one element, and the rows and columns.
_SINGLE_ELEMENTS, _LINES = slice(1, 1 + ELEMENTS), slice(1 + ELEMENTS, None)


class ElementStatus(NamedTuple):
    """Status of every element in a frame by its reading, shape (legs, elements) each.

    Attributes:
        capacitance_pf: Capacitances without stray [pF], NaN where there is none to be used.
        opened: Elements whose electrode is disconnected.
        over_range: Elements above the converter's range.
        unusable: Elements that a tare leaves out.
        all_readings_ok: Whether no reading of the frame has a fault.
    """

    capacitance_pf: Vector
    opened: Mask
    over_range: Mask
    unusable: Mask
    all_readings_ok: bool


class ElementClassifier:
    """Determines the status of every element of a frame by its reading.

    Args:
        feet: The feet.
        range_end_pf: Least capacitance of an element over the converter's range [pF].
    """

    def __init__(self, feet: MountedFeet, range_end_pf: float) -> None:
        self._stray_pf = feet.stray_pf
        self._range_end_pf = range_end_pf - feet.stray_pf
        self._open_below_pf = OPEN_ELEMENT_THRESHOLD_REL * feet.unloaded_pf
        self._none: Mask = np.zeros(feet.stray_pf.shape, bool)
        self._opened = self._none
        self._any_opened = False

    def classify(self, scan: CapFrame, excluded: Mask, baseline_pf: Vector) -> ElementStatus:
        """Return the status of the elements of a frame.

        Args:
            scan: The frame.
            excluded: Elements that the consistency test excludes.
            baseline_pf: Baselines [pF], NaN where there is none.
        """
        capacitance_pf = scan.capacitance_pf - self._stray_pf
        # NaN compares as False: an element that was not read is not open.
        opened = capacitance_pf < self._open_below_pf
        all_ok = not np.count_nonzero(scan.reading)
        if not all_ok:
            opened |= scan.reading == Reading.UNDER_RANGE
        before, self._opened = self._opened, opened
        any_before, self._any_opened = self._any_opened, bool(np.count_nonzero(opened))
        if all_ok and not (self._any_opened or any_before):
            unusable = missing_sets_containing(excluded) if np.count_nonzero(excluded) else excluded
            return ElementStatus(capacitance_pf, self._none, self._none, unusable, all_readings_ok=True)
        over_range = scan.reading == Reading.OVER_RANGE
        if over_range.any():  # at least that much: the consistency test decides whether it can be
            capacitance_pf = np.where(over_range, self._range_end_pf, capacitance_pf)
        if self._any_opened:
            capacitance_pf = capacitance_pf - floating_row_crosstalk_pf(scan.capacitance_pf, opened)
        # A line that breaks or returns was intact for a part of the scan, and so was its effect on other elements.
        unsettled = opened | (opened != before).any(axis=1, keepdims=True)
        # Pressed or shorted? The other closures tell, and without a baseline there are none.
        unusable = missing_sets_containing(opened | excluded | over_range & np.isnan(baseline_pf))
        # In the window, an unsettled reading would be a step of the load.
        settled_pf = np.where(unsettled, np.nan, capacitance_pf)
        return ElementStatus(settled_pf, opened, over_range, unusable, all_readings_ok=False)


class ConsistencyResult(NamedTuple):
    """Result of the residual test of all legs.

    Attributes:
        missing: Elements that the network does without.
        inconsistency_sigma_rel: Sigma to add, over the force, for residuals without an excluded element, shape (legs,)
            [1].
        is_all_ok: Whether every element is consistent, and none is missing, suspected or excluded.
    """

    missing: Mask
    inconsistency_sigma_rel: Vector
    is_all_ok: bool


class ConsistencyTest:
    """Residual test of every leg's elements in each frame; remembers the excluded elements.

    Args:
        n_legs: Legs in a frame.
        imputation: Imputation of missing closures.
        settling_time_ns: Time in which a step of the load has passed through all readings: a few scans [ns].

    Attributes:
        excluded: Elements excluded until their readings are consistent again.
        isolated: Those, and the elements with a confirmed suspicion that contradict the others in this frame.
        stuck: Isolated elements that do not follow the load; the others follow it with an offset.
    """

    def __init__(self, n_legs: int, imputation: Imputation, settling_time_ns: int) -> None:
        self._imputation = imputation
        self._settling_time_ns = settling_time_ns
        shape = (n_legs, ELEMENTS)
        # As an array, for speed: over the root of the sum of squares.
        self._uncertain_rel_of_sum = np.array(UNCERTAIN_RESIDUAL_REL / math.sqrt(ELEMENTS))
        self._whole = imputation.residuals(np.eye(ELEMENTS), MISSING_SETS[0], MISSING_SETS[0])
        self._no_inconsistency = np.zeros(n_legs)
        self._all_trusted = True  # no element is suspected or excluded
        self._hold_ns = round(CAUSE_CONFIRMATION_TIME_REL * settling_time_ns)
        self._inconsistent = np.zeros(n_legs, bool)
        self._suspected = np.zeros(shape, bool)
        self._suspected_since_ns = np.zeros(n_legs, np.int64)
        self._t_of_readings_ns = np.zeros(shape, np.int64)
        self._confirmed = np.zeros(n_legs, bool)
        self._no_element = np.zeros(shape, bool)
        self.isolated = self._no_element
        self.excluded = np.zeros(shape, bool)
        self.stuck = np.zeros(shape, bool)
        self._consistent_ns = np.zeros((n_legs, 3), np.int64)  # unloaded, loaded, in all
        self._t_ns = 0
        # Of each element's measured and predicted closures: the smallest and the largest.
        self._extremes = np.zeros((2, 2, *shape))

    def reset(self, legs: Mask) -> None:
        """Readmit all elements of the legs in a mask, shape (legs,), after a change of foot or baseline."""
        for marks in (self.excluded, self._suspected, self.stuck, self._inconsistent):
            marks[legs] = False

    def test(
        self, closure_rel: Vector, readings: Readings, missing: Mask, overloaded: Mask, now_ns: int
    ) -> ConsistencyResult:
        """Test the elements of a frame; return the missing and the inconsistent ones.

        Args:
            closure_rel: Newest closures over the gap [1], shape (legs, elements); a leg with a NaN that is not missing
                is not tested.
            readings: The readings that they are of.
            missing: Elements that the network does without, `excluded` included.
            overloaded: Elements that are closed at least as far as they read.
            now_ns: Current time [ns].
        """
        # One element alone is no motion.
        motion_rel = readings.second_largest_motion_rel
        largest = np.maximum.reduce(np.abs(closure_rel @ self._whole), axis=1)
        sum_rel2 = np.add.reduce(closure_rel * closure_rel, axis=1)
        # A NaN is never certain: its leg is tested by itself, like a leg with a missing element.
        certain = largest - motion_rel <= UNCERTAIN_RESIDUAL + self._uncertain_rel_of_sum * np.sqrt(sum_rel2)
        self.isolated = self._no_element
        is_all_sound = self._all_trusted and not np.count_nonzero(missing | overloaded)
        if is_all_sound and np.count_nonzero(certain) == certain.size:
            self._t_ns = now_ns
            return ConsistencyResult(missing, self._no_inconsistency, is_all_ok=True)
        rms_rel = np.sqrt(sum_rel2 / ELEMENTS)
        inconsistency_rel = inconsistency_sigma_rel(largest, rms_rel, motion_rel)
        consistent = largest <= _residual_limit_rel(rms_rel, motion_rel)
        if is_all_sound and consistent.all():
            self._t_ns = now_ns
            return ConsistencyResult(missing, inconsistency_rel, is_all_ok=True)
        suspicious = ~consistent | (missing | overloaded | self._suspected).any(axis=1)
        if suspicious.any():
            missing, self.isolated = missing.copy(), self.excluded.copy()
            for leg in np.flatnonzero(suspicious).tolist():
                inconsistency_rel[leg] = self._test_leg(
                    leg, closure_rel[leg], readings, missing[leg], overloaded[leg], now_ns
                )
        self._t_ns = now_ns
        self._all_trusted = not (self._suspected.any() or self.excluded.any())
        measured, predicted = self._extremes[:, 1] - self._extremes[:, 0]
        stands_still = measured < STUCK_BELOW_SHARE_OF_PREDICTED * predicted
        is_stuck = (predicted > MIN_PREDICTED_MOTION_REL) & stands_still
        self.stuck = self.isolated & (self.stuck & self.excluded | is_stuck)
        return ConsistencyResult(missing, inconsistency_rel, is_all_ok=False)

    def _test_leg(
        self,
        leg: int,
        closure_rel: Vector,
        readings: Readings,
        missing: Mask,
        overloaded: Mask,
        now_ns: int,
    ) -> float:
        # Adds isolated elements to `missing`, shape (elements,); returns the inconsistency [1].
        if not np.isfinite(closure_rel[~missing]).all():
            return 0.0
        if np.count_nonzero(overloaded & ~missing) > MAX_OVERLOADED:
            # The others tell too little, and there is no force.
            self._suspected[leg] = self._inconsistent[leg] = False
            return 0.0
        is_new = readings.t_ns[leg, 0] != self._t_of_readings_ns[leg]
        self._t_of_readings_ns[leg] = readings.t_ns[leg, 0]
        motion_rel = float(readings.second_largest_motion_rel[leg])
        if self.excluded[leg].any():
            self._readmit(leg, closure_rel, motion_rel, missing, overloaded, now_ns)
            self._update_closure_extremes(leg, closure_rel, missing | overloaded)
        # An element that the network does without takes no load from those beside it.
        overloaded = overloaded & ~missing
        largest, rms_rel = self._largest_residuals(closure_rel, missing, overloaded)
        inconsistency_rel = float(inconsistency_sigma_rel(largest, rms_rel, motion_rel))
        inconsistency_rel *= self._imputation.error_amplification(missing)
        limit_rel = _residual_limit_rel(rms_rel, motion_rel)
        if largest <= limit_rel:
            # What motion could explain neither clears a suspicion nor feeds it.
            if largest <= _residual_limit_rel(rms_rel):
                self._suspected[leg] = self._inconsistent[leg] = False
            return inconsistency_rel
        isolated = self._isolate(closure_rel, missing, overloaded, motion_rel)
        suspected = isolated & ~missing
        if not self._inconsistent[leg] or not np.array_equal(suspected, self._suspected[leg]):
            self._inconsistent[leg], self._confirmed[leg] = True, False
            self._suspected[leg], self._suspected_since_ns[leg] = suspected, now_ns
            self._extremes[:, 0, leg], self._extremes[:, 1, leg] = np.inf, -np.inf
        elif (read_again := suspected & is_new).any():
            off_rel = np.abs(self._imputation.residuals(closure_rel, missing | isolated, overloaded))
            moved_rel = np.nan_to_num(np.abs(readings.changes_rel[leg])).max(axis=0)
            stands_still = moved_rel < STEADY_BELOW_SHARE_OF_RESIDUAL * off_rel
            self._confirmed[leg] |= (read_again & stands_still).any()
        self._update_closure_extremes(leg, closure_rel, missing | isolated | overloaded)
        # Whether an overloaded element stands still is not known.
        hold_ns = self._settling_time_ns if (suspected & overloaded).any() else self._hold_ns
        if not self._confirmed[leg] or now_ns - self._suspected_since_ns[leg] < hold_ns:
            return inconsistency_rel
        missing |= isolated
        self.isolated[leg] |= suspected
        if now_ns - self._suspected_since_ns[leg] < self._settling_time_ns:
            return inconsistency_rel
        self.excluded[leg] |= suspected
        self._suspected[leg] = False
        self._consistent_ns[leg] = 0
        return 0.0

    def _readmit(
        self,
        leg: int,
        closure_rel: Vector,
        motion_rel: float,
        missing: Mask,
        overloaded: Mask,
        now_ns: int,
    ) -> None:
        excluded = self.excluded[leg]
        if not np.isfinite(closure_rel[excluded]).all():
            return
        elapsed_ns = min(now_ns - self._t_ns, self._settling_time_ns)
        largest, rms_rel = self._largest_residuals(closure_rel, missing & ~excluded, overloaded)
        if largest > _residual_limit_rel(rms_rel, motion_rel):
            # Not all at once: a load in motion is not over at once.
            self._consistent_ns[leg] = np.maximum(
                self._consistent_ns[leg] - READMISSION_TIME_LOSS_RATE * elapsed_ns, 0
            )
        elif largest <= _residual_limit_rel(rms_rel):
            predicted = np.abs(self._with_imputed(closure_rel, missing | overloaded)[excluded]).max()
            unloaded = predicted < RESIDUAL_LIMIT
            tells = not (unloaded and self.stuck[leg].any())
            self._consistent_ns[leg] += np.where(
                [unloaded, predicted > MIN_PREDICTED_MOTION_REL, tells], elapsed_ns, 0
            )
        *both_ns, all_ns = self._consistent_ns[leg].tolist()
        if min(both_ns) >= READMITTED_AFTER_NS or all_ns >= READMITTED_CONSTANT_LOAD_AFTER_NS:
            missing &= ~excluded
            self.excluded[leg] = self.isolated[leg] = self.stuck[leg] = False

    def _update_closure_extremes(self, leg: int, closure_rel: Vector, unknown: Mask) -> None:
        both = np.stack([closure_rel, self._with_imputed(closure_rel, unknown)])
        extremes = self._extremes[:, :, leg]
        extremes[:, 0] = np.fmin(extremes[:, 0], both)
        extremes[:, 1] = np.fmax(extremes[:, 1], both)

    def _with_imputed(self, closure_rel: Vector, unknown: Mask) -> Vector:
        imputed: Vector = self._imputation.impute(closure_rel[None], unknown[None])[0]
        return imputed

    def _largest_residuals(
        self, closure_rel: Vector, missing: Mask, overloaded: Mask
    ) -> tuple[Vector, Vector]:
        """Return the largest residual of the elements that are not missing, and the rms of their closures [1].

        Args:
            closure_rel: Closures over the gap [1], shape (elements,).
            missing: Missing elements, shape (..., elements).
            overloaded: Overloaded elements, shape (elements,).
        """
        residual = self._imputation.residuals(closure_rel, missing, overloaded)
        mean_rel2 = np.square(np.where(missing, 0.0, closure_rel)).sum(axis=-1) / (~missing).sum(axis=-1)
        return np.where(missing, 0.0, np.abs(residual)).max(axis=-1), np.sqrt(mean_rel2)

    def _isolate(self, closure_rel: Vector, missing: Mask, overloaded: Mask, motion_rel: float) -> Mask:
        """Return the smallest trained set of missing elements that makes the others consistent; else `missing`."""
        residual, rms_rel = self._largest_residuals(closure_rel, MISSING_SETS, overloaded)
        excess = residual / _residual_limit_rel(rms_rel, motion_rel)
        excess[(missing & ~MISSING_SETS).any(axis=1)] = np.inf
        for sets in (_SINGLE_ELEMENTS, _LINES):
            if excess[sets].min() <= 1.0:
                isolated: Mask = MISSING_SETS[sets][excess[sets].argmin()]
                return isolated
        return missing


def inconsistency_sigma_rel(
    residual: Vector | float, rms_rel: Vector | float, motion_rel: Vector | float
) -> Vector:
    """Return sigma over the force [1] for the largest residual of a foot whose closures have this rms and motion."""
    uncertain = np.maximum(residual - motion_rel - UNCERTAIN_RESIDUAL - UNCERTAIN_RESIDUAL_REL * rms_rel, 0.0)
    inconsistency_rel: Vector = uncertain / np.maximum(rms_rel, RESIDUAL_LIMIT)
    return inconsistency_rel


def _residual_limit_rel(rms_rel: Vector | float, motion_rel: Vector | float = 0.0) -> Vector:
    """Return the residual limit for a foot whose closures have this rms and motion [1]."""
    limit: Vector = RESIDUAL_LIMIT + motion_rel + np.multiply(RESIDUAL_LIMIT_REL, rms_rel)
    return limit


def floating_row_crosstalk_pf(capacitance_pf: Vector, opened: Mask) -> Vector:
    """Return the crosstalk of floating rows into the readings of the others [pF], shape (legs, elements).

    A row whose elements are open has lost its line. Its electrodes float, and each column sees them in series
    with their small capacitance to ground whichever row is selected: as much as the open element itself reads. An open
    element under the converter's range is on a board that grounds unselected columns: nothing is added there.

    Args:
        capacitance_pf: Readings, stray included [pF], shape (legs, elements), NaN under the range.
        opened: Open elements, shape (legs, elements).
    """
    floating = opened.reshape(-1, ROWS, ROWS).all(axis=2, keepdims=True)
    readings_pf = capacitance_pf.reshape(-1, ROWS, ROWS)
    per_column_pf = np.where(floating & ~np.isnan(readings_pf), readings_pf, 0.0).sum(axis=1, keepdims=True)
    added_pf: Vector = np.where(floating, 0.0, per_column_pf).reshape(opened.shape)
    return added_pf
