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
from footsense.lab.fabrication.parts.flex import Flex
from footsense.lab.fem.solids import BODY_SIDES, hemisphere
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
    top = rim + design.ball_radius_mm + dimensions.SOCKET_TOP_THICKNESS_MM
    solid = _cylinder(0.0, 0.0, 2.0 * outer, (rim, top)) - occ.Sphere(occ.Pnt(0, 0, rim), hollow)
    solid -= _cylinder(
        0.0, 0.0, dimensions.MOULD_VENT_DIAMETER_MM, (rim, top + 1.0)
    )  # excess adhesive leaves here
    for flex in flexes:
        half, floor = flex.channel_half_width_mm, flex.channel_floor_mm
        corners = [(floor, -half), (outer + 1.0, half)]
        if flex.towards == "left":
            corners = [(-half, floor), (half, outer + 1.0)]
        solid -= occ.Box(occ.Pnt(*corners[0], rim - 1.0), occ.Pnt(*corners[1], top + 1.0))
    for k in range(dimensions.SCREWS):
        angle = 2.0 * math.pi * (k + 0.5) / dimensions.SCREWS
        circle = 0.65 * outer
        place = (circle * math.cos(angle), circle * math.sin(angle), dimensions.CORE_MM)
        solid -= _cylinder(*place, (top - dimensions.CORE_DEPTH_MM, top + 1.0))
    forward = min(flex.channel_floor_mm for flex in flexes)
    solid -= _cylinder(
        0.85 * forward, 0.0, dimensions.MOULD_VENT_DIAMETER_MM, (top - 1.0, top + 1.0)
    )  # marks forward
    return solid


def all_parts(design: FootDesign, flexes: tuple[Flex, Flex]) -> dict[str, Any]:
    """Return all solid parts of a foot, shapes of Open CASCADE [mm], by the name of the file."""
    parts = {
        f"hemisphere-{side}": hemisphere(design, side, up * design.plate_mm, quarter=False)
        for side, up in BODY_SIDES
    }
    parts["mould-body"], parts["mould-lid"] = _mould(design)
    return {**parts, "leg-socket": _socket(design, flexes)}


def write_step(name: str, solid: Any, path: Path) -> None:
    """Write a named solid as a STEP file without a time stamp: the same foot gives the same bytes."""
    solid.name = name
    solid.WriteStep(str(path))
    header = f"FILE_NAME('{name}','',('footsense'),(''),'Open CASCADE','footsense','');"
    text = re.sub(r"FILE_NAME\(.*?\);", header, path.read_text(), count=1, flags=re.DOTALL)
    path.write_text(re.sub(r"Open CASCADE STEP translator [\d. ]+", name, text))


def _cylinder(x_mm: float, y_mm: float, diameter_mm: float, z_mm: tuple[float, float]) -> Any:
    """Return a vertical cylinder as a solid."""
    low, high = z_mm
    return occ.Cylinder(occ.Pnt(x_mm, y_mm, low), occ.Z, r=diameter_mm / 2.0, h=high - low)
