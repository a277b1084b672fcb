"""Whether the elements of a foot agree with each other, and which one does not.

A foot has nine elements and a load far fewer unknowns, so each closure follows roughly from the other eight. With
S = E[x x^T] over the loads of a foot, the least-squares prediction of x_i from all others leaves the residual
(S^-1 x)_i / (S^-1)_ii: one matrix product judges all elements at once. Over the loads that a foot is trained for this
is at most 14 % of the others' closures; in a walk, skew included, it comes to three quarters of the limit set here.

What disagrees more has a reason: an electrode that came off and no longer moves, one that drifts, a bit that was
flipped, a line that broke while the scan ran - or a load that steps while the elements are read one after the other.
The last passes within a few scans. So an element, row or column without which the rest agrees is left out at once;
one that stays in doubt is remembered, until it has agreed for a while both with a loaded foot and with a free one: at
rest, an element that is stuck at its zero is right, and under load, where more is tolerated, one that drifts may be. If
the rest does not agree either, the force is given, and its sigma is widened.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.estimation.faults.missing_sets import KNOWN_MISSING
from footsense.frames import ELEMENTS

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Residual that is no contradiction: of an element over its gap [1], and over the others' mean square root [1].
LIMIT, LIMIT_REL = 0.03, 0.4
#: The same over the root of the others' sum of squares.
_LIMIT_REL_OF_SUM = np.array(LIMIT_REL / math.sqrt(ELEMENTS))
#: Share of the largest residual that may stand in the force: in fast gaits and steps its root mean square is a third.
DOUBT_REL = 0.5
#: Closure that the others predict from which an element's motion can be judged [1].
MOVED = 0.08
#: How long an element has to agree, loaded and free each, until it is trusted again [ns].
TRUSTED_AFTER_NS = 300_000_000
#: By how much faster it loses that again while it disagrees [1].
FORGIVES_REL = 4
#: An element that moves less than this share of what the others predict is stuck [1].
STUCK_REL = 0.3

_SUMS_OF_BOTH = np.kron(np.eye(2), np.ones((ELEMENTS, 1)))
_SINGLE, _LINES = slice(1, 1 + ELEMENTS), slice(1 + ELEMENTS, None)
_N_KEPT = (~KNOWN_MISSING).sum(axis=1)


class Judgement(NamedTuple):
    """What the elements say of each other.

    Attributes:
        missing: What the force has to do without, shape (legs, 9): what was missing before, and who contradicts.
        doubt_rel: Share of the readings that contradicts the rest without a remembered reason, shape (legs,) [1].
        stuck: Elements that are remembered not to move, shape (legs, 9).
        drifting: Elements that are remembered to stand beside where they should, shape (legs, 9).
        well: Whether nothing is missing, in doubt or remembered.
    """

    missing: Mask
    doubt_rel: Vector
    stuck: Mask
    drifting: Mask
    well: bool


class Consistency:
    """Remembers which elements of each leg contradict the others.

    Args:
        n_legs: Legs in a frame.
        moments: S, as for `Filling`, shape (9, 9).
        settled_ns: Time after which readings from before a step are forgotten: a few scans [ns].
    """

    def __init__(self, n_legs: int, moments: Vector, settled_ns: int) -> None:
        self._moments = moments
        self._settled_ns = settled_ns
        self._precision: dict[bytes, Vector] = {}
        shape = (n_legs, ELEMENTS)
        self._without = np.stack([self._residual_matrix(missing) for missing in KNOWN_MISSING])
        self._whole = np.ascontiguousarray(self._without[0].T)
        self._residual_and_itself = np.hstack([self._whole, np.eye(ELEMENTS)])
        self._no_doubt = np.zeros(n_legs)
        self._trusted = True  # nobody is doubted or remembered
        self._doubted = np.zeros(shape, bool)
        self._doubted_since_ns = np.zeros(n_legs, np.int64)
        self._remembered = np.zeros(shape, bool)
        self._stuck = np.zeros(shape, bool)
        self._agreed_ns = np.zeros((n_legs, 2), np.int64)  # free, loaded
        self._t_ns = np.zeros(n_legs, np.int64)
        # Extremes of what each element did and of what the others predicted meanwhile: low, high.
        self._seen = np.zeros((2, *shape))
        self._predicted = np.zeros((2, *shape))

    @property
    def remembered(self) -> Mask:
        """Elements that a leg does without until they agree again, shape (legs, 9)."""
        return self._remembered

    def forget(self, legs: Mask) -> None:
        """Trust all elements of these legs again, shape (legs,): they have a new foot, or a new zero."""
        self._remembered[legs] = self._doubted[legs] = self._stuck[legs] = False

    def squares(self, closure_rel: Vector) -> Vector:
        """Return each leg's sum of squares of the residuals and of the closures [1], shape (legs, 2).

        Args:
            closure_rel: Closures over the gap [1], shape (legs, 9).
        """
        both = closure_rel @ self._residual_and_itself
        squares: Vector = both * both @ _SUMS_OF_BOTH
        return squares

    def judge(
        self, closure_rel: Vector, measured_rel: Vector, missing: Mask, t_ns: NDArray[np.int64]
    ) -> Judgement:
        """Return what one frame's elements say of each other.

        Args:
            closure_rel: Closures as of one time, over the gap [1], shape (legs, 9); a leg with a NaN that is not
                missing is not judged.
            measured_rel: The same as they were measured, for what is remembered and takes no part in the former.
            missing: What cannot be read, shape (legs, 9), `remembered` included.
            t_ns: Time of the frame for each leg [ns], shape (legs,).
        """
        if not self._trusted:
            closure_rel = np.where(self._remembered, measured_rel, closure_rel)
        residual = np.abs(closure_rel @ self._whole)
        sum_rel2 = np.add.reduce(closure_rel * closure_rel, axis=1, keepdims=True)
        # A NaN agrees with nothing; legs with one are looked at by themselves, like those that miss something.
        agrees = residual <= LIMIT + _LIMIT_REL_OF_SUM * np.sqrt(sum_rel2)
        if self._trusted and np.count_nonzero(agrees) == agrees.size and not np.count_nonzero(missing):
            self._t_ns = t_ns
            return Judgement(missing, self._no_doubt, missing, missing, well=True)
        troubled = ~agrees.all(axis=1) | missing.any(axis=1) | self._doubted.any(axis=1)
        doubt_rel = np.zeros(len(closure_rel))
        if troubled.any():
            missing = missing.copy()
            for leg in np.flatnonzero(troubled).tolist():
                doubt_rel[leg] = self._judge_leg(
                    leg, closure_rel[leg], measured_rel[leg], missing[leg], int(t_ns[leg])
                )
        self._t_ns = t_ns
        self._trusted = not (self._doubted.any() or self._remembered.any())
        if self._remembered.any():
            self._stuck |= self._remembered & self._does_not_move()
        return Judgement(missing, doubt_rel, self._stuck.copy(), self._remembered & ~self._stuck, well=False)

    def _judge_leg(
        self, leg: int, closure_rel: Vector, measured_rel: Vector, missing: Mask, t_ns: int
    ) -> float:
        """Write who contradicts into `missing`, shape (9,), and return how much is in doubt [1]."""
        if not np.isfinite(closure_rel[~missing]).all():
            return 0.0
        if self._remembered[leg].any():
            self._reconsider(leg, closure_rel, missing, t_ns)
            self._watch(leg, closure_rel, measured_rel, missing)
        contradiction = self._contradiction(closure_rel, missing)
        if contradiction <= 1.0:
            self._doubted[leg] = False
            return 0.0
        culprit = self._culprit(closure_rel, missing)
        doubted = culprit & ~missing
        if not np.array_equal(doubted, self._doubted[leg]):
            self._doubted[leg], self._doubted_since_ns[leg] = doubted, t_ns
            self._seen[:, leg], self._predicted[:, leg] = np.inf, np.inf
            self._seen[1, leg], self._predicted[1, leg] = -np.inf, -np.inf
        rms = float(np.sqrt(np.square(closure_rel[~missing]).mean()))
        doubt_rel = DOUBT_REL * contradiction * (LIMIT + LIMIT_REL * rms) / max(rms, LIMIT)
        missing |= culprit
        if not doubted.any():
            return doubt_rel
        self._watch(leg, closure_rel, measured_rel, missing)
        if t_ns - self._doubted_since_ns[leg] < self._settled_ns:
            return doubt_rel
        self._remembered[leg] |= doubted
        self._doubted[leg] = False
        self._agreed_ns[leg] = 0
        return 0.0

    def _reconsider(self, leg: int, closure_rel: Vector, missing: Mask, t_ns: int) -> None:
        """Count for how long the remembered elements have agreed with a foot that moves; forgive after a while."""
        remembered = self._remembered[leg]
        if not np.isfinite(closure_rel[remembered]).all():
            return
        passed_ns = min(t_ns - int(self._t_ns[leg]), self._settled_ns)
        if self._contradiction(closure_rel, missing & ~remembered) > 1.0:
            # Not all at once: what is measured lags behind what is predicted while the load changes.
            self._agreed_ns[leg] = np.maximum(self._agreed_ns[leg] - FORGIVES_REL * passed_ns, 0)
        else:
            largest = np.abs(self._predict(closure_rel, missing)[remembered]).max()
            self._agreed_ns[leg] += np.where([largest < LIMIT, largest > MOVED], passed_ns, 0)
        if (self._agreed_ns[leg] >= TRUSTED_AFTER_NS).all():
            missing &= ~remembered
            self._remembered[leg] = self._stuck[leg] = False

    def _watch(self, leg: int, closure_rel: Vector, measured_rel: Vector, missing: Mask) -> None:
        """Widen the extremes of what was measured and of what was predicted meanwhile."""
        predicted = self._predict(closure_rel, missing)
        for extremes, now in ((self._seen, measured_rel), (self._predicted, predicted)):
            extremes[0, leg] = np.fmin(extremes[0, leg], now)
            extremes[1, leg] = np.fmax(extremes[1, leg], now)

    def _predict(self, closure_rel: Vector, missing: Mask) -> Vector:
        """Return what the others say of those that are missing, shape (9,)."""
        known = np.where(missing, 0.0, closure_rel)
        kept = ~missing
        predicted = known.copy()
        if kept.any():
            read = self._moments[np.ix_(kept, kept)]
            predicted[missing] = self._moments[np.ix_(missing, kept)] @ np.linalg.solve(read, known[kept])
        return predicted

    def _does_not_move(self) -> Mask:
        seen, predicted = self._seen[1] - self._seen[0], self._predicted[1] - self._predicted[0]
        stands: Mask = (predicted > MOVED) & (seen < STUCK_REL * predicted)
        return stands

    def _contradiction(self, closure_rel: Vector, missing: Mask) -> float:
        """Return the largest residual of those that are not missing, over the limit [1]."""
        kept = closure_rel[~missing]
        if kept.size < 2:
            return 0.0
        residual = self._residual_matrix(missing) @ np.where(missing, 0.0, closure_rel)
        return float(np.abs(residual).max() / (LIMIT + LIMIT_REL * np.sqrt(np.square(kept).mean())))

    def _culprit(self, closure_rel: Vector, missing: Mask) -> Mask:
        """Return the smallest of those sets that a force can do without, without which the rest agrees; or `missing`.

        `missing` is part of it.
        """
        known = np.where(KNOWN_MISSING, 0.0, closure_rel)
        residual = np.abs(np.einsum("sij,sj->si", self._without, known)).max(axis=1)
        contradictions = residual / (LIMIT + LIMIT_REL * np.sqrt(np.square(known).sum(axis=1) / _N_KEPT))
        contradictions[(missing & ~KNOWN_MISSING).any(axis=1)] = np.inf
        for sets in (_SINGLE, _LINES):
            if contradictions[sets].min() <= 1.0:
                culprit: Mask = KNOWN_MISSING[sets][contradictions[sets].argmin()]
                return culprit
        return missing

    def _residual_matrix(self, missing: Mask) -> Vector:
        """Return R for R @ x: what each element reads beyond what the others predict; zero where missing."""
        key = missing.tobytes()
        if key not in self._precision:
            matrix = np.zeros((ELEMENTS, ELEMENTS))
            kept = np.flatnonzero(~missing)
            precision = np.linalg.inv(self._moments[np.ix_(kept, kept)])
            matrix[np.ix_(kept, kept)] = precision / precision.diagonal()[:, None]
            self._precision[key] = matrix
        return self._precision[key]
