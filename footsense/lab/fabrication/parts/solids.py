"""Hemispheres, mould and socket as Open CASCADE solids and STEP files.

Foot frame, mm. Each hemisphere is centred on its own face of the sheet, as in the finite elements. The mould casts both
hemispheres of a foot at once, from one batch, so that they are equally stiff.
"""

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from netgen import occ

from footsense.lab.fabrication import dimensions
from footsense.lab.fabrication.parts.flex import flexes
from footsense.lab.fem.solids import BODY_SIDES, hemisphere
from footsense.lab.geometry import FootDesign


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """One solid part.

    Attributes:
        name: Its name, and that of its file.
        solid: Shape of Open CASCADE [mm].
    """

    name: str
    solid: Any


def hemispheres(design: FootDesign) -> list[Part]:
    """Return the ground-side and the leg-side hemisphere as parts."""
    return [
        Part(name=f"hemisphere-{side}", solid=hemisphere(design, side, up * design.plate_mm, quarter=False))
        for side, up in BODY_SIDES
    ]


def mould(design: FootDesign) -> list[Part]:
    """Return body (two hollows, open upwards at z = 0) and lid of the casting mould as parts."""
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
    return [Part(name="mould-body", solid=body), Part(name="mould-lid", solid=lid)]


def mould_hollow_centres_x_mm(design: FootDesign) -> tuple[float, float]:
    """Return x of the centres of the mould's two hollows [mm]."""
    off = design.ball_radius_mm + dimensions.MOULD_WALL_MM / 2.0
    return -off, off


def column_and_row_tail_widths_mm(design: FootDesign) -> tuple[float, float]:
    """Return the widths of the column flex's tail (forward) and the row flex's tail (to the left) [mm]."""
    rows, columns = flexes(design)
    return 2.0 * columns.tail_half_width_mm, 2.0 * rows.tail_half_width_mm


def socket(design: FootDesign) -> Part:
    """Return the leg's socket as a part: it holds the whole curved surface of the leg-side hemisphere."""
    outer, hollow = (
        dimensions.socket_outer_radius_mm(design.ball_radius_mm),
        design.ball_radius_mm + dimensions.ADHESIVE_THICKNESS_MM,
    )
    rim = design.plate_mm
    top = rim + design.ball_radius_mm + dimensions.SOCKET_TOP_THICKNESS_MM
    solid = _cylinder(0.0, 0.0, 2.0 * outer, (rim, top)) - occ.Sphere(occ.Pnt(0, 0, rim), hollow)
    solid -= _cylinder(
        0.0, 0.0, dimensions.MOULD_VENT_DIAMETER_MM, (rim, top + 1.0)
    )  # excess adhesive leaves here
    inside = outer - dimensions.TAIL_CHANNEL_DEPTH_MM
    for width, forward in zip(column_and_row_tail_widths_mm(design), (True, False), strict=True):
        half = width / 2.0 + dimensions.TAIL_CHANNEL_PLAY_PER_SIDE_MM
        corners = [(inside, -half), (outer + 1.0, half)]
        if not forward:
            corners = [(-half, inside), (half, outer + 1.0)]
        solid -= occ.Box(occ.Pnt(*corners[0], rim - 1.0), occ.Pnt(*corners[1], top + 1.0))
    for k in range(dimensions.SCREWS):
        angle = 2.0 * math.pi * (k + 0.5) / dimensions.SCREWS
        circle = 0.65 * outer
        place = (circle * math.cos(angle), circle * math.sin(angle), dimensions.CORE_MM)
        solid -= _cylinder(*place, (top - dimensions.CORE_DEPTH_MM, top + 1.0))
    solid -= _cylinder(
        0.85 * inside, 0.0, dimensions.MOULD_VENT_DIAMETER_MM, (top - 1.0, top + 1.0)
    )  # marks forward
    return Part(name="leg-socket", solid=solid)


def all_parts(design: FootDesign) -> list[Part]:
    """Return all solid parts of a foot."""
    return [*hemispheres(design), *mould(design), socket(design)]


def write_step(part: Part, path: Path) -> None:
    """Write a part as a STEP file without a time stamp: the same foot gives the same bytes."""
    part.solid.name = part.name
    part.solid.WriteStep(str(path))
    header = f"FILE_NAME('{part.name}','',('footsense'),(''),'Open CASCADE','footsense','');"
    text = re.sub(r"FILE_NAME\(.*?\);", header, path.read_text(), count=1, flags=re.DOTALL)
    path.write_text(re.sub(r"Open CASCADE STEP translator [\d. ]+", part.name, text))


def _cylinder(x_mm: float, y_mm: float, diameter_mm: float, z_mm: tuple[float, float]) -> Any:
    """Return a vertical cylinder as a solid."""
    low, high = z_mm
    return occ.Cylinder(occ.Pnt(x_mm, y_mm, low), occ.Z, r=diameter_mm / 2.0, h=high - low)
