"""Technical drawing on A3 sheets: assembly in the socket, machined parts, flexes and layers, with tolerances."""

from pathlib import Path
from typing import Any

import numpy as np
import shapely
from matplotlib.backends.backend_pdf import PdfPages

from footsense.lab.fabrication import dimensions
from footsense.lab.fabrication.array import ElementArray
from footsense.lab.fabrication.documents.paper_sheet import PaperSheet, View, largest_scale
from footsense.lab.fabrication.documents.papers import film_material_text
from footsense.lab.fabrication.documents.views import edge_polylines, section_y0
from footsense.lab.fabrication.parts import sheets, solids
from footsense.lab.fabrication.parts.flex import GUARD_NET, Flex
from footsense.lab.fabrication.parts.readback import read_holes, read_layer, read_outline
from footsense.lab.fabrication.tolerances import Tolerance
from footsense.lab.fem.solids import EQUAL_WITHIN_MM
from footsense.lab.geometry import FootDesign

_COPPER, _POLYMER, _PDMS, _RUBBER, _METAL = "#d98c3f", "#f3e3b3", "#cfe3ee", "#9aa5ad", "#d5d5d5"


def write_drawing(folder: Path, name: str, pages: list[PaperSheet]) -> None:
    """Write `drawing.pdf` without a creation date, so that the same foot gives the same bytes.

    Args:
        folder: Where it is written.
        name: Name of the foot.
        pages: Its sheets.
    """
    metadata = {"Title": f"{name}, drawing", "Creator": "footsense", "CreationDate": None}
    with PdfPages(folder / "drawing.pdf", metadata=metadata) as file:
        for one in pages:
            file.savefig(one.figure)


def drawing_sheets(
    files_folder: Path, design: FootDesign, flexes: tuple[Flex, Flex], tolerances: list[Tolerance]
) -> list[PaperSheet]:
    """Return the A3 sheets of the drawing, drawn from a foot's fabrication files.

    Args:
        files_folder: Folder of the fabrication files to read.
        design: The foot.
        flexes: Row flex and column flex.
        tolerances: Tolerances of the drawing.
    """
    about = [
        design.about,
        "All dimensions in mm unless stated. Where no limit is given: ISO 2768-m.",
        "Foot frame: x forward, y left, z up the leg.",
    ]
    parts = {path.stem: solids.read_step(path) for path in sorted((files_folder / "step").glob("*.step"))}
    name = design.foot_type
    return [
        _draw_assembly(PaperSheet(f"{name}: assembly", [*about, "Sheet 1 of 3"]), design, parts, tolerances),
        _draw_machined_parts(
            PaperSheet(f"{name}: mould and socket", [*about, "Sheet 2 of 3"]), design, parts
        ),
        _draw_flexes_and_sheets(
            PaperSheet(f"{name}: flexes and layers", [*about, "Sheet 3 of 3"]), files_folder, design, flexes
        ),
    ]


def _draw_assembly(
    page: PaperSheet, design: FootDesign, parts: dict[str, Any], tolerances: list[Tolerance]
) -> PaperSheet:
    """Return the sheet with the foot in its socket, in section, and the stack of layers."""
    radius, plate, half = design.ball_radius_mm, design.plate_mm, design.sheet_mm / 2.0
    outer, top = (
        dimensions.socket_outer_radius_mm(design.ball_radius_mm),
        plate + radius + dimensions.SOCKET_TOP_THICKNESS_MM,
    )
    scale = largest_scale((2.0 * outer, top + radius + plate), (150.0, 165.0))
    view = page.add_view(
        (110.0, 160.0), scale, (-outer, -radius - plate, outer, top), "Section, forward to the right, *"
    )
    for name, colour, hatch in (
        ("hemisphere-ground", _RUBBER, None),
        ("hemisphere-leg", _RUBBER, None),
        ("leg-socket", _METAL, "////"),
    ):
        view.draw_area(section_y0(parts[name]), colour, hatch)
    for level in (-plate, 0.0):
        view.draw_area(shapely.box(-half, level, half, level + plate), _PDMS)
    rise = outer - dimensions.TAIL_CHANNEL_DEPTH_MM / 2.0
    view.draw_line([(-half, 0.0), (rise, 0.0), (rise, top)], color=_COPPER, lw=1.6)
    view.draw_centre_line([(0.0, -radius - plate - 2.0), (0.0, top + 0.8)])
    view.draw_dimension([(-outer, top), (outer, top)], 8.0, f"dia. {2.0 * outer:.1f}")
    view.draw_dimension([(-outer, plate), (-outer, top)], -8.0, f"{top - plate:g}")
    view.draw_note((-0.6 * radius, -plate - 0.6 * radius), (-14.0, -22.0), f"R {radius:g} +-0.1")
    hollow = radius + dimensions.ADHESIVE_THICKNESS_MM
    place = (-0.71 * hollow, plate + 0.71 * hollow)
    view.draw_note(
        place,
        (-2.0, scale * (top - place[1]) + 18.0),
        f"R {hollow:.1f} +-0.05, adhesive {dimensions.ADHESIVE_THICKNESS_MM:g}",
        "right",
    )
    view.draw_note((rise, 0.55 * top), (12.0, 0.0), "tail of the columns,\nin its channel")
    view.draw_note(
        (0.9 * half, -0.6 * plate),
        (scale * (outer - 0.9 * half) + 8.0, -16.0),
        "plates and flexes:\nsee stack",
    )
    _draw_layer_stack(page, design)
    rows = [["dimension", "nominal and limit", "the design assumed"]]
    rows += [[t.name, f"{t.nominal:g} +-{t.max_deviation:g} {t.unit}", t.assumed_text] for t in tolerances]
    page.write_table((215.0, 140.0), (58.0, 42.0, 90.0), rows)
    return page


