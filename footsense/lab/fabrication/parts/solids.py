"""Hemispheres, mould and socket as Open CASCADE solids and STEP files.

Foot frame, mm. Each hemisphere is centred on its own face of the sheet, as in the finite elements. The mould casts both
hemispheres of a foot at once, from one batch, so that they are equally stiff.
"""

import math
import re
from pathlib import Path
from typing import Any

from netgen import occ

from footsense.lab.fabrication import dimensions
from footsense.lab.fabrication.parts.flex import Flex, board_corner_mm
from footsense.lab.fem.mesh import BODY_SIDES, hemisphere
from footsense.lab.geometry import FootDesign


def _mould(design: FootDesign) -> tuple[Any, Any]:
    """Return body (two hollows, open upwards at z = 0) and lid of the casting mould."""
    radius, wall = design.ball_radius_mm, dimensions.MOULD_WALL_MM
    centres = mould_hollow_centres_x_mm(design)
    half_x, half_y = 2.0 * radius + 1.5 * wall, radius + wall
    body = occ.Box(occ.Pnt(-half_x, -half_y, -(radius + wall)), occ.Pnt(half_x, half_y, 0))
    lid = occ.Box(occ.Pnt(-half_x, -half_y, 0), occ.Pnt(half_x, half_y, wall))
    for x in centres:
        body -= occ.Sphere(occ.Pnt(x, 0, 0), radius)
        rim = radius - dimensions.MOULD_VENT_DIAMETER_MM
        bores = [
            (x, 0.0, dimensions.SPRUE_DIAMETER_MM),
            (x, rim, dimensions.MOULD_VENT_DIAMETER_MM),
            (x, -rim, dimensions.MOULD_VENT_DIAMETER_MM),
        ]
        for u, v, diameter in bores:
            lid -= _cylinder(u, v, diameter, (-1.0, wall + 1.0))
    inset = dimensions.MOULD_DOWEL_DIAMETER_MM
    for sign in (-1.0, 1.0):
        place = (sign * (half_x - inset), sign * (half_y - inset), dimensions.MOULD_DOWEL_DIAMETER_MM)
        body -= _cylinder(*place, (-2.0 * dimensions.MOULD_DOWEL_DIAMETER_MM, 1.0))
        lid -= _cylinder(*place, (-1.0, wall + 1.0))
    return body, lid


def mould_hollow_centres_x_mm(design: FootDesign) -> tuple[float, float]:
    """Return x of the centres of the mould's two hollows [mm]."""
    off = design.ball_radius_mm + dimensions.MOULD_WALL_MM / 2.0
    return -off, off


def _socket(design: FootDesign, flexes: tuple[Flex, Flex]) -> Any:
    """Return the leg's socket: it holds the whole curved surface of the leg-side hemisphere."""
    outer = dimensions.socket_outer_radius_mm(design.ball_radius_mm)
    hollow = design.ball_radius_mm + dimensions.ADHESIVE_THICKNESS_MM
    rim = design.plate_mm
    top = dimensions.socket_top_z_mm(design.ball_radius_mm, design.plate_mm)
    solid = _cylinder(0.0, 0.0, 2.0 * outer, (rim, top)) - occ.Sphere(occ.Pnt(0, 0, rim), hollow)
    # Excess adhesive leaves here.
    solid -= _cylinder(0.0, 0.0, dimensions.MOULD_VENT_DIAMETER_MM, (rim, top + 1.0))
    for flex in flexes:
        solid -= _channel(flex, outer + 1.0, (rim - 1.0, top + 1.0))
    for place in screw_places_mm(design):
        solid -= _cylinder(*place, dimensions.CORE_MM, (top - dimensions.CORE_DEPTH_MM, top + 1.0))
    # A bore that marks forward.
    forward = 0.85 * min(flex.channel_floor_mm for flex in flexes)
    return solid - _cylinder(forward, 0.0, dimensions.MOULD_VENT_DIAMETER_MM, (top - 1.0, top + 1.0))


def screw_places_mm(design: FootDesign) -> list[tuple[float, float]]:
    """Return (x, y) of the screws of the leg [mm]."""
    circle = 0.65 * dimensions.socket_outer_radius_mm(design.ball_radius_mm)
    angles = [2.0 * math.pi * (k + 0.5) / dimensions.SCREWS for k in range(dimensions.SCREWS)]
    return [(circle * math.cos(angle), circle * math.sin(angle)) for angle in angles]


