"""Judges every element and leg: which readings may be used, and which state a leg is in.

Thresholds that are physics, not taste: a gap that is shut to 95 % no longer tells its load, and an element that has
lost half of its unloaded capacitance cannot be a pressed one (pressing only adds): its line is open.
"""

import numpy as np
from numpy.typing import NDArray

from footsense.frames import ELEMENTS, Reading, State

SHUT_REL = 0.95
OPEN_REL = 0.5

#: The three rows and the three columns.
_LINES = np.array(
    [np.arange(ELEMENTS) // 3 == n for n in range(3)] + [np.arange(ELEMENTS) % 3 == n for n in range(3)]
)
_BITS = (1 << np.arange(ELEMENTS)).astype(np.uint16)

Mask = NDArray[np.bool_]


def open_elements(capacitance_pf: NDArray[np.float64], unloaded_pf: NDArray[np.float64]) -> Mask:
    """Tell which elements have lost their electrode, shape as given; False where there is no reading."""
    return capacitance_pf < OPEN_REL * unloaded_pf


def missing_elements(opened: Mask) -> Mask:
    """Return which elements the network has to do without, shape (legs, 9): one open one, or the open ones' line.

    A leg whose open elements do not lie in one row or column has none: that is more than the network knows of.

    Example:
        >>> two_of_row_0 = np.zeros((1, 9), bool)
        >>> two_of_row_0[0, [0, 2]] = True
        >>> missing_elements(two_of_row_0)[0].astype(int).tolist()
        [1, 1, 1, 0, 0, 0, 0, 0, 0]
    """
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
    with their small capacitance to ground whichever row is selected: as much as the open element itself reads.

    Args:
        capacitance_pf: Readings, stray included [pF], shape (legs, 9).
        opened: Open elements, shape (legs, 9).
    """
    rows = opened.reshape(-1, 3, 3)
    floating = rows.all(axis=2, keepdims=True)
    readings_pf = capacitance_pf.reshape(-1, 3, 3)
    per_column_pf = np.where(floating, readings_pf, 0.0).sum(axis=1, keepdims=True)
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


def converter_states(state: NDArray[np.uint8], reading: NDArray[np.uint8], opened: Mask, shut: Mask) -> None:
    """Write the states that forbid any value over `state`, shape (legs,); the gravest is written last."""
    if shut.any():
        state[shut.any(axis=1)] = State.SATURATED
    if reading.any():
        state[(reading == Reading.OVER_RANGE).any(axis=1)] = State.SATURATED
    if opened.any():
        state[opened.any(axis=1)] = State.ELEMENT_FAULT
    if reading.any():
        broken = (reading == Reading.NOT_READY) | (reading == Reading.MISCONFIGURED)
        state[broken.any(axis=1)] = State.CONVERTER_FAULT
        state[(reading == Reading.NO_ANSWER).any(axis=1)] = State.ABSENT
