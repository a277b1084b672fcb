"""Checks of the fabrication files: read back, measured, compared with the expected values, and with each other."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import shapely
from netgen import occ
from shapely import affinity

from footsense.lab.fabrication import dimensions
from footsense.lab.fabrication.parts import sheets
from footsense.lab.fabrication.parts.flex import GUARD_NET, Flex
from footsense.lab.fabrication.parts.solids import column_and_row_tail_widths_mm, mould_hollow_centres_x_mm
from footsense.lab.fem.solids import EQUAL_WITHIN_MM
from footsense.lab.geometry import FootDesign
from tests.lab.fabrication.readback import (
    CopperShape,
    connected_conductors,
    narrowest_width_mm,
    read_dxf,
    read_holes,
    read_layer,
    read_outline,
    read_step,
)

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
    side, elements = flex.design.electrode_mm, len(flex.line_v_mm) * len(flex.element_u_mm)
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


def check_sheet_files(folder: Path, design: FootDesign) -> Iterator[Check]:
    """Yield the checks of the DXF files of spacer and film."""
    spacer, film = (read_dxf(folder / f"{name}.dxf") for name in ("spacer", "film"))
    half = design.sheet_mm / 2.0
    in_sheet = shapely.box(-half, -half, half, half)
    drilled = 2.0 * math.pi / 4.0 * dimensions.ALIGNMENT_HOLE_DIAMETER_MM**2
    yield check_near(
        "film.dxf", "area in the sheet", design.sheet_mm**2, film.intersection(in_sheet).area, "mm2"
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
        shapely.union_all([sheets.spacer_openings(design), *sheets.vent_channels(design)])
        .intersection(in_sheet)
        .area
    )
    yield check_near("spacer.dxf", "open area in the sheet: cavities and vents", expected, opened.area, "mm2")
    open_air = [
        part for part in shapely.get_parts(opened) if part.intersection(in_sheet.exterior).length > 0.0
    ]
    reached = sum(
        any(part.contains(shapely.Point(c)) for part in open_air) for c in design.element_centres_mm
    )
    aired = len(design.element_centres_mm)
    yield Check("spacer.dxf", "cavities that outer air reaches", str(aired), str(reached), reached == aired)
    yield Check(
        "spacer.dxf", "pieces", "1", str(len(shapely.get_parts(spacer))), spacer.geom_type == "Polygon"
    )


def check_solid_volumes(folder: Path, design: FootDesign) -> Iterator[Check]:
    """Yield the checks of the volumes of the STEP files [mm3], against formulas."""
    for name, volume_mm3 in formula_volumes_mm3(design).items():
        measured = read_step(folder / "step" / f"{name}.step").mass
        yield Check(
            f"step/{name}.step",
            "volume",
            f"{volume_mm3:.3f} mm3",
            f"{measured:.3f} mm3",
            abs(measured / volume_mm3 - 1.0) < _VOLUME_REL,
        )


def formula_volumes_mm3(design: FootDesign) -> dict[str, float]:
    """Return the volume of each solid part by formula [mm3], by name."""
    radius, wall = design.ball_radius_mm, dimensions.MOULD_WALL_MM
    hemisphere = 2.0 / 3.0 * math.pi * radius**3
    plan_mm2 = 4.0 * (2.0 * radius + 1.5 * wall) * (radius + wall)
    dowel = dimensions.MOULD_DOWEL_DIAMETER_MM
    bores_mm2 = math.pi / 4.0 * (dimensions.SPRUE_DIAMETER_MM**2 + 2.0 * dimensions.MOULD_VENT_DIAMETER_MM**2)
    pin_mm2 = math.pi / 4.0 * dowel**2
    return {
        "hemisphere-ground": hemisphere,
        "hemisphere-leg": hemisphere,
        "mould-body": plan_mm2 * (radius + wall) - 2.0 * hemisphere - 4.0 * dowel * pin_mm2,
        "mould-lid": plan_mm2 * wall - 2.0 * wall * (bores_mm2 + pin_mm2),
        "leg-socket": _socket_volume_mm3(design),
    }


def _socket_volume_mm3(design: FootDesign) -> float:
    """Return the volume of the socket by formula [mm3]."""
    outer, hollow = (
        dimensions.socket_outer_radius_mm(design.ball_radius_mm),
        design.ball_radius_mm + dimensions.ADHESIVE_THICKNESS_MM,
    )
    height, air = (
        design.ball_radius_mm + dimensions.SOCKET_TOP_THICKNESS_MM,
        dimensions.MOULD_VENT_DIAMETER_MM / 2.0,
    )
    volume: float = math.pi * outer**2 * height - 2.0 / 3.0 * math.pi * hollow**3
    # What the bore for the adhesive cuts beyond the hollow.
    volume -= math.pi * air**2 * height - 2.0 / 3.0 * math.pi * (hollow**3 - (hollow**2 - air**2) ** 1.5)
    for width in column_and_row_tail_widths_mm(design):
        half = width / 2.0 + dimensions.TAIL_CHANNEL_PLAY_PER_SIDE_MM
        segment = half * math.sqrt(outer**2 - half**2) + outer**2 * math.asin(half / outer)
        volume -= height * (segment - 2.0 * half * (outer - dimensions.TAIL_CHANNEL_DEPTH_MM))
    volume -= dimensions.SCREWS * math.pi / 4.0 * dimensions.CORE_MM**2 * dimensions.CORE_DEPTH_MM
    return volume - math.pi * air**2  # the forward mark is 1 mm deep


def _inset_mm(outline: Any, area: Any) -> float:
    """Return the smallest distance of a shape from the edge of an outline [mm]; negative outside."""
    distance = float(outline.exterior.distance(area))
    return distance if outline.contains(area) else -distance


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


def overlaps_mm2(folder: Path, flexes: tuple[Flex, Flex]) -> dict[tuple[str, str], float]:
    """Return the overlap area of each row and column electrode [mm2], from the copper files."""
    nets: list[dict[str, Any]] = []
    for flex in flexes:
        copper: dict[str, list[Any]] = {net: [] for net in flex.nets}
        for shape in read_layer(folder / flex.name / "copper.gbr"):
            if shape.net in copper:
                copper[shape.net].append(_to_foot_frame(shape.polygon, flex))
        nets.append({net: shapely.union_all(areas) for net, areas in copper.items()})
    rows, columns = nets
    return {(r, c): rows[r].intersection(columns[c]).area for r in rows for c in columns}


def check_overlaps(folder: Path, flexes: tuple[Flex, Flex]) -> Iterator[Check]:
    """Yield the check that each row faces each column over one electrode's area, nowhere else."""
    areas = overlaps_mm2(folder, flexes).values()
    wanted = flexes[0].design.electrode_mm ** 2
    yield Check(
        "row-flex, column-flex",
        "area in which a row faces a column",
        f"{wanted:.3f} mm2",
        f"{min(areas):.3f} to {max(areas):.3f} mm2",
        max(abs(area - wanted) for area in areas) < ROUNDING_MM,
    )