def _draw_layer_stack(page: PaperSheet, design: FootDesign) -> None:
    """Draw the stack of layers, with thicknesses exaggerated."""
    layers = [
        ("hemisphere of the leg", f"rubber of {design.rubber.youngs_mpa:g} MPa", _RUBBER, 10.0),
        ("plate", f"elastomer of {design.pdms.youngs_mpa:g} MPa, {design.plate_mm:g} +-0.05 mm", _PDMS, 8.0),
        ("column flex, copper down", "polyimide and copper, or gold on the plate", _COPPER, 4.0),
        (
            "spacer",
            f"gap {design.gap_um:g} um; cavities {design.electrode_mm:g} x {design.electrode_mm:g} mm",
            "w",
            7.0,
        ),
        ("film", f"{design.film_um:g} um of {film_material_text(design)}", "#bfe0c4", 6.0),
        ("row flex, copper up", "polyimide and copper, or gold on the plate", _COPPER, 4.0),
        ("plate", f"elastomer of {design.pdms.youngs_mpa:g} MPa, {design.plate_mm:g} +-0.05 mm", _PDMS, 8.0),
        ("hemisphere of the ground", f"rubber of {design.rubber.youngs_mpa:g} MPa", _RUBBER, 10.0),
    ]
    height = sum(thickness for *_, thickness in layers)
    view = page.add_view((258.0, 225.0), 1.0, (0.0, 0.0, 80.0, height), "Stack, not to scale", 6.0)
    z = height
    for name, what, colour, thickness in layers:
        z -= thickness
        view.draw_area(shapely.box(0.0, z, 80.0, z + thickness), colour)
        if name == "spacer":
            for x in (0.0, 22.0, 48.0, 70.0):
                view.draw_area(shapely.box(x, z, x + 10.0, z + thickness), "#bfe0c4")
        page.write_text((304.0, 225.0 - height / 2.0 + z + thickness / 2.0), f"{name}: {what}", va="center")


