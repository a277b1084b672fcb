"""The written files read back and measured: what they should be, what they are."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import shapely
from shapely import affinity

from footsense.foot.cavity.air import CavityKind
from footsense.lab.fabrication import process
from footsense.lab.fabrication.array import ElementArray
from footsense.lab.fabrication.parts import sheets, solids
from footsense.lab.fabrication.parts.flex import GUARD, Flex
from footsense.lab.fabrication.parts.readback import (
    Shape,
    narrowest_mm,
    pieces,
    read_holes,
    read_layer,
    read_outline,
)
from footsense.lab.geometry import FootDesign

#: Coordinates and areas of the files are rounded [mm, mm2]; volumes are integrated numerically [1].
_ROUNDING_MM, _VOLUME_REL = 2e-3, 1e-6


@dataclass(frozen=True, slots=True)
class Check:
    """One figure of a file.

    Attributes:
        file: The file, in the folder of the foot.
        what: What was measured.
        wanted: What it should be.
        measured: What it is.
        passed: Whether it is.
    """

    file: str
    what: str
    wanted: str
    measured: str
    passed: bool


def check_flex(folder: Path, flex: Flex) -> Iterator[Check]:
    """Yield the checks of one flex.

    Args:
        folder: Folder of the files.
        flex: The flex, for what they should be.
    """
    file = f"{flex.name}/copper.gbr"
    shapes = read_layer(folder / file)
    electrodes = [shape.area.area for shape in shapes if shape.function == "Other,Electrode"]
    side, elements = flex.array.electrode_mm, len(flex.line_v_mm) * len(flex.element_u_mm)
    yield Check(
        file,
        "electrodes and area of each",
        f"{elements} of {side**2:.3f} mm2",
        f"{len(electrodes)} of {min(electrodes):.3f} to {max(electrodes):.3f} mm2",
        len(electrodes) == elements and max(abs(area - side**2) for area in electrodes) < _ROUNDING_MM,
    )
    conductors = pieces(shapes)
    yield _nets(file, flex, conductors)
    narrowest = min(narrowest_mm([shape.area for shape in one]) for one in conductors)
    yield _at_least(file, "narrowest conductor", process.MIN_TRACE_MM, narrowest)
    whole = [shapely.union_all([shape.area for shape in one]) for one in conductors]
    gap = min(a.distance(b) for k, a in enumerate(whole) for b in whole[:k])
    yield _at_least(file, "least distance of two nets", process.MIN_GAP_MM, gap)
    outline = read_outline(folder / flex.name / "profile.gbr")
    inner = [shape.area for shape in shapes if shape.function != "ConnectorPad"]
    to_edge = min(_depth_mm(outline, area) for area in inner)
    yield _at_least(
        f"{flex.name}/profile.gbr", "copper to the cut edge, contacts apart", process.EDGE_MM, to_edge
    )
    holes = read_holes(folder / flex.name / "drill.drl")
    to_copper = min(shapely.Point(u, v).distance(area) - d / 2.0 for u, v, d in holes for area in whole)
    yield _at_least(
        f"{flex.name}/drill.drl", f"{len(holes)} holes, distance to copper", process.EDGE_MM, to_copper
    )


def _nets(file: str, flex: Flex, conductors: list[list[Shape]]) -> Check:
    """Compare each conductor, found as connected copper, with the line that it should be."""
    wanted = set()
    for k, net in enumerate(flex.nets):
        places = frozenset((round(u, 3), round(flex.line_v_mm[k], 3)) for u in flex.element_u_mm)
        wanted.add((net, places, frozenset({str(2 * k + 2)})))
    for number in range(1, len(flex.contact_v_mm) + 1, 2):
        wanted.add((GUARD, frozenset(), frozenset({str(number)})))
    found = set()
    for one in conductors:
        places = frozenset(
            (round(shape.area.centroid.x, 3) + 0.0, round(shape.area.centroid.y, 3) + 0.0)
            for shape in one
            if shape.function == "Other,Electrode"
        )
        pins = frozenset(shape.pin for shape in one if shape.pin)
        found.add((" and ".join(sorted({shape.net for shape in one})), places, pins))
    right = wanted & found
    return Check(
        file,
        "conductors with their own electrodes and contact, and no other",
        f"{len(wanted)}: {', '.join(flex.nets)}, guards",
        f"{len(right)} of {len(conductors)}",
        found == wanted and len(conductors) == len(wanted),
    )


def overlaps_mm2(folder: Path, flexes: tuple[Flex, Flex]) -> dict[tuple[str, str], float]:
    """Return the area in which each row and each column face each other [mm2], from the copper files."""
    nets: list[dict[str, Any]] = []
    for flex in flexes:
        copper: dict[str, list[Any]] = {net: [] for net in flex.nets}
        for shape in read_layer(folder / flex.name / "copper.gbr"):
            if shape.net in copper:
                copper[shape.net].append(_in_foot(shape.area, flex))
        nets.append({net: shapely.union_all(areas) for net, areas in copper.items()})
    rows, columns = nets
    return {(r, c): rows[r].intersection(columns[c]).area for r in rows for c in columns}


def check_overlaps(folder: Path, flexes: tuple[Flex, Flex]) -> Iterator[Check]:
    """Yield the check that rows and columns face each other in the elements and nowhere else."""
    areas = overlaps_mm2(folder, flexes).values()
    wanted = flexes[0].array.electrode_mm ** 2
    yield Check(
        "row-flex, column-flex",
        "area in which a row faces a column",
        f"{wanted:.3f} mm2",
        f"{min(areas):.3f} to {max(areas):.3f} mm2",
        max(abs(area - wanted) for area in areas) < _ROUNDING_MM,
    )


def check_sheets(folder: Path, array: ElementArray, cavity: CavityKind) -> Iterator[Check]:
    """Yield the checks of spacer and film."""
    spacer, film = (sheets.read_dxf(folder / f"{name}.dxf") for name in ("spacer", "film"))
    half = array.sheet_mm / 2.0
    in_sheet = shapely.box(-half, -half, half, half)
    drilled = 2.0 * math.pi / 4.0 * process.HOLE_MM**2
    yield _near("film.dxf", "area in the sheet", array.sheet_mm**2, film.intersection(in_sheet).area, "mm2")
    filled = shapely.Polygon(film.exterior).area - film.area
    yield Check(
        "film.dxf",
        "alignment holes, area of both",
        f"{drilled:.2f} mm2",
        f"{filled:.2f} mm2",
        abs(filled - drilled) < 0.02 * drilled,
    )
    open_mm2 = in_sheet.difference(spacer).area
    channels = shapely.union_all(sheets.vents(array)).intersection(in_sheet) if cavity == "vented" else None
    wanted = len(array.centres_mm) * array.electrode_mm**2
    wanted += channels.difference(sheets.cavities(array)).area if channels is not None else 0.0
    yield _near("spacer.dxf", "open area in the sheet: cavities and vents", wanted, open_mm2, "mm2")
    yield Check(
        "spacer.dxf", "pieces", "1", str(len(shapely.get_parts(spacer))), spacer.geom_type == "Polygon"
    )


def check_solids(folder: Path, design: FootDesign, made: list[solids.Part]) -> Iterator[Check]:
    """Yield the checks of the STEP files: volumes, fit of the hemisphere in mould and socket, walls."""
    parts = {part.name: solids.read_step(folder / "step" / f"{part.name}.step") for part in made}
    for part in made:
        measured = parts[part.name].mass
        yield Check(
            f"step/{part.name}.step",
            "volume",
            f"{part.volume_mm3:.3f} mm3",
            f"{measured:.3f} mm3",
            abs(measured / part.volume_mm3 - 1.0) < _VOLUME_REL,
        )
    leg, socket = parts["hemisphere-leg"], parts["leg-socket"]
    file = "step/leg-socket.step"
    yield _near(file, "adhesive around the hemisphere", process.ADHESIVE_MM, socket.Distance(leg), "mm")
    ground_mm = socket.Distance(parts["hemisphere-ground"])
    yield _at_least(file, "distance to the ground hemisphere", design.plate_mm, ground_mm)
    yield from _in_mould(design, parts)


def _in_mould(design: FootDesign, parts: dict[str, Any]) -> Iterator[Check]:
    """Yield the checks of the mould around its castings."""
    file, body = "step/mould-body.step", parts["mould-body"]
    cast = solids.casting(design)
    yield _near(file, "overlap of the hemisphere with the mould", 0.0, (body * cast).mass, "mm3")
    low, _ = body.bounding_box
    walls = [face.Distance(cast) for face in body.faces if solids.lies_outside(face, low)]
    yield _near(file, "least wall, bottom and sides", process.MOULD_WALL_MM, min(walls), "mm")


def _depth_mm(outline: Any, area: Any) -> float:
    """Return the least distance of a shape from the edge of an outline [mm], negative outside."""
    distance = float(outline.exterior.distance(area))
    return distance if outline.contains(area) else -distance


def _in_foot(area: Any, flex: Flex) -> Any:
    """Return a shape of the artwork in the foot frame."""
    (a, d), (b, e) = (flex.to_foot(point) for point in ((1.0, 0.0), (0.0, 1.0)))
    return affinity.affine_transform(area, [a, b, d, e, 0.0, 0.0])


def _at_least(file: str, what: str, least_mm: float, measured_mm: float) -> Check:
    return Check(
        file,
        what,
        f"at least {least_mm:g} mm",
        f"{measured_mm:.3f} mm",
        measured_mm > least_mm - _ROUNDING_MM,
    )


def _near(file: str, what: str, wanted: float, measured: float, unit: str) -> Check:
    near = abs(measured - wanted) < _ROUNDING_MM
    return Check(file, what, f"{wanted:.3f} {unit}", f"{measured:.3f} {unit}", near)
