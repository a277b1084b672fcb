"""What is wrong with a foot that hangs in the air, judged by a few scans of it: lines, elements, noise.

For the one who has just connected it, not for the loop: each fault is told with what to check. What single readings
are worth is `quality`'s matter, and its limits are used here.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.estimation.faults.open_elements import OPEN_REL, floating_pf
from footsense.frames import ELEMENTS, Cause, Reading

__all__ = ["CHIP_READINGS", "Finding", "FootScans", "findings"]

_ELEMENTS = np.arange(ELEMENTS)
_ROW, _COLUMN = _ELEMENTS // 3, _ELEMENTS % 3

#: What a leg's readings say of its chips, and what to check; the gravest first.
_CHIPS = {
    Reading.MISCONFIGURED: (
        Cause.SETTINGS_LOST,
        "a chip does not hold what it is told",
        "the supply of its chips and the switches' RESET pin; or a loose contact",
    ),
    Reading.EXCITATION: (
        Cause.CANNOT_EXCITE,
        "its converter cannot drive the rows",
        "a row line that is shorted or leaks to ground",
    ),
    Reading.CORRUPT: (
        Cause.CORRUPT,
        "its answers are such as no healthy chip gives",
        "pull-ups, cable length and ground of this leg",
    ),
    Reading.NOT_READY: (
        Cause.NEVER_FINISHES,
        "its converter does not finish its conversions",
        "its 3.3 V supply",
    ),
    Reading.DELAYED: (
        Cause.DELAYED,
        "its readings came too late",
        "what else loads this computer or this bus",
    ),
}


#: Readings that say nothing of the foot.
CHIP_READINGS = (*_CHIPS, Reading.NO_ANSWER)


class FootScans(NamedTuple):
    """Some scans of one foot.

    Attributes:
        capacitance_pf: As converted, stray included [pF], shape (scans, 9), NaN where there was none.
        reading: How each element answered, shape (scans, 9), uint8 of `Reading`.
    """

    capacitance_pf: NDArray[np.float64]
    reading: NDArray[np.uint8]

    @property
    def mean_pf(self) -> NDArray[np.float64]:
        """Mean of each element [pF], shape (9,), NaN for one that was not always read."""
        mean_pf: NDArray[np.float64] = self.capacitance_pf.mean(axis=0)
        return mean_pf

    @property
    def noise_ff(self) -> NDArray[np.float64]:
        """Standard deviation of each element [fF], shape (9,), NaN as the mean."""
        noise_pf: NDArray[np.float64] = self.capacitance_pf.std(axis=0, ddof=1)
        return noise_pf * 1e3

    @property
    def worst(self) -> NDArray[np.uint8]:
        """What each element answered when it did not answer well, shape (9,); 0 for one that always did."""
        worst: NDArray[np.uint8] = self.reading.max(axis=0)
        return worst

    @property
    def is_intermittent(self) -> bool:
        """Whether the chips did as they were told in some of the scans and not in others."""
        spoilt = np.isin(self.reading, CHIP_READINGS).any(axis=1)
        return bool(spoilt.any() and not spoilt.all())


class Finding(NamedTuple):
    """Something that is wrong with a foot.

    Attributes:
        cause: What it is in the words of CAN; NONE for what CAN has no word for.
        elements: Flat indices of the elements that it concerns.
        what: What it is, in words.
        check: What to look at.
        is_fit: Whether the readings can be those of a sound foot, only of another one than was expected.
    """

    cause: Cause
    elements: tuple[int, ...]
    what: str
    check: str
    is_fit: bool = False


def findings(
    scans: FootScans,
    stray_pf: NDArray[np.float64],
    unloaded_pf: NDArray[np.float64],
    *,
    noise_limit_ff: float,
    unloaded_limit_rel: float,
) -> tuple[Finding, ...]:
    """Return what is wrong with a foot; nothing for a sound one.

    Args:
        scans: At least two scans of it in the air.
        stray_pf: Known capacitance in parallel with each element [pF], shape (9,).
        unloaded_pf: What each element is expected to read, without stray [pF], shape (9,).
        noise_limit_ff: Noise above which a tare is refused [fF].
        unloaded_limit_rel: Deviation from what is expected above which a tare is refused [1].

    Example:
        >>> sound = FootScans(np.full((4, 9), 5.4), np.zeros((4, 9), np.uint8))
        >>> limits = {"noise_limit_ff": 5.0, "unloaded_limit_rel": 0.03}
        >>> findings(sound, np.zeros(9), np.full(9, 5.387), **limits)
        ()
        >>> sound.capacitance_pf[:] = 5.7
        >>> sound.capacitance_pf[:, 3:6] = 0.3
        >>> [(found.cause.name, found.elements) for found in findings(sound, np.zeros(9), np.full(9, 5.387), **limits)]
        [('ROW_OPEN', (3, 4, 5))]
    """
    for reading, (cause, what, check) in _CHIPS.items():
        if (scans.reading == reading).any():
            return (Finding(cause, tuple(range(ELEMENTS)), what, check),)
    mean_pf = scans.mean_pf - stray_pf
    over = scans.worst == Reading.OVER_RANGE
    opened = (mean_pf < OPEN_REL * unloaded_pf) | (scans.worst == Reading.UNDER_RANGE)
    broken = [*_over_range(over, opened), *_opened(opened, over)]
    wrong = opened | over
    # A row that floats adds to the others what it still has to ground.
    mean_pf = mean_pf - floating_pf(scans.mean_pf[None], opened[None])[0]
    loud = ~wrong & (scans.noise_ff > noise_limit_ff)
    if loud.any():
        broken.append(_loud(loud, scans.noise_ff, noise_limit_ff))
    off_rel = mean_pf / unloaded_pf - 1.0
    off = ~(wrong | loud) & (np.abs(off_rel) > unloaded_limit_rel)
    if off.any():
        broken.append(_off(off, off_rel, unloaded_limit_rel))
    return tuple(broken)


def _over_range(over: NDArray[np.bool_], opened: NDArray[np.bool_]) -> list[Finding]:
    """Tell of elements over the converter's range: a whole column of them has its line at ground."""
    found = []
    for column in range(3):
        of_column = column == _COLUMN
        elements = np.flatnonzero(over & of_column)
        if len(elements) == 3:
            what = f"the line of column {column} is shorted to ground"
            check = "the plug, then the trace of that column"
            found.append(Finding(Cause.ELEMENT_SHORTED, _plain(elements), what, check))
            continue
        for element in _plain(elements):
            # A short to the shield's driver leaves nothing of the rest of its column.
            if (over | opened)[of_column].all():
                what = f"element {element} is shorted; with it the rest of column {column} cannot be read"
                check = f"whether the electrodes of row {element // 3}, column {column} touch"
                found.append(Finding(Cause.ELEMENT_SHORTED, (element,), what, check))
            else:
                what = f"element {element} reads more than the converter can: its gap is shut"
                found.append(
                    Finding(Cause.GAP_CLOSED, (element,), what, "water in the gap, and what presses the foot")
                )
    return found