def _draw_machined_parts(page: PaperSheet, design: FootDesign, parts: dict[str, Any]) -> PaperSheet:
    """Return the sheet with socket and mould, in section and from above."""
    radius, wall = design.ball_radius_mm, dimensions.MOULD_WALL_MM
    half_x, half_y, deep = 2.0 * radius + 1.5 * wall, radius + wall, radius + wall
    off = solids.mould_hollow_centres_x_mm(design)[1]
    scale = largest_scale((2.0 * half_x, 2.0 * half_y), (150.0, 75.0))
    lid = page.add_view(
        (105.0, 240.0), scale, (-half_x, -half_y, half_x, half_y), "Lid of the mould from above, *"
    )
    _draw_from_above(lid, parts["mould-lid"])
    lid.draw_dimension([(-half_x, half_y), (half_x, half_y)], 6.0, f"{2.0 * half_x:g}")
    lid.draw_dimension([(half_x, -half_y), (half_x, half_y)], 10.0, f"{2.0 * half_y:g}")
    lid.draw_dimension([(-off, 0.0), (off, 0.0)], -scale * half_y - 6.0, f"{2.0 * off:g} +-0.05")
    lid.draw_note((-off, 0.0), (-34.0, 8.0), f"2 x dia. {dimensions.SPRUE_DIAMETER_MM:g}")
    lid.draw_note(
        (-off, radius - dimensions.MOULD_VENT_DIAMETER_MM),
        (-34.0, 6.0),
        f"4 x dia. {dimensions.MOULD_VENT_DIAMETER_MM:g}",
    )
    inset = dimensions.MOULD_DOWEL_DIAMETER_MM
    lid.draw_note(
        (half_x - inset, half_y - inset),
        (18.0, 12.0),
        f"2 x dia. {dimensions.MOULD_DOWEL_DIAMETER_MM:g} H7, {wall:g} thick",
    )
    body = page.add_view((105.0, 130.0), scale, (-half_x, -deep, half_x, 0.0), "Section of the body, *", 8.0)
    body.draw_area(section_y0(parts["mould-body"]), _METAL, "////")
    body.draw_dimension([(half_x, -deep), (half_x, 0.0)], 10.0, f"{deep:g}")
    body.draw_note((off - 0.7 * radius, -0.7 * radius), (-10.0, 34.0), f"2 x R {radius:g} +-0.05, polished")
    outer, top, rim = (
        dimensions.socket_outer_radius_mm(design.ball_radius_mm),
        design.plate_mm + radius + dimensions.SOCKET_TOP_THICKNESS_MM,
        design.plate_mm,
    )
    scale = largest_scale((2.0 * outer, 2.0 * outer), (120.0, 110.0))
    socket = page.add_view(
        (305.0, 205.0), scale, (-outer, -outer, outer, outer), "Socket from above, forward to the right, *"
    )
    _draw_from_above(socket, parts["leg-socket"])
    socket.draw_centre_line([(-outer - 2.0, 0.0), (outer + 2.0, 0.0)])
    socket.draw_centre_line([(0.0, -outer - 0.8), (0.0, outer + 2.0)])
    socket.draw_dimension([(-outer, -outer), (outer, -outer)], -6.0, f"dia. {2.0 * outer:.1f}")
    place = 0.65 * outer * np.sqrt(0.5)
    socket.draw_note(
        (-place, place), (-30.0, 24.0),
        f"{dimensions.SCREWS} x M2.5, {dimensions.CORE_DEPTH_MM:g} deep,\non dia. {1.3 * outer:.1f}",
    )  # fmt: skip
    for k, at in enumerate(
        ((outer - dimensions.TAIL_CHANNEL_DEPTH_MM, 0.0), (0.0, outer - dimensions.TAIL_CHANNEL_DEPTH_MM))
    ):
        width = (
            2.0 * dimensions.TAIL_CHANNEL_PLAY_PER_SIDE_MM + solids.column_and_row_tail_widths_mm(design)[k]
        )
        socket.draw_note(
            at,
            ((24.0, -22.0), (26.0, 16.0))[k],
            f"channel {width:g} +0.1/0\nx {dimensions.TAIL_CHANNEL_DEPTH_MM:g}",
        )
    socket.draw_note((0.0, 0.0), (-42.0, -38.0), f"bore dia. {dimensions.MOULD_VENT_DIAMETER_MM:g}")
    socket.draw_note((0.85 * (outer - dimensions.TAIL_CHANNEL_DEPTH_MM), 0.0), (20.0, 24.0), "mark: forward")
    hollow = f"Hollow: R {radius + dimensions.ADHESIVE_THICKNESS_MM:.1f} +-0.05 around the middle of the lower face; "
    hollow += f"height {top - rim:g}."
    page.write_text((305.0, 112.0), hollow, ha="center")
    return page


def _draw_from_above(view: View, solid: Any) -> None:
    """Draw the top view of a solid: edges of its upper face solid, lower ones dashed."""
    _, high = solid.bounding_box
    for points in edge_polylines(solid):
        if np.ptp(points[:, 2]) < EQUAL_WITHIN_MM:
            seen = points[0, 2] > high.z - EQUAL_WITHIN_MM
            style = {"lw": 1.0} if seen else {"lw": 0.5, "ls": (0, (6, 4)), "zorder": 1}
            view.draw_line([(x, y) for x, y, _ in points], **style)


def _draw_flexes_and_sheets(
    page: PaperSheet, folder: Path, design: FootDesign, flexes: tuple[Flex, Flex]
) -> PaperSheet:
    """Return the sheet with both flexes, spacer and film."""
    for flex, height in zip(flexes, (228.0, 112.0), strict=True):
        outline = read_outline(folder / flex.name / "profile.gbr")
        low_x, low_y, high_x, high_y = outline.bounds
        scale = largest_scale((high_x - low_x, high_y - low_y), (195.0, 76.0))
        side = "up, tail to the left" if flex.line_kind == "row" else "down, tail forward"
        title = f"{flex.line_kind.capitalize()} flex from its copper side, *; in the foot: copper {side} of the foot"
        view = page.add_view((118.0, height), scale, outline.bounds, title, 26.0)
        _draw_flex(view, folder, flex, outline)
    array = ElementArray.from_design(design)
    ball = design.ball_radius_mm
    drawn = ("spacer", design.gap_um, 235.0), ("film", design.film_um, 120.0)
    for name, thickness, height in drawn:
        shape = sheets.read_dxf(folder / f"{name}.dxf")
        low_x, low_y, high_x, high_y = shape.bounds
        scale = largest_scale((high_x - low_x, high_y - low_y), (110.0, 75.0))
        view = page.add_view(
            (310.0, height), scale, shape.bounds, f"{name.capitalize()}, {thickness:g} um, from above, *"
        )
        view.draw_area(shape, "#bfe0c4")
        _draw_sheet_dimensions(view, array, ball, name)
    return page