def check_sheets_on_flexes(folder: Path, flexes: tuple[Flex, Flex]) -> Iterator[Check]:
    """Yield the checks that spacer and film are aligned with the flexes."""
    spacer = read_dxf(folder / "spacer.dxf")
    for flex in flexes:
        areas = [
            _to_foot_frame(shape.polygon, flex)
            for shape in read_layer(folder / flex.name / "copper.gbr")
            if shape.aperture_function == "Other,Electrode"
        ]
        covered = shapely.union_all(areas).intersection(spacer).area
        yield check_near(f"spacer.dxf, {flex.name}", "electrode area under the bars", 0.0, covered, "mm2")
        for name in ("spacer", "film"):
            holes = [shapely.Polygon(ring).centroid for ring in read_dxf(folder / f"{name}.dxf").interiors]
            pins = [
                shapely.Point(flex.artwork_to_foot((u, v)))
                for u, v, _ in read_holes(folder / flex.name / "drill.drl")
            ]
            off = max(min(pin.distance(hole) for hole in holes) for pin in pins)
            yield check_near(f"{name}.dxf, {flex.name}", "distance of their alignment holes", 0.0, off, "mm")


def check_hemispheres_and_socket(
    folder: Path, design: FootDesign, flexes: tuple[Flex, Flex]
) -> Iterator[Check]:
    """Yield the checks that the hemispheres fit mould and socket, and the flex tails their channels."""
    names = "hemisphere-ground", "hemisphere-leg", "mould-body", "leg-socket"
    ground, leg, body, socket = (read_step(folder / "step" / f"{name}.step") for name in names)
    file = "step/leg-socket.step"
    yield check_near(
        file, "adhesive around the hemisphere", dimensions.ADHESIVE_THICKNESS_MM, socket.Distance(leg), "mm"
    )
    yield check_at_least(file, "distance to the ground hemisphere", design.plate_mm, socket.Distance(ground))
    for flex in flexes:
        tail = _tail_box_in_channel(folder, design, flex)
        what = f"play of the tail of the {flex.line_kind}s in its channel"
        yield check_near(file, what, dimensions.TAIL_CHANNEL_PLAY_PER_SIDE_MM, socket.Distance(tail), "mm")
    cast = hemisphere_in_mould(design)
    file = "step/mould-body.step"
    yield check_near(file, "overlap of the hemisphere with the mould", 0.0, (body * cast).mass, "mm3")
    low, _ = body.bounding_box
    walls = [face.Distance(cast) for face in body.faces if is_in_plane_through_corner(face, low)]
    yield check_near(file, "least wall, bottom and sides", dimensions.MOULD_WALL_MM, min(walls), "mm")


