"""What a few scans of a free foot say of its lines and elements."""

import numpy as np
import pytest

from footsense.daemon.setup.foot_check import FootFault, FootScans, foot_faults
from footsense.estimation.settings import TareLimits
from footsense.frames import Cause, Reading

N_SCANS = 6
ALL = tuple(range(9))


def foot(pf: float = 5.4) -> FootScans:
    return FootScans(np.full((N_SCANS, 9), pf), np.zeros((N_SCANS, 9), np.uint8))


def found(scans: FootScans) -> list[FootFault]:
    return list(foot_faults(scans, np.full(9, 0.1), np.full(9, 5.3), TareLimits()))


@pytest.mark.parametrize(
    ("elements", "value", "reading", "causes"),
    [
        (ALL, 0.1, Reading.OK, [(Cause.ELEMENT_OPEN, ALL)]),
        ((0, 3, 6), np.nan, Reading.OVER_RANGE, [(Cause.ELEMENT_SHORTED, (0, 3, 6))]),
        ((2,), np.nan, Reading.UNDER_RANGE, [(Cause.ELEMENT_OPEN, (2,))]),
        ((2,), np.nan, Reading.OVER_RANGE, [(Cause.OVERLOAD, (2,))]),
        ((8,), np.nan, Reading.CORRUPT, [(Cause.CORRUPT, ALL)]),
        ((8,), np.nan, Reading.DELAYED, [(Cause.DELAYED, ALL)]),
        # Row 0 and column 0 are open: their crossing belongs to both, and is told once.
        (
            (0, 1, 2, 3, 6),
            0.1,
            Reading.OK,
            [(Cause.ROW_OPEN, (0, 1, 2)), (Cause.ELEMENT_OPEN, (3,)), (Cause.ELEMENT_OPEN, (6,))],
        ),
    ],
)
def test_what_is_broken_is_named(
    elements: tuple[int, ...],
    value: float,
    reading: Reading,
    causes: list[tuple[Cause, tuple[int, ...]]],
) -> None:
    """As far as lines explain single elements, the lines are told; of a chip in trouble nothing else is."""
    scans = foot()
    scans.capacitance_pf[:, elements] = value
    scans.reading[:, elements] = reading
    broken = [(finding.cause, finding.elements) for finding in found(scans)]
    assert broken == causes


@pytest.mark.parametrize(
    ("element", "added_pf", "says", "may_be_sound"),
    [
        # An element that is not quiet has no mean that could be held against what is expected.
        (4, [1.0, 2.0] * (N_SCANS // 2), "noise of up to 547.7 fF", False),
        (7, -0.4, "element 7 reads -7.5%", True),
    ],
)
def test_what_is_off_is_told_by_its_amount(
    element: int, added_pf: float | list[float], says: str, *, may_be_sound: bool
) -> None:
    """With the element that is farthest off; another foot than expected is fit to be configured."""
    scans = foot()
    scans.capacitance_pf[:, element] += added_pf
    (off,) = found(scans)
    assert (off.elements, off.foot_may_be_sound) == ((element,), may_be_sound)
    assert says in off.observation


@pytest.mark.parametrize("column", range(3))
def test_the_line_that_is_at_ground_is_named(column: int) -> None:
    """All of a column over the range is its line; one over it, and the others open, is that element."""
    scans = foot()
    scans.capacitance_pf[:, column::3] = np.nan
    scans.reading[:, column::3] = Reading.OVER_RANGE
    (shorted,) = found(scans)
    assert shorted.observation == f"the line of column {column} is shorted to ground"
    scans.capacitance_pf[:, [column, 3 + column]] = 0.1
    scans.reading[:, [column, 3 + column]] = Reading.OK
    (shorted,) = found(scans)
    assert (shorted.cause, shorted.elements) == (Cause.ELEMENT_SHORTED, (6 + column,))
    assert shorted.observation.endswith(f"with it the rest of column {column} cannot be read")


def test_elements_with_a_line_each_are_told_one_by_one() -> None:
    """A board that has no row switch is not asked for one, and nothing of a floating row is taken off the others."""
    scans = foot()
    scans.capacitance_pf[:, :3] = 0.3
    scans.reading[:, 8] = Reading.OVER_RANGE
    scans.capacitance_pf[:, 8] = np.nan
    faults = foot_faults(scans, np.full(9, 0.1), np.full(9, 5.3), TareLimits(), has_shared_lines=False)
    assert [(fault.cause, fault.elements) for fault in faults] == [
        (Cause.OVERLOAD, (8,)),
        *((Cause.ELEMENT_OPEN, (element,)) for element in range(3)),
    ]
    assert faults[0].observation.endswith("its gap is closed, or its line touches ground")
    assert faults[3].advice == "the line from its electrode, row 0, column 2, to input CIN2"


def test_a_leg_that_was_left_out_says_why() -> None:
    """In the words of its board, in place of those of its reading."""
    scans = foot()
    scans.reading[:] = Reading.MISCONFIGURED
    expected = np.full(9, 0.1), np.full(9, 5.3), TareLimits()
    (fault,) = foot_faults(scans, *expected, why_left_out="its reference reads 3 pF: check it")
    assert (fault.cause, fault.observation, fault.advice) == (
        Cause.SETTINGS_LOST,
        "its reference reads 3 pF",
        "it",
    )
    (fault,) = foot_faults(scans, *expected)
    assert fault.observation == "a chip does not hold its settings"
