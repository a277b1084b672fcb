"""Diagnose the faults of an unloaded foot from a few scans: broken lines, open or shorted elements, noise.

For a person who has just connected it, not for the loop: each fault names the parts to look at. Limits of single
readings are those of the estimation (`estimation/faults`).
"""

from typing import NamedTuple

import numpy as np

from footsense.estimation.elements import OPEN_ELEMENT_THRESHOLD_REL, floating_row_crosstalk_pf
from footsense.estimation.settings import TareLimits
from footsense.frames import ELEMENTS, ROWS, Cause, Codes, Mask, Reading, State, Vector
from footsense.leg_words import CAUSE_WORDS, STATE_AND_CAUSE_OF_READING, words_of_reading


class FootFault(NamedTuple):
    """One fault of a foot: cause, elements, observation, and what to check.

    Attributes:
        cause: The cause as CAN names it; NONE where CAN has no name for it.
        elements: Flat indices of its elements.
        observation: The fault in words.
        advice: The parts to look at.
        foot_may_be_sound: Whether the readings may be those of a sound foot, only of another one than expected.
    """

    cause: Cause
    elements: tuple[int, ...]
    observation: str
    advice: str
    foot_may_be_sound: bool = False


#: Readings of chips that answer, but give no capacitance whatever the foot is, the gravest first.
_WHOLE_FOOT_READINGS = tuple(
    reading
    for reading, (state, _) in reversed(STATE_AND_CAUSE_OF_READING.items())
    if state is not State.ABSENT
)

#: Readings of a leg's chips, which do not depend on the foot.
CHIP_FAULT_READINGS = (*_WHOLE_FOOT_READINGS, Reading.NO_ANSWER)


class FootScans(NamedTuple):
    """Capacitances and read results of several scans of one foot.

    Attributes:
        capacitance_pf: As converted, stray included [pF], shape (scans, elements), NaN without a reading.
        reading: How each element answered, shape (scans, elements), uint8 of `Reading`.
    """

    capacitance_pf: Vector
    reading: Codes

    @property
    def mean_pf(self) -> Vector:
        """Mean capacitance of each element over the scans [pF], shape (elements,); NaN if a reading is missing."""
        mean_pf: Vector = self.capacitance_pf.mean(axis=0)
        return mean_pf

    @property
    def noise_ff(self) -> Vector:
        """Standard deviation of each element over the scans [fF], shape (elements,); NaN if a reading is missing."""
        noise_pf: Vector = self.capacitance_pf.std(axis=0, ddof=1)
        return noise_pf * 1e3

    @property
    def worst_reading(self) -> Codes:
        """Highest `Reading` code of each element over the scans, shape (elements,); 0 if all were OK."""
        highest: Codes = self.reading.max(axis=0)
        return highest

    @property
    def chips_fail_intermittently(self) -> bool:
        """Whether the chips failed in some scans and worked in others."""
        failed = np.isin(self.reading, CHIP_FAULT_READINGS).any(axis=1)
        return bool(failed.any() and not failed.all())


def foot_faults(
    scans: FootScans,
    stray_pf: Vector,
    unloaded_pf: Vector,
    limits: TareLimits,
    *,
    has_shared_lines: bool = True,
    why_left_out: str = "",
) -> tuple[FootFault, ...]:
    """Return the faults of an unloaded foot; empty for a fault-free one.

    Args:
        scans: At least two scans of it in the air.
        stray_pf: Known capacitance in parallel with each element [pF], shape (elements,).
        unloaded_pf: Expected capacitance of each element, without stray [pF], shape (elements,).
        limits: Noise, and deviation from `unloaded_pf`, above which a tare is refused.
        has_shared_lines: Whether the elements of a row or column share a line; of board `ad7147` each has its own.
        why_left_out: Why the leg was left out of the scan, in words, which end with ": check " and a remedy; for a leg
            of which all readings are of its chips. Empty for the words of these readings.

    Example:
        >>> sound = FootScans(np.full((4, 9), 5.4), np.zeros((4, 9), np.uint8))
        >>> foot_faults(sound, np.zeros(9), np.full(9, 5.387), TareLimits())
        ()
        >>> sound.capacitance_pf[:] = 5.7
        >>> sound.capacitance_pf[:, 3:6] = 0.3
        >>> (fault,) = foot_faults(sound, np.zeros(9), np.full(9, 5.387), TareLimits())
        >>> fault.cause.name, fault.elements
        ('ROW_OPEN', (3, 4, 5))
    """
    for reading in _WHOLE_FOOT_READINGS:
        if (scans.reading == reading).any():
            meaning, remedy, _ = words_of_reading(reading)
            if (scans.reading == reading).all() and why_left_out:
                meaning, _, remedy = why_left_out.partition(": check ")
            elements = tuple(range(len(stray_pf)))
            return (FootFault(STATE_AND_CAUSE_OF_READING[reading][1], elements, meaning, remedy),)
    mean_pf = scans.mean_pf - stray_pf
    over = scans.worst_reading == Reading.OVER_RANGE
    opened = (mean_pf < OPEN_ELEMENT_THRESHOLD_REL * unloaded_pf) | (
        scans.worst_reading == Reading.UNDER_RANGE
    )
    wrong = opened | over
    if has_shared_lines:
        broken = [*_over_range_faults(over, opened), *_open_faults(opened, over)]
        # An interrupted row floats, and adds its capacitance to ground to the other elements.
        mean_pf = mean_pf - floating_row_crosstalk_pf(scans.mean_pf[None], opened[None])[0]
    else:
        broken = _own_line_faults(over, opened)
    noisy = ~wrong & (scans.noise_ff > limits.noise_limit_ff)
    if noisy.any():
        noise_ff = scans.noise_ff[noisy].max()
        observation = (
            f"noise of up to {noise_ff:.1f} fF; a tare is refused above {limits.noise_limit_ff:g} fF"
        )
        advice = "whether the foot hangs still, the shield's connection, and motor cables beside the foot's"
        broken.append(FootFault(Cause.NONE, _indices(noisy), observation, advice))
    off_rel = mean_pf / unloaded_pf - 1.0
    off = ~(wrong | noisy) & (np.abs(off_rel) > limits.unloaded_limit_rel)
    if off.any():
        worst = int(np.abs(np.where(off, off_rel, 0.0)).argmax())
        observation = (
            f"element {worst} reads {off_rel[worst]:+.1%} from the expected capacitance of the free foot; "
            f"a tare is refused above {limits.unloaded_limit_rel:.1%}"
        )
        advice = (
            "that nothing presses the foot; then calibrate it beside a force sensor; without one, its readings below as"
            " unloaded_pf let it be tared, and `footsense selfcal` finds its electrodes while it walks"
        )
        broken.append(FootFault(Cause.NONE, _indices(off), observation, advice, foot_may_be_sound=True))
    return tuple(broken)


