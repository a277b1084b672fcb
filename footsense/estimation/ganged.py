"""Legs that are read column by column: what three sums say of nine closures, and which legs may be read like that.

A sum tells the mean closure of its column. What that means for each element, the loads of a foot tell: with
S = E[x x^T] of the closures and H the means of the columns, x = S H^T (H S H^T + R)^-1 m is the best linear guess;
R is how far the two older sums may be behind the newest one. These nine stand in for readings, so that all that
follows goes on through the change to single elements and back. What three sums cannot know, such as a load that leans
forward, goes into sigma. Good for small loads: a leg is taken back as soon as it is on the ground.

A sum is measured with the converter's CAPDAC on, whose error no data sheet bounds: it has an offset of its own. That is
learnt in confirmed swing, from the first three sums of the first time that a leg is ganged, and believed only when the
elements have seen the foot in the air afterwards as before. Every later time has to find it again, within `APART_PF`.
"""

import numpy as np
from numpy.typing import NDArray

from footsense.foot.capacitor import CapacitorDesign
from footsense.frames import ELEMENTS, CapFrame, Reading
from footsense.ports import Estimator

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: How long a foot has to be surely in the air and its zero to follow before it is ganged [ns]: some four scans.
SETTLED_NS = 100_000_000
#: How long a leg is ganged at most [ns]: its zero stands still meanwhile, and nobody looks at single elements.
LONGEST_NS = 2_000_000_000
#: Farthest that an offset moves from one time to the next [pF]: 2 mN on the foot, many times the noise of a sum.
APART_PF = 10e-3

_COLUMNS = 3
#: Variance by which a load that begins may set the newest sum apart from the older ones, over its own variance [1].
_OLDER_REL = 1.0
#: Oldest stamp that a stand-in may have, in scans: more would not belong together with the newest.
_LAG_SCANS = 1.2
#: Largest closure that stands in [1]; beyond it nothing is linear.
_LARGEST_REL = 0.9
#: Mean closure at which the network's sensitivity is taken [1], and by how much one element is moved there [1].
_STANCE_REL = 0.2
_MOVED_REL = 1e-3


