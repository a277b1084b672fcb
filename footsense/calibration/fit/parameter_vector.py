"""Layout of a foot's parameter vector: slice, name and unit of each parameter."""

from footsense.frames import ELEMENTS

#: Slices of the parameter vector: stray [pF], closure gain minus one [1], gap minus the design's [um], stiffness over
#: the design's minus one [1], mount as a rotation vector [rad], offset of the sheet from the axis of the balls along x
#: and y over the ball's radius [1], and gains of the reference along x, y, z minus one [1]. All zero is a foot as
#: designed beside an exact reference.
STRAY, GAIN, GAP = slice(0, 9), slice(9, 18), slice(18, 27)
STIFFNESS, MOUNT, OFFSET, REFERENCE = slice(27, 28), slice(28, 31), slice(31, 33), slice(33, 36)
N_PARAMETERS = 36
#: Kinds of parameters of the foot itself.
SLICE_OF_KIND = {
    "stray": STRAY,
    "gain": GAIN,
    "gap": GAP,
    "stiffness": STIFFNESS,
    "mount": MOUNT,
    "sheet's offset": OFFSET,
}


def parameter_names() -> list[str]:
    """Return the names of all parameters in vector order, each with element number and unit."""
    kinds = [("stray", "pF"), ("gain", "1"), ("gap", "um")]
    nines = [f"{kind} of element {element} [{unit}]" for kind, unit in kinds for element in range(ELEMENTS)]
    return [
        *nines,
        "stiffness [1]",
        *(f"mount about {axis} [rad]" for axis in "xyz"),
        *(f"offset of the sheet along {axis} [1]" for axis in "xy"),
        *(f"gain of the reference along {axis} [1]" for axis in "xyz"),
    ]
