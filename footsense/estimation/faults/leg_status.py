"""Judges every element and leg: which readings may be used, which state a leg is in, and what lies behind it.

Thresholds that are physics, not taste: a gap that is shut to 95 % no longer tells its load, and an element that has
lost half of its unloaded capacitance cannot be a pressed one (pressing only adds): its line is open. Whether an element
that reads something possible reads the right thing is `estimation/faults/consistency.py`'s question.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_interface import fdc1004
from footsense.estimation.faults.missing_sets import KNOWN_MISSING
from footsense.frames import ELEMENTS, BaselineDrift, Cause, Reading, State

OPEN_REL = 0.5
#: What an element over the range of an FDC1004 has at least [pF].
RANGE_END_PF = fdc1004.capacitance_pf(fdc1004.CODE_MAX)
#: Farthest that an element's zero may move from the mean of its leg's [pF]: 20 K take all 30 fF along, and elements
#: differ in that by a fifth.
DRIFT_LIMIT_PF = 20e-3

_LINES = KNOWN_MISSING[1 + ELEMENTS :]
_ROWS, _COLUMNS = _LINES[:3], _LINES[3:]
_BITS = (1 << np.arange(ELEMENTS)).astype(np.uint16)

#: What the readings say of a leg, the gravest last.
_STATES = {
    Reading.DELAYED: State.STALE,
    Reading.NOT_READY: State.CONVERTER_FAULT,
    Reading.CORRUPT: State.CONVERTER_FAULT,
    Reading.MISCONFIGURED: State.CONVERTER_FAULT,
    Reading.EXCITATION: State.CONVERTER_FAULT,
    Reading.WRONG_CHIP: State.ABSENT,
    Reading.BUS_STUCK: State.ABSENT,
    Reading.NO_ANSWER: State.ABSENT,
}
_CAUSES = {
    Reading.DELAYED: Cause.DELAYED,
    Reading.NOT_READY: Cause.NEVER_FINISHES,
    Reading.CORRUPT: Cause.CORRUPT,
    Reading.MISCONFIGURED: Cause.SETTINGS_LOST,
    Reading.EXCITATION: Cause.CANNOT_EXCITE,
    Reading.WRONG_CHIP: Cause.WRONG_CHIP,
    Reading.BUS_STUCK: Cause.BUS_STUCK,
    Reading.NO_ANSWER: Cause.NO_ANSWER,
}
#: Nothing is heard of a leg's foot: when it comes back, it may be another one.
SILENT = np.array([Reading.NO_ANSWER, Reading.BUS_STUCK, Reading.WRONG_CHIP], np.uint8)

Mask = NDArray[np.bool_]


class Faulty(NamedTuple):
    """Elements that do not read what they should, shape (legs, 9) each.

    Attributes:
        opened: Have lost their electrode.
        shorted: Read more than the converter can, while the others are not pressed like that.
        stuck: No longer move.
        drifting: Move, beside where they should.
    """

    opened: Mask
    shorted: Mask
    stuck: Mask
    drifting: Mask

    @property
    def any(self) -> Mask:
        """Those with any of it."""
        return self.opened | self.shorted | self.stuck | self.drifting


def missing_elements(opened: Mask) -> Mask:
    """Return which elements the network has to do without, shape (legs, 9): one open one, or the open ones' line.

    A leg whose open elements do not lie in one row or column has none: that is more than the network knows of.

    Example:
        >>> two_of_row_0 = np.zeros((1, 9), bool)
        >>> two_of_row_0[0, [0, 2]] = True
        >>> missing_elements(two_of_row_0)[0].astype(int).tolist()
        [1, 1, 1, 0, 0, 0, 0, 0, 0]
    """
    if not np.count_nonzero(opened):
        return opened
    missing = np.zeros_like(opened)
    for leg in np.flatnonzero(opened.any(axis=1)):
        if opened[leg].sum() == 1:
            missing[leg] = opened[leg]
            continue
        for line in _LINES:
            if not (opened[leg] & ~line).any():
                missing[leg] = line
    return missing


def floating_pf(capacitance_pf: NDArray[np.float64], opened: Mask) -> NDArray[np.float64]:
    """Return what rows that nothing drives add to the readings of the other rows [pF], shape (legs, 9).

    A row whose three elements are open has lost its line. Its electrodes float, and each column sees them in series
    with their small capacitance to ground whichever row is selected: as much as the open element itself reads. Where
    that is under the converter's range, it is a board that grounds the other columns: nothing is added there.

    Args:
        capacitance_pf: Readings, stray included [pF], shape (legs, 9), NaN under the range.
        opened: Open elements, shape (legs, 9).
    """
    rows = opened.reshape(-1, 3, 3)
    floating = rows.all(axis=2, keepdims=True)
    readings_pf = capacitance_pf.reshape(-1, 3, 3)
    per_column_pf = np.where(floating & ~np.isnan(readings_pf), readings_pf, 0.0).sum(axis=1, keepdims=True)
    added_pf: NDArray[np.float64] = np.where(floating, 0.0, per_column_pf).reshape(-1, ELEMENTS)
    return added_pf


def fault_mask(unusable: Mask) -> NDArray[np.uint16]:
    """Return bit e for each unusable element e of each leg, shape (legs,).

    Example:
        >>> unusable = np.zeros((1, 9), bool)
        >>> unusable[0, [0, 8]] = True
        >>> bin(int(fault_mask(unusable)[0]))
        '0b100000001'
    """
    masks: NDArray[np.uint16] = unusable @ _BITS
    return masks


def converter_states(state: NDArray[np.uint8], reading: NDArray[np.uint8], faulty: Mask, shut: Mask) -> None:
    """Write the states that forbid any value over `state`, shape (legs,); the gravest is written last.

    Args:
        state: The states so far.
        reading: How each element answered, shape (legs, 9).
        faulty: Elements that are broken and cannot be done without, shape (legs, 9).
        shut: Elements that are pressed beyond what they can tell, shape (legs, 9).
    """
    if shut.any():
        state[shut.any(axis=1)] = State.SATURATED
    if faulty.any():
        state[faulty.any(axis=1)] = State.ELEMENT_FAULT
    if reading.any():
        for kind, worse in _STATES.items():
            state[(reading == kind).any(axis=1)] = worse


def drifting_zeros(zero: BaselineDrift) -> NDArray[np.uint8]:
    """Return ELEMENT_DRIFTS for legs of which one zero has left the others', else NONE, shape (legs,)."""
    parted = np.abs(zero.worst_pf - zero.mean_pf) > DRIFT_LIMIT_PF
    return np.where(parted, np.uint8(Cause.ELEMENT_DRIFTS), np.uint8(Cause.NONE))