def _draw_flex(view: View, folder: Path, flex: Flex, outline: Any) -> None:
    """Draw one flex with its copper, outline and dimensions."""
    view.draw_area(outline, _POLYMER)
    for shape in read_layer(folder / flex.name / "copper.gbr"):
        view.draw_area(shape.polygon, _COPPER, edge=False)
    for x, y, diameter in read_holes(folder / flex.name / "drill.drl"):
        view.draw_area(shapely.Point(x, y).buffer(diameter / 2.0), "w")
    half, tail, side = flex.polymer_half_side_mm, flex.tail_half_width_mm, flex.array.electrode_mm
    *_, end, _ = outline.bounds
    u, v = flex.element_u_mm, flex.line_v_mm
    ends = (u[0] - side / 2.0, v[0] - side / 2.0), (u[0] + side / 2.0, v[0] - side / 2.0)
    view.draw_dimension(ends, -7.0, f"{side:g} +-{dimensions.ETCH_DEVIATION_MM:g}")
    view.draw_dimension([(-half, -half), (half, -half)], -13.0, f"{2.0 * half:g}")
    view.draw_dimension([(0.0, -half), (end, -half)], -19.0, f"{end:g}")
    view.draw_dimension([(end, -tail), (end, tail)], 7.0, f"{2.0 * tail:g} +-0.05")
    if len(v) > 1:
        left = outline.bounds[0]
        view.draw_dimension([(left, v[0]), (left, v[1])], -6.0, f"{v[1] - v[0]:g}")
    size = f"{dimensions.TAIL_CONTACT_PAD_WIDTH_MM:g} x {dimensions.TAIL_CONTACT_PAD_LENGTH_MM:g}"
    size += f", pitch {dimensions.TAIL_CONTACT_PAD_PITCH_MM:g}"
    contacts = f"{len(flex.contact_v_mm)} contacts {size}; contact 1 is the lowest;\n"
    contacts += f"even: {', '.join(flex.nets)}; odd: {GUARD_NET}"
    view.draw_note(
        (flex.tail_end_u_mm - dimensions.TAIL_CONTACT_PAD_LENGTH_MM / 2.0, tail),
        (-8.0, 16.0),
        contacts,
        "center",
    )
    stiff = f"stiffener {dimensions.STIFFENER_LENGTH_MM:g}, other side; 0.3 thick with it"
    view.draw_note(
        (flex.tail_end_u_mm - dimensions.STIFFENER_LENGTH_MM, -tail), (-18.0, -10.0), stiff, "center"
    )


def _draw_sheet_dimensions(view: View, array: ElementArray, ball_radius_mm: float, name: str) -> None:
    """Draw the dimensions of spacer or film into a view that already shows its area."""
    half = array.sheet_mm / 2.0
    far = ball_radius_mm + dimensions.ALIGNMENT_HOLE_TO_BALL_MM
    view.draw_dimension([(-half, half), (half, half)], 6.0, f"{array.sheet_mm:g} +-0.05")
    view.draw_dimension(
        [(-far, 0.0), (0.0, 0.0)],
        -view.scale * (far + dimensions.ALIGNMENT_EAR_RADIUS_MM) - 6.0,
        f"{far:g} +-0.05",
    )
    view.draw_note((0.0, -far), (22.0, 0.0), f"2 x dia. {dimensions.ALIGNMENT_HOLE_DIAMETER_MM:g} +0.05/0")
    if name == "spacer":
        x, y = array.row_x_mm[0], array.column_y_mm[0]
        side = array.electrode_mm
        view.draw_dimension([(half, y - side / 2.0), (half, y + side / 2.0)], 8.0, f"{side:g} +-0.05")
        bar = array.column_y_mm[0] - side / 2.0
        view.draw_note(
            (x, bar - array.spacer_bar_width_mm / 2.0), (34.0, -8.0), f"bars {array.spacer_bar_width_mm:g}"
        )