class Ganged:
    """What is known of every leg's columns.

    Args:
        n_legs: Legs.
        moments: Second moments of the closures, shape (9, 9).
        design: The capacitors.
        scan_ns: Time of nine conversions [ns].
        unknown_rel: What three sums leave open of each component of a force, over its magnitude [1], shape (3,).

    Attributes:
        wanted: Legs that are to be ganged now, shape (legs,).
        standing_in: Legs of the last frame whose elements are not, or not all, read one by one, shape (legs,).
    """

    def __init__(
        self, n_legs: int, moments: Vector, design: CapacitorDesign, scan_ns: int, unknown_rel: Vector
    ) -> None:
        self.wanted: Mask = np.zeros(n_legs, bool)
        self.standing_in: Mask = np.zeros(n_legs, bool)
        self._spread = _spread(moments)
        self._design = design
        self._lag_ns = round(_LAG_SCANS * scan_ns)
        self._unknown_rel = unknown_rel
        self._offset_pf = np.full((n_legs, _COLUMNS), np.nan)
        self._proposed_pf = np.full((n_legs, _COLUMNS), np.nan)
        self._compared = np.zeros(n_legs, bool)
        self._refused = np.zeros(n_legs, bool)
        self._since_ns = np.zeros(n_legs, np.int64)
        self._aloft_ns = np.zeros(n_legs, np.int64)
        self._shown_ns = np.zeros((n_legs, ELEMENTS), np.int64)
        self._elements_pf = np.full((n_legs, ELEMENTS), np.nan)
        self._elements_ns = np.zeros((n_legs, ELEMENTS), np.int64)

    def stand_in(self, scan: CapFrame, baseline_pf: Vector, stray_pf: Vector) -> CapFrame:
        """Return a frame without column sums: what they say of the elements stands in their places.

        A stand-in has the stamp of the last sum that was read in its place, as an element would; only where that is
        too old, the stamp of the newest sum, which went into it too.

        Args:
            scan: As it was read.
            baseline_pf: Unloaded elements without stray [pF], shape (legs, 9).
            stray_pf: What is in parallel with each [pF], shape (legs, 9).
        """
        ganged = scan.reading == Reading.GANGED
        self.standing_in = ganged.any(axis=1)
        whole = ~self.standing_in[:, None]
        self._elements_pf = np.where(whole, scan.capacitance_pf, self._elements_pf)
        self._elements_ns = np.where(whole, scan.t_ns, self._elements_ns)
        if not self.standing_in.any():
            return scan
        t_ns, capacitance_pf = scan.t_ns.copy(), scan.capacitance_pf.copy()
        for leg in np.flatnonzero(self.standing_in).tolist():
            own_ns = np.where(ganged[leg], scan.t_ns[leg], 0)
            newest_ns = int(own_ns.max())
            replaced = ganged[leg] | (scan.reading[leg] == Reading.OK) & (scan.t_ns[leg] < newest_ns)
            pf = self._sums(leg, own_ns, capacitance_pf[leg], baseline_pf[leg], stray_pf[leg])
            if pf is None:
                t_ns[leg, ganged[leg]] = self._elements_ns[leg, ganged[leg]]
                capacitance_pf[leg, ganged[leg]] = self._elements_pf[leg, ganged[leg]]
                continue
            closure_rel = self._closures(pf, int(own_ns.argmax()) % _COLUMNS, baseline_pf[leg])
            distance_rel = self._design.plate_distance_um(baseline_pf[leg]) / self._design.gap_um
            pf_now = baseline_pf[leg] * distance_rel / (distance_rel - closure_rel) + stray_pf[leg]
            capacitance_pf[leg, replaced] = pf_now[replaced]
            shown_ns = np.maximum(self._shown_ns[leg], t_ns[leg])
            freed = bool((scan.t_ns[leg] > newest_ns).any())
            too_old = freed | (newest_ns - shown_ns > self._lag_ns)
            shown_ns = np.where(replaced & too_old, np.maximum(shown_ns, newest_ns), shown_ns)
            self._shown_ns[leg] = t_ns[leg] = shown_ns
        reading = np.where(ganged, np.uint8(Reading.OK), scan.reading)
        return CapFrame(scan.sequence, t_ns, capacitance_pf, reading)

    def widen(self, sigma_n: Vector, force_n: Vector) -> Vector:
        """Return sigmas of all legs with what sums leave open [N], shape (legs, 3)."""
        open_n = self._unknown_rel * np.linalg.norm(force_n, axis=1, keepdims=True)
        return np.where(self.standing_in[:, None], np.hypot(sigma_n, open_n), sigma_n)

    def decide(self, aloft: Mask, followed: Mask, free: Mask, now_ns: int) -> None:
        """Say anew which legs are to be ganged.

        Args:
            aloft: Legs that are surely in the air, shape (legs,).
            followed: Whose zero follows, same shape.
            free: Who is not in contact, whose force is valid, and of whom nothing else is wanted, same shape.
            now_ns: The time now [ns].
        """
        self._proposed_pf[~aloft] = np.nan
        self._aloft_ns[aloft] = now_ns
        waits = aloft & free & followed & ~self.standing_in & ~self.wanted
        lasted_ns = now_ns - self._since_ns
        begins = waits & (lasted_ns >= SETTLED_NS)
        # What comes down is read fastest as it is, until it is down; what only hovers is looked at closely.
        hovers = now_ns - self._aloft_ns > self._lag_ns
        ends = self.wanted & (~free | hovers | self._refused | (lasted_ns >= LONGEST_NS))
        # The clock runs while a leg waits and while it is ganged.
        self._since_ns[begins | ends | ~(waits | self.wanted)] = now_ns
        if begins.any():
            confirmed = begins[:, None] & np.isfinite(self._proposed_pf)
            self._offset_pf = np.where(confirmed, self._proposed_pf, self._offset_pf)
            self._proposed_pf[begins] = np.nan
            self._compared[begins] = self._refused[begins] = False
        self.wanted = (self.wanted | begins) & ~ends

    def _sums(
        self, leg: int, own_ns: NDArray[np.int64], pf: Vector, baseline_pf: Vector, stray_pf: Vector
    ) -> Vector | None:
        """Return what each column has gained over the free foot [pF], shape (3,); None while that is being learnt.

        A column whose sum has not been read yet still has its three elements.
        """
        by_row = own_ns.reshape(-1, _COLUMNS)
        columns = np.arange(_COLUMNS)
        read = by_row.max(axis=0) > 0
        free_pf = (baseline_pf + stray_pf).reshape(-1, _COLUMNS).sum(axis=0)
        beyond_pf = pf.reshape(-1, _COLUMNS)[by_row.argmax(axis=0), columns] - free_pf
        if read.all() and not self._compared[leg]:
            self._compared[leg] = True
            apart_pf = np.abs(beyond_pf - self._offset_pf[leg])
            if (apart_pf <= APART_PF).all():
                self._offset_pf[leg] = beyond_pf
            else:  # a NaN is apart from everything
                self._proposed_pf[leg] = beyond_pf
                self._refused[leg] = True
        if np.isnan(self._offset_pf[leg]).any():
            return None
        elements_pf = pf.reshape(-1, _COLUMNS).sum(axis=0) - free_pf
        gained_pf: Vector = np.where(read, beyond_pf - self._offset_pf[leg], elements_pf)
        return gained_pf

    def _closures(self, gained_pf: Vector, newest: int, baseline_pf: Vector) -> Vector:
        """Return the nine closures over the gap [1] that fit best, shape (9,)."""
        free_pf = baseline_pf.reshape(-1, _COLUMNS).sum(axis=0)
        distance_rel = self._design.plate_distance_um(free_pf / (ELEMENTS // _COLUMNS)) / self._design.gap_um
        # Of three alike, which they are while little presses them.
        mean_rel = distance_rel * gained_pf / (free_pf + gained_pf)
        closure_rel: Vector = np.minimum(self._spread[newest] @ mean_rel, _LARGEST_REL)
        return closure_rel


def _means() -> Vector:
    """Return H, shape (3, 9)."""
    return np.equal.outer(np.arange(_COLUMNS), np.arange(ELEMENTS) % _COLUMNS) * (_COLUMNS / ELEMENTS)


def _spread(moments: Vector) -> Vector:
    """Return the matrices from column means to closures, one for each newest column, shape (3, 9, 3)."""
    means = _means()
    variance = means @ moments @ means.T
    older = _OLDER_REL * np.diag(variance.diagonal())
    return np.stack(
        [
            np.linalg.solve(variance + older * (np.arange(_COLUMNS) != newest), means @ moments).T
            for newest in range(_COLUMNS)
        ]
    )


def unknown_rel(estimator: Estimator, n_rows: int, moments: Vector) -> Vector:
    """Return what three column sums leave open of each component of a force, over its magnitude [1], shape (3,).

    Args:
        estimator: The network.
        n_rows: How many feet it estimates at once.
        moments: Second moments of the closures of its loads, shape (9, 9).
    """
    axes, directions = np.linalg.eigh(moments)
    stance_rel = np.abs(directions[:, axes.argmax()])
    stance_rel *= _STANCE_REL / stance_rel.max()
    whole = np.zeros((n_rows, ELEMENTS), bool)

    def force_n(closure_rel: Vector) -> Vector:
        forces_n, _ = estimator.estimate(np.tile(closure_rel, (n_rows, 1)), whole)
        first_n: Vector = forces_n[0].copy()
        return first_n

    slopes = np.array(
        [force_n(stance_rel + one) - force_n(stance_rel - one) for one in _MOVED_REL * np.eye(ELEMENTS)]
    )
    means = _means()
    told = moments @ means.T @ np.linalg.solve(means @ moments @ means.T, means @ moments)
    left_n2 = np.einsum("ia,ij,ja->a", slopes, moments - told, slopes)
    whole_n2 = np.einsum("ia,ij,ja->", slopes, moments, slopes)
    left_rel: Vector = np.sqrt(np.maximum(left_n2, 0.0) / whole_n2)
    return left_rel
