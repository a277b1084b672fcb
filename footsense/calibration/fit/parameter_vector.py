"""The parameters of a foot as one vector: places, names and units."""

from footsense.frames import ELEMENTS

#: Slices of the parameter vector: stray [pF], closure gain minus one [1], gap minus the design's [um], stiffness over
#: the design's minus one [1], mount as a rotation vector [rad]. All zero is a foot as designed.
STRAY, GAIN, GAP = slice(0, 9), slice(9, 18), slice(18, 27)
STIFFNESS, MOUNT = slice(27, 28), slice(28, 31)
N_PARAMETERS = 31
KINDS = {"stray": STRAY, "gain": GAIN, "gap": GAP, "stiffness": STIFFNESS, "mount": MOUNT}


def parameter_names() -> list[str]:
    """Return the names of all parameters, each with element and unit."""
    kinds = [("stray", "pF"), ("gain", "1"), ("gap", "um")]
    nines = [f"{kind} of element {element} [{unit}]" for kind, unit in kinds for element in range(ELEMENTS)]
    return [*nines, "stiffness [1]", *(f"mount about {axis} [rad]" for axis in "xyz")]
