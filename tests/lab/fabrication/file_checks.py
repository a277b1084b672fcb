"""Checks of the fabrication files: read back, measured, compared with the design, and with each other."""

import math
from pathlib import Path
from typing import Any

import shapely
from netgen import occ
from shapely import affinity

from footsense.lab.fabrication import dimensions
from footsense.lab.fabrication.parts import sheets
from footsense.lab.fabrication.parts.flex import Flex, board_corner_mm
from footsense.lab.fabrication.parts.solids import mould_hollow_centres_x_mm
from footsense.lab.fem.mesh import EQUAL_WITHIN_MM
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


def check_all_files(folder: Path, design: FootDesign, flexes: tuple[Flex, Flex]) -> None:
    """Check every file of a foot."""
    for flex in flexes:
        check_flex_files(folder, flex)
    check_sheet_files(folder, design)
    check_overlaps(folder, flexes)
    check_sheets_on_flexes(folder, flexes)
    check_solids(folder, design, flexes)


def check_flex_files(folder: Path, flex: Flex) -> None:
    """Check one flex's Gerber and drill files: electrodes, nets, widths, distances, and its shield if it has one."""
    shapes = read_layer(folder / flex.name / "copper.gbr")
    areas = [shape.polygon.area for shape in shapes if shape.aperture_function == "Other,Electrode"]
    assert len(areas) == len(flex.design.element_centres_mm)
    assert max(abs(area - flex.design.electrode_mm**2) for area in areas) < ROUNDING_MM
    conductors = connected_conductors(shapes)
    _check_nets(flex, conductors)
    narrowest = min(narrowest_width_mm([shape.polygon for shape in one]) for one in conductors)
    assert narrowest > dimensions.MIN_TRACE_MM - ROUNDING_MM
    whole = [shapely.union_all([shape.polygon for shape in one]) for one in conductors]
    apart = min((a.distance(b) for k, a in enumerate(whole) for b in whole[:k]), default=math.inf)
    assert apart > dimensions.MIN_NET_CLEARANCE_MM - ROUNDING_MM
    outline = read_outline(folder / flex.name / "profile.gbr")
    inner = [shape.polygon for shape in shapes if shape.aperture_function != "ConnectorPad"]
    assert all(outline.contains(area) for area in inner)
    to_edge = min(outline.exterior.distance(area) for area in inner)
    assert to_edge > dimensions.MIN_COPPER_TO_EDGE_MM - ROUNDING_MM
    holes = read_holes(folder / flex.name / "drill.drl")
    shield = _check_shield(folder / flex.name, flex, shapes, outline) if flex.shield_net else []
    for u, v, d in holes:
        to_copper = min(shapely.Point(u, v).distance(area) - d / 2.0 for area in [*whole, *shield])
        assert to_copper > dimensions.MIN_COPPER_TO_EDGE_MM - ROUNDING_MM


def _check_shield(folder: Path, flex: Flex, shapes: list[CopperShape], outline: Any) -> list[Any]:
    """Check the second layer of a flex, and return its copper: one conductor behind the lines, joined to the guards."""
    conductors = connected_conductors(read_layer(folder / "shield.gbr"))
    assert len(conductors) == 1
    shield = shapely.union_all([shape.polygon for shape in conductors[0]])
    assert outline.contains(shield)
    assert outline.exterior.distance(shield) > dimensions.MIN_COPPER_TO_EDGE_MM - ROUNDING_MM
    stiffened, bare = (
        shapely.union_all([shape.polygon for shape in read_layer(folder / f"{name}.gbr")])
        for name in ("stiffener", "coverlay")
    )
    vias = read_holes(folder / "vias.drl")
    assert len(vias) == 6
    for u, v, diameter in vias:
        ring = shapely.Point(u, v).buffer(0.55 / 2.0 - ROUNDING_MM)
        assert diameter == 0.3
        others = [shape.polygon for shape in shapes if shape.net != flex.shield_net]
        own = shapely.union_all([shape.polygon for shape in shapes if shape.net == flex.shield_net])
        assert own.covers(ring)
        assert shield.covers(ring)
        assert min(ring.distance(other) for other in others) > dimensions.MIN_NET_CLEARANCE_MM
        assert stiffened.covers(ring)
        assert ring.distance(bare) > dimensions.MIN_COPPER_TO_OPENING_MM
    # Behind every line: in the bars, and from where the tail is straight to its contacts.
    half, end = flex.design.array_side_mm / 2.0, flex.tail_end_u_mm - dimensions.TAIL_CONTACT_PAD_LENGTH_MM
    lanes = shapely.union_all([shape.polygon for shape in shapes if shape.aperture_function == "Conductor"])
    electrodes = shapely.union_all(
        [shape.polygon for shape in shapes if shape.aperture_function == "Other,Electrode"]
    )
    in_bars = lanes.intersection(shapely.box(-half, -half, half, half)).difference(electrodes)
    in_tail = lanes.intersection(shapely.box(flex.tail_start_u_mm, -half, end, half))
    assert shapely.union_all([in_bars, in_tail]).difference(shield).area < ROUNDING_MM
    return [shield]


