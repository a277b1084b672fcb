"""Checks of the written fabrication files: read back, measured, compared with the expected values."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import shapely

from footsense.lab.fabrication import dimensions
from footsense.lab.fabrication.array import ElementArray
from footsense.lab.fabrication.parts import sheets, solids
from footsense.lab.fabrication.parts.flex import GUARD_NET, Flex
from footsense.lab.fabrication.parts.readback import (
    CopperShape,
    connected_conductors,
    narrowest_width_mm,
    read_holes,
    read_layer,
    read_outline,
)
from footsense.lab.fabrication.tolerances import Tolerance

#: Coordinates and areas of the files are rounded [mm, mm2]; volumes are integrated numerically [1].
ROUNDING_MM, _VOLUME_REL = 2e-3, 1e-6


@dataclass(frozen=True, slots=True)
class Check:
    """One measured quantity of a written file, with its expected value and whether it passed.

    Attributes:
        file: The file, in the folder of the foot.
        quantity: What was measured.
        expected: What it should be.
        measured: What it is.
        passed: Whether it is.
    """

    file: str
    quantity: str
    expected: str
    measured: str
    passed: bool


def check_flex_files(folder: Path, flex: Flex) -> Iterator[Check]:
    """Yield the checks of one flex's Gerber and drill files.

    Args:
        folder: Folder of the files.
        flex: The flex, for what they should be.
    """
    file = f"{flex.name}/copper.gbr"
    shapes = read_layer(folder / file)
    electrodes = [shape.polygon.area for shape in shapes if shape.aperture_function == "Other,Electrode"]
    side, elements = flex.array.electrode_mm, len(flex.line_v_mm) * len(flex.element_u_mm)
    yield Check(
        file,
        "electrodes and area of each",
        f"{elements} of {side**2:.3f} mm2",
        f"{len(electrodes)} of {min(electrodes):.3f} to {max(electrodes):.3f} mm2",
        len(electrodes) == elements and max(abs(area - side**2) for area in electrodes) < ROUNDING_MM,
    )
    conductors = connected_conductors(shapes)
    yield _check_nets(file, flex, conductors)
    narrowest = min(narrowest_width_mm([shape.polygon for shape in one]) for one in conductors)
    yield check_at_least(file, "narrowest conductor", dimensions.MIN_TRACE_MM, narrowest)
    whole = [shapely.union_all([shape.polygon for shape in one]) for one in conductors]
    gap = min(a.distance(b) for k, a in enumerate(whole) for b in whole[:k])
    yield check_at_least(file, "least distance of two nets", dimensions.MIN_NET_CLEARANCE_MM, gap)
    outline = read_outline(folder / flex.name / "profile.gbr")
    inner = [shape.polygon for shape in shapes if shape.aperture_function != "ConnectorPad"]
    to_edge = min(_inset_mm(outline, area) for area in inner)
    yield check_at_least(
        f"{flex.name}/profile.gbr",
        "copper to the cut edge, contacts apart",
        dimensions.MIN_COPPER_TO_EDGE_MM,
        to_edge,
    )
    holes = read_holes(folder / flex.name / "drill.drl")
    to_copper = min(shapely.Point(u, v).distance(area) - d / 2.0 for u, v, d in holes for area in whole)
    yield check_at_least(
        f"{flex.name}/drill.drl",
        f"{len(holes)} holes, distance to copper",
        dimensions.MIN_COPPER_TO_EDGE_MM,
        to_copper,
    )


def _check_nets(file: str, flex: Flex, conductors: list[list[CopperShape]]) -> Check:
    """Return the check that each connected conductor of a flex has the right electrodes, net and contact."""
    expected = set()
    for k, net in enumerate(flex.nets):
        places = frozenset((round(u, 3), round(flex.line_v_mm[k], 3)) for u in flex.element_u_mm)
        expected.add((net, places, frozenset({str(2 * k + 2)})))
    for number in range(1, len(flex.contact_v_mm) + 1, 2):
        expected.add((GUARD_NET, frozenset(), frozenset({str(number)})))
    found = set()
    for one in conductors:
        places = frozenset(
            (round(shape.polygon.centroid.x, 3) + 0.0, round(shape.polygon.centroid.y, 3) + 0.0)
            for shape in one
            if shape.aperture_function == "Other,Electrode"
        )
        pins = frozenset(shape.pin_number for shape in one if shape.pin_number)
        found.add((" and ".join(sorted({shape.net for shape in one})), places, pins))
    right = expected & found
    return Check(
        file,
        "conductors with their own electrodes and contact, and no other",
        f"{len(expected)}: {', '.join(flex.nets)}, guards",
        f"{len(right)} of {len(conductors)}",
        found == expected and len(conductors) == len(expected),
    )


def check_sheet_files(folder: Path, array: ElementArray) -> Iterator[Check]:
    """Yield the checks of the DXF files of spacer and film."""
    spacer, film = (sheets.read_dxf(folder / f"{name}.dxf") for name in ("spacer", "film"))
    half = array.sheet_mm / 2.0
    in_sheet = shapely.box(-half, -half, half, half)
    drilled = 2.0 * math.pi / 4.0 * dimensions.ALIGNMENT_HOLE_DIAMETER_MM**2
    yield check_near(
        "film.dxf", "area in the sheet", array.sheet_mm**2, film.intersection(in_sheet).area, "mm2"
    )
    filled = shapely.Polygon(film.exterior).area - film.area
    yield Check(
        "film.dxf",
        "alignment holes, area of both",
        f"{drilled:.2f} mm2",
        f"{filled:.2f} mm2",
        abs(filled - drilled) < 0.02 * drilled,
    )
    opened = in_sheet.difference(spacer)
    expected = (
        shapely.union_all([sheets.spacer_openings(array), *sheets.vent_channels(array)])
        .intersection(in_sheet)
        .area
    )
    yield check_near("spacer.dxf", "open area in the sheet: cavities and vents", expected, opened.area, "mm2")
    open_air = [
        part for part in shapely.get_parts(opened) if part.intersection(in_sheet.exterior).length > 0.0
    ]
    reached = sum(any(part.contains(shapely.Point(c)) for part in open_air) for c in array.centres_mm)
    aired = len(array.centres_mm)
    yield Check("spacer.dxf", "cavities that outer air reaches", str(aired), str(reached), reached == aired)
    yield Check(
        "spacer.dxf", "pieces", "1", str(len(shapely.get_parts(spacer))), spacer.geom_type == "Polygon"
    )


def check_solid_volumes(folder: Path, parts: list[solids.Part]) -> Iterator[Check]:
    """Yield the checks of the volumes of the STEP files [mm3]."""
    for part in parts:
        measured = solids.read_step(folder / "step" / f"{part.name}.step").mass
        yield Check(
            f"step/{part.name}.step",
            "volume",
            f"{part.formula_volume_mm3:.3f} mm3",
            f"{measured:.3f} mm3",
            abs(measured / part.formula_volume_mm3 - 1.0) < _VOLUME_REL,
        )


def _inset_mm(outline: Any, area: Any) -> float:
    """Return the smallest distance of a shape from the edge of an outline [mm]; negative outside."""
    distance = float(outline.exterior.distance(area))
    return distance if outline.contains(area) else -distance


def check_tolerances(tolerances: list[Tolerance]) -> Iterator[Check]:
    """Yield the checks that the drawing's tolerances are no wider than the design assumed."""
    for row in tolerances:
        quantity = f"{row.name} +-{row.max_deviation:g} {row.unit}, against {row.assumed_text}"
        yield Check(
            "drawing.pdf",
            quantity,
            f"at most {row.max_assumed_deviation:.3g}",
            f"{row.used_of_assumed:.3g}",
            row.is_within_assumed,
        )


def check_at_least(file: str, quantity: str, least_mm: float, measured_mm: float) -> Check:
    """Return the check that a measured length is not below a limit [mm]."""
    return Check(
        file,
        quantity,
        f"at least {least_mm:g} mm",
        f"{measured_mm:.3f} mm",
        measured_mm > least_mm - ROUNDING_MM,
    )


def check_near(file: str, quantity: str, expected: float, measured: float, unit: str) -> Check:
    """Return the check that a measured value is near its expected value."""
    check_near = abs(measured - expected) < ROUNDING_MM
    return Check(file, quantity, f"{expected:.3f} {unit}", f"{measured:.3f} {unit}", check_near)