def _over_range_faults(over: Mask, opened: Mask) -> list[FootFault]:
    """Return the faults of over-range elements: a whole column means that its line is shorted to ground."""
    faults = []
    for column in range(ROWS):
        of_column = np.arange(ELEMENTS) % ROWS == column
        elements = _indices(over & of_column)
        if len(elements) == ROWS:
            observation = f"the line of column {column} is shorted to ground"
            advice = "the plug, then the trace of that column"
            faults.append(FootFault(Cause.ELEMENT_SHORTED, elements, observation, advice))
            continue
        for element in elements:
            # A short to the shield's driver hides the rest of its column.
            if (over | opened)[of_column].all():
                observation = (
                    f"element {element} is shorted; with it the rest of column {column} cannot be read"
                )
                advice = f"whether the electrodes of row {element // ROWS}, column {column} touch"
                faults.append(FootFault(Cause.ELEMENT_SHORTED, (element,), observation, advice))
            else:
                observation = f"element {element} is over the converter's range: its gap is closed"
                advice = CAUSE_WORDS[Cause.OVERLOAD].remedy
                faults.append(FootFault(Cause.OVERLOAD, (element,), observation, advice))
    return faults


def _open_faults(opened: Mask, over: Mask) -> list[FootFault]:
    """Return the faults of open elements: whole row or column lines first, then single elements."""
    if opened.all():
        return [_unplugged()]
    row_of, column_of = np.divmod(np.arange(ELEMENTS), ROWS)
    # A shorted element makes the others of its column read as open.
    taken = [bool((opened | over)[column::ROWS].all() and over[column::ROWS].any()) for column in range(ROWS)]
    left = opened & ~np.array(taken)[column_of]
    faults = []
    for name, cause, number_of, end in (
        ("row", Cause.ROW_OPEN, row_of, "the row switch"),
        ("column", Cause.COLUMN_OPEN, column_of, "the converter's pin"),
    ):
        for line in range(ROWS):
            elements = number_of == line
            if left[elements].all():
                left = left & ~elements
                observation = f"the line of {name} {line} is interrupted"
                advice = f"the wire between {end} and the foot, and its plug"
                faults.append(FootFault(cause, _indices(elements), observation, advice))
    for element in _indices(left):
        advice = f"the electrode of row {element // ROWS}, column {element % ROWS} and its trace"
        faults.append(FootFault(Cause.ELEMENT_OPEN, (element,), f"element {element} is open", advice))
    return faults


def _own_line_faults(over: Mask, opened: Mask) -> list[FootFault]:
    """Return the faults of elements each of which has a line of its own to the converter."""
    if opened.all():
        return [_unplugged()]
    closed = "is over the converter's range: its gap is closed, or its line touches ground"
    return [
        *(
            FootFault(
                Cause.OVERLOAD, (element,), f"element {element} {closed}", CAUSE_WORDS[Cause.OVERLOAD].remedy
            )
            for element in _indices(over)
        ),
        *(
            FootFault(
                Cause.ELEMENT_OPEN,
                (element,),
                f"element {element} is open",
                f"the line from its electrode, row {element // ROWS}, column {element % ROWS}, to input CIN{element}",
            )
            for element in _indices(opened)
        ),
    ]


def _unplugged() -> FootFault:
    elements = tuple(range(ELEMENTS))
    return FootFault(
        Cause.ELEMENT_OPEN, elements, "none of its elements is connected", "whether the foot is plugged in"
    )


def _indices(mask: Mask) -> tuple[int, ...]:
    """Return the indices of a mask's true elements."""
    return tuple(np.flatnonzero(mask).tolist())