def _opened(opened: NDArray[np.bool_], over: NDArray[np.bool_]) -> list[Finding]:
    """Tell of elements that have lost their electrode, by lines as far as lines explain them."""
    if opened.all():
        what, check = "none of its elements is connected", "whether the foot is plugged in"
        return [Finding(Cause.ELEMENT_OPEN, _plain(_ELEMENTS), what, check)]
    # A shorted element takes the others of its column along.
    taken = [bool((opened | over)[column::3].all() and over[column::3].any()) for column in range(3)]
    left = opened & ~np.array(taken)[_COLUMN]
    found = []
    for name, cause, number_of, end in (
        ("row", Cause.ROW_OPEN, _ROW, "the row switch"),
        ("column", Cause.COLUMN_OPEN, _COLUMN, "the converter's pin"),
    ):
        for line in range(3):
            elements = number_of == line
            if left[elements].all():
                left = left & ~elements
                what = f"the line of {name} {line} is interrupted"
                check = f"the wire between {end} and the foot, and its plug"
                found.append(Finding(cause, _plain(np.flatnonzero(elements)), what, check))
    for element in _plain(np.flatnonzero(left)):
        check = f"the electrode of row {element // 3}, column {element % 3} and its trace"
        found.append(Finding(Cause.ELEMENT_OPEN, (element,), f"element {element} is open", check))
    return found


def _loud(loud: NDArray[np.bool_], noise_ff: NDArray[np.float64], limit_ff: float) -> Finding:
    return Finding(
        Cause.NONE,
        _plain(np.flatnonzero(loud)),
        f"noise of up to {noise_ff[loud].max():.1f} fF; a tare is refused above {limit_ff:g} fF",
        "whether the foot hangs still, the shield's connection, and motor cables beside the foot's",
    )


def _off(off: NDArray[np.bool_], off_rel: NDArray[np.float64], limit_rel: float) -> Finding:
    worst = int(np.abs(np.where(off, off_rel, 0.0)).argmax())
    return Finding(
        Cause.NONE,
        _plain(np.flatnonzero(off)),
        f"element {worst} reads {off_rel[worst]:+.1%} from what the free foot is expected to; "
        f"a tare is refused above {limit_rel:.1%}",
        "that nothing presses the foot; then put its readings below into the configuration as unloaded_pf",
        is_fit=True,
    )


def _plain(elements: NDArray[np.int64]) -> tuple[int, ...]:
    return tuple(elements.tolist())
