"""What a few scans of a free foot say of its lines and elements."""

import numpy as np
import pytest

from footsense.acquisition.foot_check import FootFault, FootScans, foot_faults
from footsense.estimation.settings import TareLimits
from footsense.frames import Cause, Reading

N_SCANS = 6
ALL = tuple(range(9))


def foot(pf: float = 5.4) -> FootScans:
    return FootScans(np.full((N_SCANS, 9), pf), np.zeros((N_SCANS, 9), np.uint8))


def found(scans: FootScans) -> list[FootFault]:
    return list(foot_faults(scans, np.full(9, 0.1), np.full(9, 5.3), TareLimits()))


def test_nothing_is_found_on_a_sound_foot() -> None:
    """Its stray is part of what is expected."""
    assert found(foot()) == []


def test_noise_is_told_by_its_amount_and_judged_by_nothing_else() -> None:
    """An element that is not quiet has no mean that could be held against what is expected."""
    scans = foot()
    scans.capacitance_pf[:, 4] += [1.0, 2.0] * (N_SCANS // 2)
    (noise,) = found(scans)
    assert noise.elements == (4,)
    assert noise.observation.startswith("noise of up to 547.7 fF")
    assert not noise.foot_may_be_sound


def test_another_foot_than_expected_is_fit_to_be_configured() -> None:
    """The finding names the element that is farthest off."""
    scans = foot()
    scans.capacitance_pf[:, 7] = 5.0
    (off,) = found(scans)
    assert (off.elements, off.foot_may_be_sound) == ((7,), True)
    assert "element 7 reads -7.5%" in off.observation


@pytest.mark.parametrize(
    ("elements", "value", "reading", "causes"),
    [
        (ALL, 0.1, Reading.OK, [(Cause.ELEMENT_OPEN, ALL)]),
        ((0, 3, 6), np.nan, Reading.OVER_RANGE, [(Cause.ELEMENT_SHORTED, (0, 3, 6))]),
        ((2,), np.nan, Reading.UNDER_RANGE, [(Cause.ELEMENT_OPEN, (2,))]),
        ((2,), np.nan, Reading.OVER_RANGE, [(Cause.GAP_CLOSED, (2,))]),
        (ALL, np.nan, Reading.EXCITATION, [(Cause.CANNOT_EXCITE, ALL)]),
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


def test_a_loose_contact_is_told_from_one_that_is_off() -> None:
    """Some scans are whole."""
    scans = foot()
    scans.reading[:3, 0] = Reading.NO_ANSWER
    assert scans.chips_fail_intermittently
    scans.reading[:, 0] = Reading.NO_ANSWER
    assert not scans.chips_fail_intermittently
