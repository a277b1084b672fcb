"""Legs and elements of a recording, as its header names them: the shape of all arrays that follow."""

from collections.abc import Mapping
from typing import NamedTuple

from footsense.frames import ALL_LEGS, ELEMENTS

#: Entry of a header with the number of elements of a foot; absent for nine.
N_ELEMENTS_KEY = "n_elements"

#: Numbers of elements of a foot: 2 x 2, 3 x 3 and 4 x 4.
_ARRAY_SIZES = (4, 9, 16)


class FrameShape(NamedTuple):
    """Numbers of legs and of elements of each foot, by which the arrays of a cycle are read.

    Attributes:
        n_legs: Rows of every array.
        n_elements: Columns of the arrays of a scan.
    """

    n_legs: int
    n_elements: int = ELEMENTS


def frame_shape(header: Mapping[str, str]) -> FrameShape:
    """Return the shape of the frames that follow a header.

    Raises:
        ValueError: Its legs are not some of a robot's, or its feet have no such array.
    """
    text = header.get("legs", "")
    legs = text.split(",")
    if len(set(legs)) < len(legs) or not set(legs) <= set(ALL_LEGS):
        raise ValueError(f"the recording names its legs {text[:40]!r}, not some of {', '.join(ALL_LEGS)}")
    return FrameShape(len(legs), header_elements(header))


def header_elements(header: Mapping[str, str]) -> int:
    """Return the number of elements of a foot that a header names, nine without an entry.

    Raises:
        ValueError: No foot has such an array.
    """
    text = header.get(N_ELEMENTS_KEY, str(ELEMENTS))
    if text not in map(str, _ARRAY_SIZES):
        raise ValueError(f"the recording is of feet with {text[:20]!r} elements, not 4, 9 or 16")
    return int(text)


def elements_entry(n_elements: int) -> dict[str, str]:
    """Return the header's entry of a number of elements: none for nine, so that their recordings keep their bytes."""
    return {} if n_elements == ELEMENTS else {N_ELEMENTS_KEY: str(n_elements)}
