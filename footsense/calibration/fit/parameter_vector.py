"""Layout of a foot's parameter vector: slice, name and unit of each parameter; all zero is a foot as designed."""

from footsense.frames import ELEMENTS

#: Slices of the parameters of single elements: stray [pF], closure gain minus one [1], gap minus the design's [um].
STRAY, GAIN, GAP = (slice(kind * ELEMENTS, (kind + 1) * ELEMENTS) for kind in range(3))
#: Slices of the parameters of the whole foot behind them: stiffness over the design's minus one [1], mount as a
#: rotation vector [rad], offset of the sheet from the axis of the balls along x and y over the ball's radius [1], and
#: gains of the reference along x, y, z minus one [1].
STIFFNESS, MOUNT, OFFSET, REFERENCE = slice(27, 28), slice(28, 31), slice(31, 33), slice(33, 36)
#: Their number of each kind, in the order of the vector, and of all.
PARAMETER_COUNTS = (ELEMENTS, ELEMENTS, ELEMENTS, 1, 3, 2, 3)
N_PARAMETERS = sum(PARAMETER_COUNTS)

#: Slice of each kind of parameter of the foot, by the kind's name in messages.
SLICE_OF_KIND = {
    "stray": STRAY,
    "gain": GAIN,
    "gap": GAP,
    "stiffness": STIFFNESS,
    "mount": MOUNT,
    "sheet's offset": OFFSET,
}

#: Names of all parameters in vector order, each with element number and unit.
PARAMETER_NAMES = [
    *(
        f"{kind} of element {element} [{unit}]"
        for kind, unit in (("stray", "pF"), ("gain", "1"), ("gap", "um"))
        for element in range(ELEMENTS)
    ),
    "stiffness [1]",
    *(f"mount about {axis} [rad]" for axis in "xyz"),
    *(f"offset of the sheet along {axis} [1]" for axis in "xy"),
    *(f"gain of the reference along {axis} [1]" for axis in "xyz"),
]
