"""Instants of a walking foot's stances: nine readings interpolated to one time, and how far off each may be.

The elements are read one after the other, and a load moves meanwhile. Each element's readings are interpolated to the
time of an instant by the cubic through the two before and the two behind it. Its error is taken as 0.07 of the third
difference of the four readings. Next to a kink, that of the neighbouring instants counts.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple, Self

import numpy as np

from footsense.estimation.elements import OPEN_ELEMENT_THRESHOLD_REL
from footsense.estimation.settings import READING_NOISE_PF
from footsense.frames import ELEMENTS, IS_USABLE_STATE, Cycle, Flag, Mask, Stamps, Vector

#: Most instants of a stance, one of each part.
N_PARTS = 3
#: Least mean change of the readings over that of the usual peak, and largest second difference over the change [1].
_MIN_CHANGE_REL, _MAX_CURVATURE_REL = 0.2, 0.04
#: Error of the cubic over the third difference, and of a straight line over the second [1].
_CUBIC_ERROR, _LINE_ERROR = 0.07, 0.125
#: Neighbours on each side whose error may be an instant's as well.
_NEIGHBOURS = 2
#: Scans in the air that end a stance; those after it in which rubber still recovers.
_MIN_SWING_SCANS, _RECOVERING_SCANS = 12, 8
#: Scans around a stance that its interpolation needs, and most scans that are kept: a robot that stands has no stances.
_MARGIN_SCANS, _MAX_SCANS = 4, 2000
#: Least share of a stance's scans with a reading beyond the converter's range that make it a saturated one [1].
_SATURATED_REL = 0.1
#: Weight of the newest swing in the unloaded readings, and of the newest stance in the usual peak [1].
_NEWEST_WEIGHT = 0.3


class Instants(NamedTuple):
    """Instants of one foot.

    Attributes:
        t_ns: Times [ns], shape (n,).
        capacitance_pf: Nine readings at each [pF], shape (n, 9).
        baseline_pf: Unloaded readings then [pF], shape (n, 9).
        sigma_pf: Standard deviation of the readings by noise and interpolation [pF], shape (n, 9).
        part: Part of its stance that each is from, 0 to 2, shape (n,).
    """

    t_ns: Stamps
    capacitance_pf: Vector
    baseline_pf: Vector
    sigma_pf: Vector
    part: Stamps

    @classmethod
    def joined(cls, several: Sequence[Self]) -> Self:
        """Return instants as one set, in the order given."""
        none = np.zeros(0, np.int64), *np.zeros((3, 0, ELEMENTS)), np.zeros(0, np.int64)
        return cls(*map(np.concatenate, zip(none, *several, strict=True)))

    def subset(self, which: Mask | slice) -> "Instants":
        """Return some of the instants."""
        return Instants._make(values[which] for values in self)


class LegScans(NamedTuple):
    """Readings of one leg, frame by frame.

    Attributes:
        t_ns: Middle of each conversion [ns], shape (n, 9).
        capacitance_pf: Readings [pF], shape (n, 9), NaN unless OK.
        hangs: Whether the service said that the foot is in the air, shape (n,).
    """

    t_ns: Stamps
    capacitance_pf: Vector
    hangs: Mask

    @classmethod
    def of_cycles(cls, cycles: Sequence[Cycle]) -> list[Self]:
        """Return the scans of every leg in some cycles."""
        t_ns = np.stack([cycle.scan.t_ns for cycle in cycles], axis=1)
        capacitance_pf = np.stack([cycle.scan.capacitance_pf for cycle in cycles], axis=1)
        contact = np.stack([cycle.forces.flags & Flag.CONTACT for cycle in cycles], axis=1) != 0
        usable = IS_USABLE_STATE[np.stack([cycle.forces.state for cycle in cycles], axis=1)]
        return [cls(*leg) for leg in zip(t_ns, capacitance_pf, usable & ~contact, strict=True)]

    def subset(self, which: slice) -> "LegScans":
        """Return some of the scans."""
        return LegScans._make(values[which] for values in self)


class StanceSampler:
    """Takes instants of each stance of one foot as soon as it has ended.

    An element that reads far below the free foot is open, and its readings are none.

    Args:
        unloaded_pf: Readings of the free foot [pF], shape (9,).

    Attributes:
        baseline_pf: Unloaded readings of the last swings [pF], shape (9,); NaN before the first.
        n_stances: Stances so far.
        n_saturated: Those of them in which an element was beyond its range, or open.
    """

    def __init__(self, unloaded_pf: Vector) -> None:
        self._open_below_pf = OPEN_ELEMENT_THRESHOLD_REL * unloaded_pf
        self.baseline_pf: Vector = np.full(ELEMENTS, np.nan)
        self.n_stances = self.n_saturated = 0
        self._scans: LegScans | None = None
        self._peak_pf = 0.0
        # Which of the good instants of a part is taken is left to chance, so that other loads come as well.
        self._random = np.random.default_rng(0)

    def add(self, scans: LegScans, not_before_ns: int = 0) -> Instants:
        """Return the instants of the stances that end within further scans.

        Args:
            scans: The scans, behind those of the last call.
            not_before_ns: Time before which stances have no instants [ns].
        """
        opened = scans.capacitance_pf < self._open_below_pf
        scans = scans._replace(capacitance_pf=np.where(opened, np.nan, scans.capacitance_pf))
        if self._scans is not None:
            scans = LegScans._make(map(np.concatenate, zip(self._scans, scans, strict=True)))
        found, first = list[Instants](), 0
        for begin, end in _stances(scans.hangs):
            self._see_swing(scans.capacitance_pf[first + _RECOVERING_SCANS : begin])
            stance = scans.subset(slice(begin - _MARGIN_SCANS, end + _MARGIN_SCANS))
            is_due = begin - first >= _MARGIN_SCANS and stance.t_ns[-1].max() >= not_before_ns
            if is_due and np.isfinite(self.baseline_pf).all():
                found.append(self._of_stance(stance))
            first = end
        self._scans = scans.subset(slice(max(first, len(scans.hangs) - _MAX_SCANS), None))
        return Instants.joined(found)

    def _see_swing(self, capacitance_pf: Vector) -> None:
        whole_pf = capacitance_pf[np.isfinite(capacitance_pf).all(axis=1)]
        if len(whole_pf) >= _MARGIN_SCANS:
            seen_pf = np.median(whole_pf, axis=0)
            known = np.isfinite(self.baseline_pf)
            self.baseline_pf = np.where(
                known, self.baseline_pf + _NEWEST_WEIGHT * (seen_pf - self.baseline_pf), seen_pf
            )

    def _of_stance(self, scans: LegScans) -> Instants:
        self.n_stances += 1
        self.n_saturated += bool(np.isnan(scans.capacitance_pf).any(axis=1).mean() > _SATURATED_REL)
        t_ns = scans.t_ns.mean(axis=1).astype(np.int64)[_MARGIN_SCANS:-_MARGIN_SCANS]
        capacitance_pf, second_pf, third_pf = _interpolated(scans, t_ns)
        change_pf = capacitance_pf - self.baseline_pf
        mean_pf = change_pf.mean(axis=1)
        if not np.isfinite(mean_pf).any():
            return Instants.joined([])
        peak_pf = float(np.nanmax(mean_pf))
        self._peak_pf += (1.0 if self._peak_pf == 0.0 else _NEWEST_WEIGHT) * (peak_pf - self._peak_pf)
        with np.errstate(invalid="ignore", divide="ignore"):
            curvature_rel = _LINE_ERROR * second_pf.max(axis=1) / np.abs(change_pf).max(axis=1)
        # A NaN fails both comparisons.
        good = (curvature_rel < _MAX_CURVATURE_REL) & (mean_pf > _MIN_CHANGE_REL * self._peak_pf)
        chosen, parts = list[int](), list[int]()
        for part, rows in enumerate(np.array_split(np.arange(len(t_ns)), N_PARTS)):
            if len(rows := rows[good[rows]]):
                chance = 0.3 * _MAX_CURVATURE_REL * self._random.random(len(rows))
                chosen.append(int(rows[np.argmin(curvature_rel[rows] + chance)]))
                parts.append(part)
        return Instants(
            t_ns[chosen],
            capacitance_pf[chosen],
            np.tile(self.baseline_pf, (len(chosen), 1)),
            np.hypot(READING_NOISE_PF, _CUBIC_ERROR * third_pf[chosen]),
            np.array(parts, np.int64),
        )


def _stances(hangs: Mask) -> Iterator[tuple[int, int]]:
    """Yield first scan and end of each stance that a swing follows; shorter swings are part of it."""
    edges = np.flatnonzero(np.diff(np.concatenate([[True], hangs, [True]]).astype(np.int8)))
    begins, ends = edges[::2], edges[1::2]
    if len(begins):
        swings = np.append(begins[1:], len(hangs)) - ends
        long = swings >= _MIN_SWING_SCANS
        starts = np.concatenate([[True], long[:-1]])
        for begin, end in zip(begins[starts], ends[long], strict=False):
            yield int(begin), int(end)


def _interpolated(scans: LegScans, t_ns: Stamps) -> tuple[Vector, Vector, Vector]:
    """Return the readings at some times [pF], and their second and third differences [pF], shape (n, 9) each.

    They are NaN where a reading is missing.
    """
    x, y = np.full((2, len(t_ns), ELEMENTS, 4), np.nan)
    for element in range(ELEMENTS):
        read_ns, row = np.unique(scans.t_ns[:, element], return_index=True)
        if len(read_ns) >= 4:
            last = np.clip(np.searchsorted(read_ns, t_ns) + 1, 3, len(read_ns) - 1)
            four = last[:, None] + np.arange(-3, 1)
            x[:, element] = 1e-9 * (read_ns[four] - t_ns[:, None])
            y[:, element] = scans.capacitance_pf[row, element][four]
    itself = np.eye(4, dtype=np.bool_)
    factors = x[..., None, :] / np.where(itself, 1.0, x[..., None, :] - x[..., None])
    weights = np.where(itself, 1.0, factors).prod(axis=3)
    second_pf, third_pf = (np.abs(np.diff(y, order)).max(axis=2) for order in (2, 3))
    return (weights * y).sum(axis=2), _with_neighbours(second_pf), _with_neighbours(third_pf)


def _with_neighbours(values: Vector) -> Vector:
    """Return the largest of each value and those of the instants beside it, NaN where one is."""
    padded = np.pad(values, ((_NEIGHBOURS, _NEIGHBOURS), (0, 0)), mode="edge")
    largest: Vector = np.max([padded[k : k + len(values)] for k in range(2 * _NEIGHBOURS + 1)], axis=0)
    return largest
