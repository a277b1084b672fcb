"""Array shape of a recording's frames (legs, elements), as given by its header."""

from collections.abc import Mapping
from typing import NamedTuple

from footsense.frames import ALL_LEGS, ELEMENTS

#: Entry of a header with the number of elements of a foot; absent for nine.
N_ELEMENTS_KEY = "n_elements"

#: Numbers of elements of a foot: 2 x 2, 3 x 3 and 4 x 4.
_VALID_N_ELEMENTS = (4, 9, 16)


class FrameShape(NamedTuple):
    """Number of legs, and of elements per foot, of a recording's frames.

    Attributes:
        n_legs: Rows of every array.
        n_elements: Columns of the arrays of a scan.
    """

    n_legs: int
    n_elements: int = ELEMENTS


def frame_shape(header: Mapping[str, str]) -> FrameShape:
    """Return the array shape of the frames of a recording from its header.

    Raises:
        ValueError: Its legs are not some of a robot's, or its feet have no such array.
    """
    text = header.get("legs", "")
    legs = text.split(",")
    if len(set(legs)) < len(legs) or not set(legs) <= set(ALL_LEGS):
        raise ValueError(f"the recording names its legs {text[:40]!r}, not some of {', '.join(ALL_LEGS)}")
    return FrameShape(len(legs), n_elements_from_header(header))


def n_elements_from_header(header: Mapping[str, str]) -> int:
    """Return the number of elements per foot from a recording's header; 9 if there is no entry.

    Raises:
        ValueError: No foot has such an array.
    """
    text = header.get(N_ELEMENTS_KEY, str(ELEMENTS))
    if text not in map(str, _VALID_N_ELEMENTS):
        raise ValueError(f"the recording is of feet with {text[:20]!r} elements, not 4, 9 or 16")
    return int(text)


def n_elements_header_entry(n_elements: int) -> dict[str, str]:
    """Return the header entry for the number of elements; empty for 9, the number without an entry."""
    return {} if n_elements == ELEMENTS else {N_ELEMENTS_KEY: str(n_elements)}