def _check_nets(flex: Flex, conductors: list[list[CopperShape]]) -> None:
    """Check that each connected conductor has its own electrodes, net and contact, and no other."""
    found = []
    for one in conductors:
        places = frozenset(
            (round(shape.polygon.centroid.x, 3) + 0.0, round(shape.polygon.centroid.y, 3) + 0.0)
            for shape in one
            if shape.aperture_function == "Other,Electrode"
        )
        pins = frozenset(int(shape.pin_number) for shape in one if shape.pin_number)
        found.append((" and ".join(sorted({shape.net for shape in one})), places, pins))
    assert sorted(found, key=str) == sorted(_expected_conductors(flex), key=str)


def _expected_conductors(
    flex: Flex,
) -> list[tuple[str, frozenset[tuple[float, float]], frozenset[int]]]:
    """Return net, places of the electrodes and contacts of each conductor."""
    low_to_high = [round(value, 3) for value in reversed(flex.design.line_mm)]
    if flex.name == "common-flex":
        everywhere = frozenset((u, v) for u in low_to_high for v in low_to_high)
        return [("gnd", everywhere, frozenset({1, 2, 3, 4}))]
    if flex.name == "element-flex":
        # Contacts of each column in its order of rows, between guards: 2, 4, 6 of 7.
        rows = {1: (1, 2, 3), 2: (2, 1, 3), 3: (3, 2, 1)}
        guards = [
            (
                flex.shield_net or f"shld{column}",
                frozenset[tuple[float, float]](),
                frozenset({7 * (column - 1) + odd}),
            )
            for column in rows
            for odd in (1, 3, 5, 7)
        ]
        return guards + [
            (
                f"row{row}col{column}",
                frozenset({(low_to_high[3 - row], low_to_high[column - 1])}),
                frozenset({7 * (column - 1) + 2 * position}),
            )
            for column, order in rows.items()
            for position, row in enumerate(order, 1)
        ]
    guards = [("shld", frozenset[tuple[float, float]](), frozenset({odd})) for odd in (1, 3, 5, 7)]
    return guards + [
        (f"{flex.name[:3]}{k}", frozenset((u, v) for u in low_to_high), frozenset({2 * k}))
        for k, v in enumerate(low_to_high, 1)
    ]


def check_sheet_files(folder: Path, design: FootDesign) -> None:
    """Check the DXF files of spacer and film: areas, holes, and that air reaches every cavity."""
    spacer, film = (read_dxf(folder / f"{name}.dxf") for name in ("spacer", "film"))
    half = design.sheet_mm / 2.0
    in_sheet = shapely.box(-half, -half, half, half)
    assert abs(film.intersection(in_sheet).area - design.sheet_mm**2) < ROUNDING_MM
    drilled = 2.0 * math.pi / 4.0 * dimensions.ALIGNMENT_HOLE_DIAMETER_MM**2
    assert abs(shapely.Polygon(film.exterior).area - film.area - drilled) < 0.02 * drilled
    opened = in_sheet.difference(spacer)
    wanted = shapely.union_all([sheets.spacer_openings(design), *sheets.vent_channels(design)])
    assert abs(opened.area - wanted.intersection(in_sheet).area) < ROUNDING_MM
    aired = [part for part in shapely.get_parts(opened) if part.intersection(in_sheet.exterior).length > 0.0]
    assert all(
        any(part.contains(shapely.Point(centre)) for part in aired) for centre in design.element_centres_mm
    )
    assert spacer.geom_type == "Polygon"