def _board_mount(design: FootDesign, flexes: tuple[Flex, Flex]) -> Any:
    """Return the mount of the converter board: a plate between socket and leg, and a wall with spacers in front."""
    outer = dimensions.socket_outer_radius_mm(design.ball_radius_mm)
    top, side = dimensions.socket_top_z_mm(design.ball_radius_mm, design.plate_mm), dimensions.BOARD_SIDE_MM
    x, y, z = board_corner_mm(design.ball_radius_mm)
    wall_x = x - dimensions.MOUNT_SPACER_MM
    # The tail of the common flex passes to the left of what is below the board, that of the element flex in a window.
    common_y = y + dimensions.BOARD_COMMON_FLEX_MM - flexes[0].channel_half_width_mm
    half = flexes[1].channel_half_width_mm
    plate = _cylinder(0.0, 0.0, 2.0 * outer, (top, top + dimensions.MOUNT_WALL_MM))
    plate += occ.Box(occ.Pnt(0.0, y, top), occ.Pnt(wall_x, common_y, top + dimensions.MOUNT_WALL_MM))
    for flex in flexes:
        plate -= _channel(flex, outer + 1.0 if flex.towards == "left" else wall_x, (top - 1.0, top + 9.0))
    plate -= _cylinder(0.0, 0.0, dimensions.MOUNT_VENT_MM, (top - 1.0, top + 9.0))
    for place in screw_places_mm(design):
        plate -= _cylinder(*place, dimensions.MOUNT_SCREW_HOLE_MM, (top - 1.0, top + 9.0))
    below, first_x = min(top, z - 1.0), wall_x - dimensions.MOUNT_WALL_MM
    solid = plate + occ.Box(occ.Pnt(first_x, y, z - 1.0), occ.Pnt(wall_x, y + side, z + side))
    if below < z - 1.0:
        for low_y, high_y in ((y, -half), (half, common_y)):
            solid += occ.Box(occ.Pnt(first_x, low_y, below), occ.Pnt(wall_x, high_y, z))
    for u, v in dimensions.BOARD_HOLES_MM:
        start = occ.Pnt(wall_x, y + u, z + v)
        solid += occ.Cylinder(
            start, occ.X, r=dimensions.MOUNT_SPACER_DIAMETER_MM / 2.0, h=dimensions.MOUNT_SPACER_MM
        )
    for u, v in dimensions.BOARD_HOLES_MM:
        start, depth_mm = occ.Pnt(first_x - 1.0, y + u, z + v), x - first_x + 2.0
        solid -= occ.Cylinder(start, occ.X, r=dimensions.MOUNT_CORE_MM / 2.0, h=depth_mm)
    return solid


def all_parts(design: FootDesign, flexes: tuple[Flex, Flex]) -> dict[str, Any]:
    """Return all solid parts of a foot, shapes of Open CASCADE [mm], by the name of the file."""
    parts = {
        f"hemisphere-{side}": hemisphere(design, side, up * design.plate_mm, quarter=False)
        for side, up in BODY_SIDES
    }
    parts["mould-body"], parts["mould-lid"] = _mould(design)
    parts["leg-socket"] = _socket(design, flexes)
    if flexes[1].shield_net:  # the board of `deploy/board`
        parts["board-mount"] = _board_mount(design, flexes)
    return parts


def write_step(name: str, solid: Any, path: Path) -> None:
    """Write a named solid as a STEP file without a time stamp: the same foot gives the same bytes."""
    solid.name = name
    solid.WriteStep(str(path))
    header = f"FILE_NAME('{name}','',('footsense'),(''),'Open CASCADE','footsense','');"
    text = re.sub(r"FILE_NAME\(.*?\);", header, path.read_text(), count=1, flags=re.DOTALL)
    path.write_text(re.sub(r"Open CASCADE STEP translator [\d. ]+", name, text))


def _channel(flex: Flex, far_mm: float, z_mm: tuple[float, float]) -> Any:
    """Return what the channel of a tail takes away, from its floor to a distance from the axis, as a solid."""
    half, floor, (low, high) = flex.channel_half_width_mm, flex.channel_floor_mm, z_mm
    if flex.towards == "left":
        return occ.Box(occ.Pnt(-half, floor, low), occ.Pnt(half, far_mm, high))
    return occ.Box(occ.Pnt(floor, -half, low), occ.Pnt(far_mm, half, high))


def _cylinder(x_mm: float, y_mm: float, diameter_mm: float, z_mm: tuple[float, float]) -> Any:
    """Return a vertical cylinder as a solid."""
    low, high = z_mm
    return occ.Cylinder(occ.Pnt(x_mm, y_mm, low), occ.Z, r=diameter_mm / 2.0, h=high - low)
