"""Which elements of the feet can be used: by their readings alone, and by those of the other elements.

**Masks of elements**, each of the shape (legs, elements):

- `opened`, `over_range`: what the reading alone shows. Pressing adds capacitance, and a force that leans, of 1.5 times
  the range with the friction of rubber, takes 57 % of it at most: an element that has lost 65 % is open.
- `overloaded`: over-range ones, and those with a larger closure than the network was trained for.
- `excluded`: elements that have contradicted the others, until they agree again.
- `unusable`: what a tare leaves out: sets with open or excluded elements, and with over-range ones without a baseline.
- `missing`: what the network does without, always one of `MISSING_SETS` or nothing: sets with open or excluded
  elements and those without a baseline; the pipeline adds those whose readings are interrupted.

**By the other elements.** A foot has nine elements and a load far fewer unknowns, so each closure follows roughly from
the others. With S = E[x x^T] over the loads of a foot, the least-squares prediction of x_i from all others leaves the
residual (S^-1 x)_i / (S^-1)_ii: one matrix product tests all elements at once. Over the loads that a foot is trained
for the residual is at most 14 % of the others' closures.

The elements are read one after the other, so a load in motion leaves a residual as well, at most about as large as the
closures move from one reading to the next: the limit is wider by that. A larger residual has a cause: an electrode that
came off and no longer moves, one that drifts, a flipped bit, or a line that broke during the scan. The smallest set of
elements without which the rest is consistent is named. An impact of some milliseconds, which two or three elements see,
leaves the same residual for a scan.

So there is evidence against each element. A reading of it adds some while it is named, takes some away while others are
named, and all where the foot is consistent. From three such readings on, if it stands still, the element is excluded:
the network does without it. Then evidence goes slowly, that of an unloaded and that of a loaded foot each by its own
readings: unloaded, an element stuck at its baseline reads right, and under load, where the limit is wider, a drifting
one may. A foot that stands or hangs for long shows only one of both: the other evidence goes too, in a thousand scans.
Where no set explains the residuals, the state stays and sigma is wider. It is so from a quarter of the limit on: an
element that has just come off, and stands still under a load that rolls away, is wrong before it contradicts others.

An element that drifts slowly under a foot that stands is wrong long before it contradicts the others. But no load moves
one element alone: from the limit at which a residual is in sigma, one that has moved while no other has moved by a
quarter of that, since the foot last moved, is drifting, and each of its readings is a little evidence.

An overloaded element is closed at least as far as it reads. It predicts no other, and contradicts only if the others
predict less: then it is shorted, or its gap is full of water.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.estimation.missing_elements import (
    CONTAINING,
    MAX_OVERLOADED,
    MISSING_SETS,
    SMALLEST_CONTAINING,
    Imputation,
    patterns_of,
    remembered,
)
from footsense.estimation.network import Readings
from footsense.estimation.settings import CLEAR_MOTION_REL, RESIDUAL_LIMIT, SMALL_SHARE, MountedFeet
from footsense.frames import ELEMENTS, ROWS, CapFrame, Mask, Reading, Vector

#: Capacitance below which an element is open, over its unloaded capacitance [1].
OPEN_ELEMENT_THRESHOLD_REL = 0.35

#: Limit of an element's residual beside `RESIDUAL_LIMIT`, over the root mean square of the others [1].
RESIDUAL_LIMIT_REL = 0.4
#: Residual from which it is added to sigma, a third and a quarter of that: sigma of healthy feet in a tripod gait grows
#: by 3 %.
UNCERTAIN_RESIDUAL, UNCERTAIN_RESIDUAL_REL = RESIDUAL_LIMIT / 3.0, RESIDUAL_LIMIT_REL / 4.0
#: Evidence against an element from which it is excluded, and the most that is kept [readings]. A reading that
#: contradicts the others adds one.
ENOUGH_EVIDENCE = 3.0
#: Share of the evidence of a reading that agrees with the others at another load, and of one of an element that moves
#: while the others stand still [1].
SLOW_SHARE = 1.0 / 64.0

# Of each set: the elements that it keeps, their shares of a mean, and that smaller sets go first.
_KEPT: Vector = (~MISSING_SETS).astype(float)
_SHARES_OF_KEPT: Vector = _KEPT / _KEPT.sum(axis=1, keepdims=True)
_RANK: Vector = MISSING_SETS.sum(axis=1).astype(float)
_ALL_SETS = np.arange(len(MISSING_SETS))[None]
# Plain numbers: to compare with an enumeration's member costs a microsecond each time.
_OVER_RANGE, _UNDER_RANGE = int(Reading.OVER_RANGE), int(Reading.UNDER_RANGE)


class ElementStatus(NamedTuple):
    """Status of every element in a frame by its reading, shape (legs, elements) each.

    Attributes:
        capacitance_pf: Capacitances without stray [pF], NaN where there is none to be used.
        opened: Elements whose electrode is disconnected.
        over_range: Elements above the converter's range.
    """

    capacitance_pf: Vector
    opened: Mask
    over_range: Mask


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
        self._opened: Mask = np.zeros(feet.stray_pf.shape, bool)

    def classify(self, scan: CapFrame) -> ElementStatus:
        """Return the status of the elements of a frame."""
        capacitance_pf = scan.capacitance_pf - self._stray_pf
        # NaN compares as False: an element that was not read is not open.
        opened, over_range = _opened_and_over_range(capacitance_pf < self._open_below_pf, scan.reading)
        before, self._opened = self._opened, opened
        if np.count_nonzero(over_range):
            # At least that much: the consistency test decides whether it can be.
            np.copyto(capacitance_pf, self._range_end_pf, where=over_range)
        # A line that breaks or returns was intact for a part of the scan, and so was its effect on other elements.
        unsettled = opened
        if opened is not before:
            unsettled = opened | np.logical_or.reduce(opened != before, axis=1, keepdims=True)
        if np.count_nonzero(unsettled):
            capacitance_pf -= floating_row_crosstalk_pf(scan.capacitance_pf, opened)
            # In the window, an unsettled reading would be a step of the load.
            capacitance_pf[unsettled] = np.nan
        return ElementStatus(capacitance_pf, opened, over_range)


@remembered
def _opened_and_over_range(is_low: Mask, reading: Mask) -> tuple[Mask, Mask]:
    codes = reading.view(np.uint8)
    return is_low | (codes == _UNDER_RANGE), codes == _OVER_RANGE


class ConsistencyResult(NamedTuple):
    """Result of the residual test of all legs.

    Attributes:
        missing: Elements that the network does without, shape (legs, elements).
        inconsistency_sigma_rel: Sigma to add, over the force, for residuals that no missing element explains, shape
            (legs,) [1].
    """

    missing: Mask
    inconsistency_sigma_rel: Vector


class _Choice(NamedTuple):
    """Sets of elements to do without, and what the residuals follow from beside the closures.

    Attributes:
        missing: The elements of each leg's first set, shape (legs, elements).
        error_amplification: How far one wrong reading moves each leg's closures then, over itself [1].
        has_few_overloaded: Whether few enough elements are overloaded for a test, shape (legs,).
        overloaded: The overloaded elements.
        kept, shares_of_kept: The elements that each set keeps, and their shares of a mean, shape (legs, k, 9).
        predictors: As of `Imputation.residuals`, shape (legs, k, 9, 9).
    """

    missing: Mask
    error_amplification: list[float]
    has_few_overloaded: Mask
    overloaded: Mask
    kept: Vector
    shares_of_kept: Vector
    predictors: Vector


class ConsistencyTest:
    """Residual test of every leg's elements in each frame; keeps the evidence against each of them.

    Args:
        n_legs: Legs in a frame.
        imputation: Imputation of missing closures.

    Attributes:
        excluded: Elements that contradict the others, until the evidence against them is gone.
        stuck: Those that do not follow the load; the others follow it with an offset.
    """

    def __init__(self, n_legs: int, imputation: Imputation) -> None:
        self._imputation = imputation
        self._choice = remembered(self._choice_of)
        shape = (n_legs, ELEMENTS)
        self._legs = np.arange(n_legs)
        # Against each element, of an unloaded and of a loaded foot.
        self._evidence = np.zeros((2, *shape))
        self._has_evidence = False
        self._t_of_readings_ns = np.zeros(shape, np.int64)
        # Closures when the foot last moved, and the time of the newest of them.
        self._rested_rel = np.zeros(shape)
        self._rested_ns = np.zeros(n_legs, np.int64)
        self._moves_alone: Mask = np.zeros(shape, bool)
        self.excluded = np.zeros(shape, bool)
        self.stuck = np.zeros(shape, bool)
        # While there is evidence: the smallest and the largest of each element's measured and predicted closures.
        self._extremes = np.multiply.outer([np.inf, -np.inf], np.ones((2, *shape)))

    def reset(self, legs: Mask) -> None:
        """Readmit all elements of the legs in a mask, shape (legs,), after a change of foot or baseline."""
        self.excluded[legs] = self.stuck[legs] = False
        self._evidence[:, legs] = 0.0

    def test(
        self, closure_rel: Vector, readings: Readings, unusable: Mask, overloaded: Mask
    ) -> ConsistencyResult:
        """Test the elements of a frame.

        Args:
            closure_rel: Newest closures over the gap [1], shape (legs, elements); a leg with a NaN that is not unusable
                is not tested.
            readings: The readings that they are of.
            unusable: Sets of elements that the network does without anyway.
            overloaded: Elements that are closed at least as far as they read.
        """
        choice = self._choice(unusable, overloaded)
        tested, unread = choice.has_few_overloaded, np.isnan(closure_rel)
        if np.count_nonzero(unread):
            closure_rel = np.where(unread, 0.0, closure_rel)
            tested = tested & ~np.logical_or.reduce(unread > unusable, axis=1)
        # In plain Python numbers: for six legs, arrays take longer.
        motion, are_tested = readings.second_largest_motion_rel.tolist(), tested.tolist()
        _, largest, rms_rel = self._residuals(closure_rel, choice)
        residual_and_rms = largest[:, 0].tolist(), rms_rel[:, 0].tolist()
        excess = [
            residual - RESIDUAL_LIMIT - RESIDUAL_LIMIT_REL * rms
            for residual, rms in zip(*residual_and_rms, strict=True)
        ]
        tests = zip(excess, motion, are_tested, strict=True)
        contradicted = [is_tested and each > moved for each, moved, is_tested in tests]
        moves_alone = self._test_alone(closure_rel, readings, unusable, tested)
        if self._has_evidence or True in contradicted or np.count_nonzero(moves_alone):
            # What only motion explains is no evidence for an element.
            agrees = tested & (np.array(excess) <= 0.0) & ~np.logical_or.reduce(moves_alone, axis=1)
            of_legs = np.array(contradicted), agrees
            self._weigh(closure_rel, readings, unusable, choice.overloaded, moves_alone, *of_legs)
            choice = self._choice(unusable | self.excluded, overloaded)
            _, largest, rms_rel = self._residuals(closure_rel, choice)
            residual_and_rms = largest[:, 0].tolist(), rms_rel[:, 0].tolist()
        columns = zip(*residual_and_rms, motion, choice.error_amplification, are_tested, strict=True)
        sigmas_rel = [
            factor * _inconsistency_sigma_rel(residual, rms, moved) if is_tested else 0.0
            for residual, rms, moved, factor, is_tested in columns
        ]
        return ConsistencyResult(choice.missing, np.array(sigmas_rel))

    def _choice_of(self, unusable: Mask, overloaded: Mask) -> _Choice:
        sets = SMALLEST_CONTAINING[patterns_of(unusable)][:, None]
        return self._choice_of_sets(sets, overloaded > unusable)

    def _choice_of_sets(self, sets: NDArray[np.intp], overloaded: Mask) -> _Choice:
        first = sets[:, 0]
        return _Choice(
            MISSING_SETS[first],
            self._imputation.error_amplification[first].tolist(),
            np.add.reduce(overloaded, axis=1) <= MAX_OVERLOADED,
            overloaded,
            _KEPT[sets],
            _SHARES_OF_KEPT[sets],
            # Overloaded elements predict no other, nor do those of the set.
            self._imputation.residuals[patterns_of(MISSING_SETS)[sets] | patterns_of(overloaded)[:, None]],
        )

    def _test_alone(self, closure_rel: Vector, readings: Readings, unusable: Mask, tested: Mask) -> Mask:
        """Return the tested elements that have moved since the others last did: no load moves one alone."""
        moved_rel = np.abs(closure_rel - self._rested_rel)
        ordered_rel = moved_rel.copy()
        ordered_rel.partition(ELEMENTS - 2, axis=1)
        for leg, second_rel in enumerate(ordered_rel[:, ELEMENTS - 2].tolist()):
            if second_rel > SMALL_SHARE * UNCERTAIN_RESIDUAL:
                self._rested_rel[leg], self._rested_ns[leg] = closure_rel[leg], readings.newest_ns[leg]
                moved_rel[leg] = 0.0
        alone: Mask = moved_rel > UNCERTAIN_RESIDUAL
        self._moves_alone, before = alone, self._moves_alone
        if np.count_nonzero(alone):
            # The elements are read one after the other; one that is excluded for another reason moves when it is back.
            is_read = readings.oldest_of_newest_ns > self._rested_ns
            alone &= is_read[:, None] & ~unusable & (~self.excluded | before)
            alone = alone & tested[:, None]
        return alone

    def _residuals(self, closure_rel: Vector, choice: _Choice) -> tuple[Vector, Vector, Vector]:
        """Return the residuals without sets of elements, and of those that are kept the largest, and the closures' rms.

        Shapes are (legs, k, 9) and (legs, k).
        """
        residual = np.matmul(choice.predictors, closure_rel[:, None, :, None])[..., 0]
        if np.count_nonzero(choice.overloaded):
            residual = np.where(choice.overloaded[:, None], np.maximum(residual, 0.0), residual)
        largest = np.maximum.reduce(np.abs(residual) * choice.kept, axis=2)
        rms_rel = np.sqrt(np.matmul(choice.shares_of_kept, np.square(closure_rel)[..., None])[..., 0])
        return residual, largest, rms_rel

    def _weigh(
        self,
        closure_rel: Vector,
        readings: Readings,
        unusable: Mask,
        overloaded: Mask,
        moves_alone: Mask,
        contradicted: Mask,
        agrees: Mask,
    ) -> None:
        """Try each set, and add the evidence of readings that contradict, that others explain, and that agree.

        Args:
            closure_rel: Newest closures over the gap [1], finite, shape (legs, elements).
            readings: The readings that they are of.
            unusable: Sets of elements that the network does without anyway.
            overloaded: Elements that are closed at least as far as they read.
            moves_alone: Elements that move while the foot stands still.
            contradicted: Legs whose closures contradict one another, shape (legs,).
            agrees: Legs whose closures do not, without regard to motion, shape (legs,).
        """
        legs, evidence, excluded = self._legs, self._evidence, self.excluded
        every = self._choice_of_sets(_ALL_SETS, overloaded)
        residual, largest, rms_rel = self._residuals(closure_rel, every)
        limit = RESIDUAL_LIMIT + RESIDUAL_LIMIT_REL * rms_rel + readings.second_largest_motion_rel[:, None]
        share = largest / limit
        rank = np.where(CONTAINING[patterns_of(unusable)] & (share <= 1.0), share + _RANK, np.inf)
        best = rank.argmin(axis=1)
        explained = (contradicted & (rank[legs, best] < np.inf))[:, None]
        named = MISSING_SETS[best] & ~unusable & explained
        predicted_rel = closure_rel - residual[legs, SMALLEST_CONTAINING[patterns_of(unusable | excluded)]]
        t_ns = readings.t_ns[0]
        is_new = t_ns != self._t_of_readings_ns
        self._t_of_readings_ns = t_ns.copy()
        against = named.astype(float) - (explained & ~(named | excluded))
        against = np.maximum(against, SLOW_SHARE * moves_alone)
        evidence += against * is_new
        np.minimum(evidence, ENOUGH_EVIDENCE, out=evidence)
        is_unloaded, is_loaded = predicted_rel < RESIDUAL_LIMIT, predicted_rel > CLEAR_MOTION_REL
        slow = SMALL_SHARE * SLOW_SHARE * ~(self.stuck & is_unloaded)
        lost = np.where([is_unloaded, is_loaded], SMALL_SHARE, slow)
        evidence -= np.where(excluded, lost, ENOUGH_EVIDENCE) * (agrees[:, None] & is_new)
        np.maximum(evidence, 0.0, out=evidence)
        most = np.maximum(*evidence)
        still_below_rel = SMALL_SHARE * np.abs(residual[legs, best])
        # A NaN is not larger.
        moves = np.logical_or.reduce(np.abs(readings.changes_rel) >= still_below_rel)
        confirmed = named & is_new & ~moves & (most >= ENOUGH_EVIDENCE)
        confirmed |= moves_alone & (most >= ENOUGH_EVIDENCE)
        self.excluded = (excluded | confirmed) & (most > 0.0)
        self._has_evidence = bool(np.count_nonzero(most))
        self._tell_stuck(closure_rel, predicted_rel, named)

    def _tell_stuck(self, closure_rel: Vector, predicted_rel: Vector, named: Mask) -> None:
        """Tell which excluded elements hardly move while the others predict motion."""
        smallest, largest = self._extremes
        watched = named | self.excluded
        both = np.array([closure_rel, predicted_rel])
        smallest[...] = np.where(watched, np.minimum(smallest, both), np.inf)
        largest[...] = np.where(watched, np.maximum(largest, both), -np.inf)
        measured, predicted = largest - smallest
        is_stuck = (predicted > CLEAR_MOTION_REL) & (measured < SMALL_SHARE * predicted)
        self.stuck = self.excluded & (self.stuck | is_stuck)


def _inconsistency_sigma_rel(residual: float, rms_rel: float, motion_rel: float) -> float:
    """Return sigma over the force [1] for the largest residual of a foot whose closures have this rms and motion."""
    uncertain = residual - motion_rel - UNCERTAIN_RESIDUAL - UNCERTAIN_RESIDUAL_REL * rms_rel
    return uncertain / max(rms_rel, RESIDUAL_LIMIT) if uncertain > 0.0 else 0.0


def floating_row_crosstalk_pf(capacitance_pf: Vector, opened: Mask) -> Vector:
    """Return the crosstalk of floating rows into the readings of the others [pF], shape (legs, elements).

    A row whose elements are open has lost its line. Its electrodes float, and each column sees them in series
    with their small capacitance to ground whichever row is selected: as much as the open element itself reads. An open
    element under the converter's range is on a board that grounds unselected columns: nothing is added there.

    Args:
        capacitance_pf: Readings, stray included [pF], shape (legs, elements), NaN under the range.
        opened: Open elements, shape (legs, elements).
    """
    floating = np.logical_and.reduce(opened.reshape(-1, ROWS, ROWS), axis=2, keepdims=True)
    if not np.count_nonzero(floating):
        return np.zeros(opened.shape)
    readings_pf = capacitance_pf.reshape(-1, ROWS, ROWS)
    per_column_pf = np.where(floating & ~np.isnan(readings_pf), readings_pf, 0.0).sum(axis=1, keepdims=True)
    added_pf: Vector = np.where(floating, 0.0, per_column_pf).reshape(opened.shape)
    return added_pf