def formula_volumes_mm3(design: FootDesign, flexes: tuple[Flex, Flex]) -> dict[str, float]:
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
        "leg-socket": _socket_volume_mm3(design, flexes),
    }


def _socket_volume_mm3(design: FootDesign, flexes: tuple[Flex, Flex]) -> float:
    """Return the volume of the socket by formula [mm3]."""
    outer = dimensions.socket_outer_radius_mm(design.ball_radius_mm)
    hollow = design.ball_radius_mm + dimensions.ADHESIVE_THICKNESS_MM
    height = design.ball_radius_mm + dimensions.SOCKET_TOP_THICKNESS_MM
    air = dimensions.MOULD_VENT_DIAMETER_MM / 2.0
    volume: float = math.pi * outer**2 * height - 2.0 / 3.0 * math.pi * hollow**3
    # What the bore for the adhesive cuts beyond the hollow.
    volume -= math.pi * air**2 * height - 2.0 / 3.0 * math.pi * (hollow**3 - (hollow**2 - air**2) ** 1.5)
    for flex in flexes:
        half, floor = flex.channel_half_width_mm, flex.channel_floor_mm
        segment = half * math.sqrt(outer**2 - half**2) + outer**2 * math.asin(half / outer)
        volume -= height * (segment - 2.0 * half * floor)
    volume -= dimensions.SCREWS * math.pi / 4.0 * dimensions.CORE_MM**2 * dimensions.CORE_DEPTH_MM
    return volume - math.pi * air**2  # the forward mark is 1 mm deep


def check_overlaps(folder: Path, flexes: tuple[Flex, Flex]) -> None:
    """Check that each row faces each column, or the common electrode each element, over one electrode's area."""
    nets: list[dict[str, Any]] = []
    for flex in flexes:
        copper: dict[str, list[Any]] = {net: [] for net, _ in flex.electrodes}
        for shape in read_layer(folder / flex.name / "copper.gbr"):
            if shape.net in copper:
                copper[shape.net].append(_to_foot_frame(shape.polygon, flex))
        nets.append({net: shapely.union_all(areas) for net, areas in copper.items()})
    below, above = nets
    assert len(below) * len(above) == len(flexes[0].design.element_centres_mm)
    for low in below.values():
        for high in above.values():
            assert abs(low.intersection(high).area - flexes[0].design.electrode_mm ** 2) < ROUNDING_MM


def check_sheets_on_flexes(folder: Path, flexes: tuple[Flex, Flex]) -> None:
    """Check that spacer and film are aligned with the flexes, and no electrode is under a bar."""
    spacer = read_dxf(folder / "spacer.dxf")
    for flex in flexes:
        areas = [
            _to_foot_frame(shape.polygon, flex)
            for shape in read_layer(folder / flex.name / "copper.gbr")
            if shape.aperture_function == "Other,Electrode"
        ]
        assert shapely.union_all(areas).intersection(spacer).area < ROUNDING_MM
        drilled = read_holes(folder / flex.name / "drill.drl")
        for name in ("spacer", "film"):
            holes = [shapely.Polygon(ring).centroid for ring in read_dxf(folder / f"{name}.dxf").interiors]
            for u, v, _ in drilled:
                pin = shapely.Point(flex.artwork_to_foot((u, v)))
                assert min(pin.distance(hole) for hole in holes) < ROUNDING_MM