def causes(
    reading: NDArray[np.uint8], state: NDArray[np.uint8], faulty: Faulty, zero: BaselineDrift
) -> NDArray[np.uint8]:
    """Return what lies behind each leg's state, shape (legs,): `Cause.NONE` where nothing is known to be wrong.

    A line is told from single faults by all three of its elements being open. An element that is shorted ties its
    column to its row, and takes the other two of its column along.

    Args:
        reading: How each element answered, shape (legs, 9).
        state: What follows from it, shape (legs,).
        faulty: Elements that do not read what they should.
        zero: Where the legs' zeros stand: one that has left the others' is told, though it is still followed.
    """
    cause = drifting_zeros(zero)
    cause[state == State.SATURATED] = Cause.GAP_CLOSED
    if faulty.any.any():
        cause[faulty.drifting.any(axis=1)] = Cause.ELEMENT_DRIFTS
        cause[faulty.stuck.any(axis=1)] = Cause.ELEMENT_STUCK
        cause[faulty.opened.any(axis=1)] = Cause.ELEMENT_OPEN
        for lines, broken in ((_COLUMNS, Cause.COLUMN_OPEN), (_ROWS, Cause.ROW_OPEN)):
            for line in lines:
                cause[faulty.opened[:, line].all(axis=1)] = broken
        cause[faulty.shorted.any(axis=1)] = Cause.ELEMENT_SHORTED
    if reading.any():
        for kind, reason in _CAUSES.items():
            cause[(reading == kind).any(axis=1)] = reason
    return cause
