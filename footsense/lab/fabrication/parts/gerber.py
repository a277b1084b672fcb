"""Writer of Gerber X2 layers and Excellon drill files: traces, rectangular pads, outlines, with nets and pins.

Our own, because libraries do not write the nets: gerbonara 1.6 reads the attributes of apertures and objects (commands
TA and TO) and leaves them out where it writes, and gerber-writer 0.4 knows none of objects. Coordinates in mm with six
decimals.

Source:
    Ucamco, The Gerber Layer Format Specification, revision 2024.05, sections 4.8 and 5;
    Ucamco, The XNC Format Specification, revision 2021.11.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import footsense
from footsense.lab.template import render

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

    @property
    def operations(self) -> list[tuple[Point, str]]:
        """Places and Gerber operations that draw the pad: a flash."""
        return [(self.centre_mm, "D03")]


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
    aperture_function: str = "Conductor"
    net: str = ""

    @property
    def aperture(self) -> str:
        """Gerber aperture template and parameters of the trace."""
        return f"C,{self.width_mm:.6f}"

    @property
    def operations(self) -> list[tuple[Point, str]]:
        """Places and Gerber operations that draw the trace: a move and lines."""
        first, *others = self.points_mm
        return [(first, "D02"), *((point, "D01") for point in others)]


def gerber_text(function: str, part: str, shapes: Iterable[Pad | Trace]) -> str:
    """Return the content of a Gerber X2 file.

    Args:
        function: File function of the layer, such as `COPPER`.
        part: Name of the part, for people.
        shapes: The shapes.
    """
    shapes = list(shapes)
    apertures = dict.fromkeys((shape.aperture, shape.aperture_function) for shape in shapes)
    names = {
        "function": function,
        "part": part,
        "shapes": shapes,
        "numbers": {aperture: number for number, aperture in enumerate(apertures, 10)},
        "version": footsense.__version__,
    }
    return render("lab/fabrication/parts/layer.gbr", names)


def drill_text(part: str, places: Sequence[Point], diameter_mm: float, *, n_layers: int, plated: bool) -> str:
    """Return the content of an Excellon (XNC) drill file of round holes.

    Args:
        part: Name of the part, for people.
        places: Centres [mm].
        diameter_mm: Diameter of each [mm].
        n_layers: Layers of copper, 1 or 2.
        plated: Whether the holes connect them.
    """
    names = {"part": part, "places": places, "diameter_mm": diameter_mm}
    return render("lab/fabrication/parts/holes.drl", {**names, "n_layers": n_layers, "plated": plated})