def check_solids(folder: Path, design: FootDesign, flexes: tuple[Flex, Flex]) -> None:
    """Check the volumes of the STEP files, and that hemispheres and tails fit mould and socket."""
    volumes_mm3 = formula_volumes_mm3(design, flexes)
    solids = {name: read_step(folder / "step" / f"{name}.step") for name in volumes_mm3}
    for name, volume_mm3 in volumes_mm3.items():
        assert abs(solids[name].mass / volume_mm3 - 1.0) < _VOLUME_REL, name
    socket, body = solids["leg-socket"], solids["mould-body"]
    adhesive_mm = socket.Distance(solids["hemisphere-leg"])
    assert abs(adhesive_mm - dimensions.ADHESIVE_THICKNESS_MM) < ROUNDING_MM
    assert socket.Distance(solids["hemisphere-ground"]) > design.plate_mm - ROUNDING_MM
    for flex in flexes:
        play_mm = socket.Distance(_tail_box_in_channel(folder, design, flex))
        assert abs(play_mm - dimensions.TAIL_CHANNEL_PLAY_PER_SIDE_MM) < ROUNDING_MM
    if flexes[1].shield_net:
        _check_mount(read_step(folder / "step" / "board-mount.step"), socket, design, flexes)
    centre = occ.Pnt(mould_hollow_centres_x_mm(design)[0], 0, 0)
    cast = occ.Sphere(centre, design.ball_radius_mm) * occ.HalfSpace(centre, occ.Vec(0, 0, 1))
    assert (body * cast).mass < ROUNDING_MM
    corner, _ = body.bounding_box
    walls_mm = [face.Distance(cast) for face in body.faces if _is_in_plane_through_corner(face, corner)]
    assert abs(min(walls_mm) - dimensions.MOULD_WALL_MM) < ROUNDING_MM


def _check_mount(mount: Any, socket: Any, design: FootDesign, flexes: tuple[Flex, Flex]) -> None:
    """Check that the mount lies on the socket, lets both tails through, and that they reach the board."""
    assert len(mount.solids) == 1
    assert (mount * socket).mass < ROUNDING_MM
    assert mount.Distance(socket) < ROUNDING_MM
    common, element = flexes
    corner_x, corner_y, corner_z = board_corner_mm(design.ball_radius_mm)
    half, floor = element.tail_half_width_mm, element.channel_floor_mm
    end_z = corner_z - dimensions.MOUNT_WALL_MM
    straight = occ.Box(occ.Pnt(floor, -half, 0.0), occ.Pnt(floor + 0.1, half, end_z))
    assert (mount * straight).mass < ROUNDING_MM
    # From the channel on the left to in front of the board, and up to its connector.
    lane_y = corner_y + dimensions.BOARD_COMMON_FLEX_MM
    forward_mm = corner_x + dimensions.BOARD_THICKNESS_MM
    way_mm = math.hypot(forward_mm, common.channel_floor_mm - lane_y, corner_z)
    assert common.tail_end_u_mm > common.channel_floor_mm + way_mm + dimensions.BOARD_COMMON_FLEX_END_MM


def _tail_box_in_channel(folder: Path, design: FootDesign, flex: Flex) -> Any:
    """Return a flex's tail [mm], centred in its channel, as wide as its outline at the contacts."""
    outline = read_outline(folder / flex.name / "profile.gbr")
    across = outline.intersection(
        shapely.LineString([(flex.tail_end_u_mm - 1.0, -99.0), (flex.tail_end_u_mm - 1.0, 99.0)])
    )
    _, low_v, _, high_v = across.bounds
    # As far from the floor as from the sides, which are lower than the middle of the channel is deep.
    u = flex.channel_floor_mm + dimensions.TAIL_CHANNEL_PLAY_PER_SIDE_MM + 0.05
    (x, y), (far_x, far_y) = flex.artwork_to_foot((u - 0.05, low_v)), flex.artwork_to_foot((u + 0.05, high_v))
    low, high = design.plate_mm, design.plate_mm + design.ball_radius_mm
    corners = (min(x, far_x), min(y, far_y), low), (max(x, far_x), max(y, far_y), high)
    return occ.Box(*(occ.Pnt(*corner) for corner in corners))


def _to_foot_frame(area: Any, flex: Flex) -> Any:
    """Return a shape of the artwork transformed to the foot frame."""
    (a, d), (b, e) = (flex.artwork_to_foot(point) for point in ((1.0, 0.0), (0.0, 1.0)))
    return affinity.affine_transform(area, [a, b, d, e, 0.0, 0.0])


def _is_in_plane_through_corner(face: Any, corner: Any) -> bool:
    """Tell whether a face lies in one of the three planes through a box's lowest corner."""
    _, high = face.bounding_box
    return any(abs(getattr(high, axis) - getattr(corner, axis)) < EQUAL_WITHIN_MM for axis in ("x", "y", "z"))
