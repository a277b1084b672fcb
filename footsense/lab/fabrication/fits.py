"""Checks that the parts fit each other, measured on the written files."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import shapely
from netgen import occ
from shapely import affinity

from footsense.lab.fabrication import dimensions
from footsense.lab.fabrication.checks import ROUNDING_MM, Check, check_at_least, check_near
from footsense.lab.fabrication.parts import sheets, solids
from footsense.lab.fabrication.parts.flex import Flex
from footsense.lab.fabrication.parts.readback import read_holes, read_layer, read_outline
from footsense.lab.geometry import FootDesign


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
    wanted = flexes[0].array.electrode_mm ** 2
    yield Check(
        "row-flex, column-flex",
        "area in which a row faces a column",
        f"{wanted:.3f} mm2",
        f"{min(areas):.3f} to {max(areas):.3f} mm2",
        max(abs(area - wanted) for area in areas) < ROUNDING_MM,
    )


def check_sheets_on_flexes(folder: Path, flexes: tuple[Flex, Flex]) -> Iterator[Check]:
    """Yield the checks that spacer and film are aligned with the flexes."""
    spacer = sheets.read_dxf(folder / "spacer.dxf")
    for flex in flexes:
        areas = [
            _to_foot_frame(shape.polygon, flex)
            for shape in read_layer(folder / flex.name / "copper.gbr")
            if shape.aperture_function == "Other,Electrode"
        ]
        covered = shapely.union_all(areas).intersection(spacer).area
        yield check_near(f"spacer.dxf, {flex.name}", "electrode area under the bars", 0.0, covered, "mm2")
        for name in ("spacer", "film"):
            holes = [
                shapely.Polygon(ring).centroid for ring in sheets.read_dxf(folder / f"{name}.dxf").interiors
            ]
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
    ground, leg, body, socket = (solids.read_step(folder / "step" / f"{name}.step") for name in names)
    file = "step/leg-socket.step"
    yield check_near(
        file, "adhesive around the hemisphere", dimensions.ADHESIVE_THICKNESS_MM, socket.Distance(leg), "mm"
    )
    yield check_at_least(file, "distance to the ground hemisphere", design.plate_mm, socket.Distance(ground))
    for flex in flexes:
        tail = _tail_box_in_channel(folder, design, flex)
        what = f"play of the tail of the {flex.line_kind}s in its channel"
        yield check_near(file, what, dimensions.TAIL_CHANNEL_PLAY_PER_SIDE_MM, socket.Distance(tail), "mm")
    cast = solids.hemisphere_in_mould(design)
    file = "step/mould-body.step"
    yield check_near(file, "overlap of the hemisphere with the mould", 0.0, (body * cast).mass, "mm3")
    low, _ = body.bounding_box
    walls = [face.Distance(cast) for face in body.faces if solids.is_in_plane_through_corner(face, low)]
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
