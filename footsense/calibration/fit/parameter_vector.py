"""Layout of a foot's parameter vector: slice, name and unit of each parameter."""

from functools import cache
from typing import NamedTuple

#: Slices of the parameters of the whole foot, at the end of the vector: stiffness over the design's minus one [1],
#: mount as a rotation vector [rad], offset of the sheet from the axis of the balls along x and y over the ball's radius
#: [1], and gains of the reference along x, y, z minus one [1].
STIFFNESS, MOUNT, OFFSET, REFERENCE = slice(-9, -8), slice(-8, -5), slice(-5, -3), slice(-3, None)
#: Their number of each kind, in this order.
FOOT_PARAMETER_COUNTS = (1, 3, 2, 3)


class ElementSlices(NamedTuple):
    """Slices of the parameters of single elements, at the start of the vector; all zero is an element as designed.

    Attributes:
        stray: Stray [pF].
        gain: Closure gain minus one [1].
        gap: Gap minus the design's [um].
    """

    stray: slice
    gain: slice
    gap: slice


@cache
def element_slices(n_elements: int) -> ElementSlices:
    """Return the slices of the per-element parameters (stray, gain, gap) in the parameter vector."""
    return ElementSlices(*(slice(kind * n_elements, (kind + 1) * n_elements) for kind in range(3)))


def n_parameters(n_elements: int) -> int:
    """Return the length of the parameter vector of a foot with so many elements."""
    return 3 * n_elements + sum(FOOT_PARAMETER_COUNTS)


def slice_of_kind(n_elements: int) -> dict[str, slice]:
    """Return the slice of each kind of parameter in the parameter vector, by the kind's name in messages."""
    kinds = {"stiffness": STIFFNESS, "mount": MOUNT, "sheet's offset": OFFSET}
    return {**element_slices(n_elements)._asdict(), **kinds}


def parameter_names(n_elements: int) -> list[str]:
    """Return the names of all parameters in vector order, each with element number and unit."""
    kinds = [("stray", "pF"), ("gain", "1"), ("gap", "um")]
    of_elements = [
        f"{kind} of element {element} [{unit}]" for kind, unit in kinds for element in range(n_elements)
    ]
    return [
        *of_elements,
        "stiffness [1]",
        *(f"mount about {axis} [rad]" for axis in "xyz"),
        *(f"offset of the sheet along {axis} [1]" for axis in "xy"),
        *(f"gain of the reference along {axis} [1]" for axis in "xyz"),
    ]
