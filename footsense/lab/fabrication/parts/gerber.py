"""Writer of Gerber X2 layers and Excellon drill files: traces, rectangular pads, outlines, with nets and pins.

Our own, because no library in use writes net attributes as commands. Coordinates in mm with six decimals.

Source:
    Ucamco, The Gerber Layer Format Specification, revision 2024.05, sections 4.8 and 5;
    Ucamco, The XNC Format Specification, revision 2021.11.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import footsense

#: A place on a layer (u, v) [mm].
Point = tuple[float, float]

#: File functions of the layers of a flex (section 5.6.3), and of those that a second layer of copper adds.
COPPER, COVERLAY, PROFILE, STIFFENER = "Copper,L1,Top", "Soldermask,Top", "Profile,NP", "Other,Stiffener"
SHIELD, SHIELD_COVERLAY = "Copper,L2,Bot", "Soldermask,Bot"


@dataclass(frozen=True, slots=True, kw_only=True)
class Pad:
    """A rectangular or round pad, flashed in Gerber.

    Attributes:
        centre_mm: Its centre [mm].
        size_mm: Its sides along u and v [mm].
        aperture_function: Aperture function, such as `Other,Electrode`.
        net: Name of its net; empty for none.
        pin: Reference and number such as `J1,2`; empty where it is no pin.
        is_round: Whether it is a disc, its diameter the first of the sides.
    """

    centre_mm: Point
    size_mm: Point
    aperture_function: str
    net: str = ""
    pin: str = ""
    is_round: bool = False

    @property
    def aperture(self) -> str:
        """Gerber aperture template and parameters of the pad."""
        if self.is_round:
            return f"C,{self.size_mm[0]:.6f}"
        return f"R,{self.size_mm[0]:.6f}X{self.size_mm[1]:.6f}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Trace:
    """A polyline trace with round ends.

    Attributes:
        points_mm: Its points [mm], at least two.
        width_mm: Its width [mm].
        aperture_function: Aperture function, such as `Conductor`.
        net: Name of its net; empty for none.
    """

    points_mm: Sequence[Point]
    width_mm: float
    aperture_function: str
    net: str = ""

    @property
    def aperture(self) -> str:
        """Gerber aperture template and parameters of the trace."""
        return f"C,{self.width_mm:.6f}"


def gerber_text(function: str, part: str, shapes: Iterable[Pad | Trace]) -> str:
    """Return the content of a Gerber X2 file.

    Args:
        function: File function of the layer, such as `COPPER`.
        part: Name of the part, for people.
        shapes: The shapes.
    """
    negative = function.startswith("Soldermask")
    lines = [
        f"G04 {part}, seen from the side of its electrodes*",
        f"%TF.GenerationSoftware,footsense,footsense,{footsense.__version__}*%",
        f"%TF.FileFunction,{function}*%",
        f"%TF.FilePolarity,{'Negative' if negative else 'Positive'}*%",
        "%TF.Part,Single*%",
        f"%TF.SameCoordinates,{part}*%",
        "%FSLAX46Y46*%",
        "%MOMM*%",
        "%LPD*%",
        "G01*",
    ]
    apertures: dict[tuple[str, str], int] = {}
    for shape in shapes:
        key = shape.aperture, shape.aperture_function
        if key not in apertures:
            apertures[key] = 10 + len(apertures)
            lines += [
                f"%TA.AperFunction,{shape.aperture_function}*%",
                f"%ADD{apertures[key]}{shape.aperture}*%",
                "%TD*%",
            ]
        lines.append(f"D{apertures[key]}*")
        lines += [f"%TO.N,{shape.net}*%"] if shape.net else []
        if isinstance(shape, Pad):
            lines += [f"%TO.P,{shape.pin}*%"] if shape.pin else []
            lines.append(f"{_gerber_coordinates(shape.centre_mm)}D03*")
        else:
            lines.append(f"{_gerber_coordinates(shape.points_mm[0])}D02*")
            lines += [f"{_gerber_coordinates(point)}D01*" for point in shape.points_mm[1:]]
        lines += ["%TD*%"] if shape.net else []
    return "\n".join([*lines, "M02*", ""])


def drill_text(
    part: str, holes: Iterable[tuple[Point, float]], *, n_layers: int, plated: bool = False
) -> str:
    """Return the content of an Excellon (XNC) drill file of round holes.

    Args:
        part: Name of the part, for people.
        holes: Centre and diameter of each [mm].
        n_layers: Layers of copper, 1 or 2.
        plated: Whether the holes connect them.
    """
    holes = list(holes)
    tools = {diameter: number for number, diameter in enumerate(sorted({d for _, d in holes}), 1)}
    lines = [
        "M48",
        f"; {part}, seen from the side of its electrodes",
        f"; #@! TF.FileFunction,{'Plated' if plated else 'NonPlated'},1,{n_layers},{'PTH' if plated else 'NPTH'}",
        "METRIC",
    ]
    lines += [f"T{number:02d}C{diameter:.3f}" for diameter, number in tools.items()]
    lines += ["%", "G05"]
    for diameter, number in tools.items():
        lines.append(f"T{number:02d}")
        lines += [f"X{u:.3f}Y{v:.3f}" for (u, v), size in holes if size == diameter]
    return "\n".join([*lines, "M30", ""])


def _gerber_coordinates(point: Point) -> str:
    """Return the X and Y words of a point, in Gerber's integer format."""
    u, v = (round(1e6 * value) for value in point)
    return f"X{u}Y{v}"