def _tail_box_in_channel(folder: Path, design: FootDesign, flex: Flex) -> Any:
    """Return a flex's tail [mm], centred in its channel, as wide as its outline at the contacts."""
    outline = read_outline(folder / flex.name / "profile.gbr")
    across = outline.intersection(
        shapely.LineString([(flex.tail_end_u_mm - 1.0, -99.0), (flex.tail_end_u_mm - 1.0, 99.0)])
    )
    _, low_v, _, high_v = across.bounds
    u = dimensions.socket_outer_radius_mm(design.ball_radius_mm) - dimensions.TAIL_CHANNEL_DEPTH_MM / 2.0
    (x, y), (far_x, far_y) = flex.artwork_to_foot((u - 0.05, low_v)), flex.artwork_to_foot((u + 0.05, high_v))
    low, high = design.plate_mm, design.plate_mm + design.ball_radius_mm
    corners = (min(x, far_x), min(y, far_y), low), (max(x, far_x), max(y, far_y), high)
    return occ.Box(*(occ.Pnt(*corner) for corner in corners))


def _to_foot_frame(area: Any, flex: Flex) -> Any:
    """Return a shape of the artwork transformed to the foot frame."""
    (a, d), (b, e) = (flex.artwork_to_foot(point) for point in ((1.0, 0.0), (0.0, 1.0)))
    return affinity.affine_transform(area, [a, b, d, e, 0.0, 0.0])


def hemisphere_in_mould(design: FootDesign) -> Any:
    """Return a hemisphere in its position in the mould [mm]."""
    centre = occ.Pnt(mould_hollow_centres_x_mm(design)[0], 0, 0)
    return occ.Sphere(centre, design.ball_radius_mm) * occ.HalfSpace(centre, occ.Vec(0, 0, 1))


def is_in_plane_through_corner(face: Any, low: Any) -> bool:
    """Tell whether a face lies in one of the three planes through a box's lowest corner."""
    _, high = face.bounding_box
    return any(abs(getattr(high, axis) - getattr(low, axis)) < EQUAL_WITHIN_MM for axis in ("x", "y", "z"))


def all_checks(folder: Path, design: FootDesign, flexes: tuple[Flex, Flex]) -> list[Check]:
    """Return every check of the files of a foot."""
    return [
        *(check for flex in flexes for check in check_flex_files(folder, flex)),
        *check_sheet_files(folder, design),
        *check_solid_volumes(folder, design),
        *check_overlaps(folder, flexes),
        *check_sheets_on_flexes(folder, flexes),
        *check_hemispheres_and_socket(folder, design, flexes),
    ]
