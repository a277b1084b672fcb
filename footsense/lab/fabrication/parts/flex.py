"""Artwork of the two flexes, seen from the copper side: electrodes, traces, guards, contacts, outline.

u is the direction in which the tail leaves, v across it. Rows leave to the left, with the copper up; columns leave
forward, with the copper down, which mirrors them. So in a square array both flexes have the same copper, and each line
leaves the sheet straight: no trace runs between electrodes of other lines, and no two nets cross.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import shapely

from footsense.lab.fabrication import dimensions
from footsense.lab.fabrication.parts.gerber import Pad, Point, Trace
from footsense.lab.geometry import FootDesign

LineKind = Literal["row", "column"]
#: Reference of the contacts in the Gerber files.
CONNECTOR = "J1"
#: Net of the guard traces between the lines, by flex: both are the shield driver of the converter board.
GUARD_NET = "shld"


@dataclass(frozen=True, kw_only=True)
class Flex:
    """One of the two flexible circuits, carrying the row or the column electrodes.

    Attributes:
        line_kind: Whether its lines are rows or columns.
        design: The foot.
    """

    line_kind: LineKind
    design: FootDesign

    @property
    def line_v_mm(self) -> tuple[float, ...]:
        """Coordinate v of each line [mm], the first line lowest."""
        return tuple(-x for x in self.design.line_mm)

    @property
    def element_u_mm(self) -> tuple[float, ...]:
        """Coordinate u of the elements along a line [mm], the nearest to the tail first."""
        return self.design.line_mm

    @property
    def name(self) -> str:
        """Name of the flex, also that of its files."""
        return f"{self.line_kind}-flex"

    @property
    def nets(self) -> list[str]:
        """Net name of each row or column: row1, row2, ... or col1, col2, ..."""
        return [f"{self.line_kind[:3]}{k + 1}" for k in range(len(self.line_v_mm))]

    @property
    def artwork_to_foot(self) -> Callable[[Point], Point]:
        """Function that converts artwork coordinates (u, v) to foot coordinates (x, y) [mm]."""
        if self.line_kind == "row":
            return lambda point: (-point[1], point[0])
        return lambda point: (point[0], -point[1])

    @property
    def contact_v_mm(self) -> list[float]:
        """Coordinates v of the contacts [mm], contact 1 first: guards at odd numbers, signals at even ones."""
        contacts = 2 * len(self.line_v_mm) + 1
        return [(k - (contacts - 1) / 2.0) * dimensions.TAIL_CONTACT_PAD_PITCH_MM for k in range(contacts)]

    @property
    def tail_half_width_mm(self) -> float:
        """Half the width of the tail [mm]."""
        return self.contact_v_mm[-1] + dimensions.TAIL_CONTACT_PAD_PITCH_MM

    @property
    def trace_fan_length_mm(self) -> float:
        """Length along u over which the traces converge [mm]: at 45 degrees, or steeper near the socket."""
        pairs = zip(self.line_v_mm, self.contact_v_mm[1::2], strict=True)
        room = (
            dimensions.socket_outer_radius_mm(self.design.ball_radius_mm)
            - dimensions.INNER_CORNER_RADIUS_MM
            - self.trace_fan_start_u_mm
        )
        return min(max(abs(v - w) for v, w in pairs), room)

    @property
    def tail_start_u_mm(self) -> float:
        """Coordinate u from which the tail is straight [mm]: the traces have reached the contact pitch."""
        return self.trace_fan_start_u_mm + self.trace_fan_length_mm + dimensions.INNER_CORNER_RADIUS_MM

    @property
    def trace_fan_start_u_mm(self) -> float:
        """Coordinate u from which the traces converge [mm], outside the sheet."""
        return self.polymer_half_side_mm + dimensions.MIN_COPPER_TO_EDGE_MM

    @property
    def tail_end_u_mm(self) -> float:
        """Coordinate u of the tail's end [mm]."""
        return self.design.ball_radius_mm + dimensions.TAIL_BEYOND_BALL_MM

    @property
    def alignment_holes(self) -> list[tuple[Point, float]]:
        """Centre and diameter [mm] of the alignment holes, on the sides of the foot that have no tail."""
        far = self.design.ball_radius_mm + dimensions.ALIGNMENT_HOLE_TO_BALL_MM
        return [
            ((-far, 0.0), dimensions.ALIGNMENT_HOLE_DIAMETER_MM),
            ((0.0, far), dimensions.ALIGNMENT_HOLE_DIAMETER_MM),
        ]

    @cached_property
    def copper(self) -> list[Pad | Trace]:
        """Pads and traces of the copper layer."""
        shapes: list[Pad | Trace] = []
        side, width = self.design.electrode_mm, dimensions.TRACE_WIDTH_MM
        contact_u = self.tail_end_u_mm - dimensions.TAIL_CONTACT_PAD_LENGTH_MM / 2.0
        for k, (net, v) in enumerate(zip(self.nets, self.line_v_mm, strict=True)):
            shapes += [
                Pad(centre_mm=(u, v), size_mm=(side, side), aperture_function="Other,Electrode", net=net)
                for u in self.element_u_mm
            ]
            w = self.contact_v_mm[2 * k + 1]
            way = [
                (self.element_u_mm[-1], v),
                (self.trace_fan_start_u_mm, v),
                (self.trace_fan_start_u_mm + self.trace_fan_length_mm, w),
                (contact_u, w),
            ]
            shapes.append(Trace(points_mm=way, width_mm=width, aperture_function="Conductor", net=net))
        for number, w in enumerate(self.contact_v_mm, 1):
            net = GUARD_NET if number % 2 else self.nets[number // 2 - 1]
            if number % 2:
                way = [(self.tail_start_u_mm, w), (contact_u, w)]
                shapes.append(Trace(points_mm=way, width_mm=width, aperture_function="Conductor", net=net))
            shapes.append(
                Pad(
                    centre_mm=(contact_u, w),
                    size_mm=(dimensions.TAIL_CONTACT_PAD_LENGTH_MM, dimensions.TAIL_CONTACT_PAD_WIDTH_MM),
                    aperture_function="ConnectorPad",
                    net=net,
                    pin=f"{CONNECTOR},{number}",
                )
            )
        return shapes

    @property
    def coverlay_openings(self) -> list[Pad | Trace]:
        """Openings of the coverlay: the whole sheet area (bare electrodes) and the contacts."""
        sheet, contacts = 2.0 * self.polymer_half_side_mm, 2.0 * self.tail_half_width_mm
        bare = dimensions.TAIL_CONTACT_PAD_LENGTH_MM
        return [
            Pad(centre_mm=(0.0, 0.0), size_mm=(sheet, sheet), aperture_function="Material"),
            Pad(
                centre_mm=(self.tail_end_u_mm - bare / 2.0, 0.0),
                size_mm=(bare, contacts),
                aperture_function="Material",
            ),
        ]

    @property
    def stiffener(self) -> list[Pad | Trace]:
        """The stiffener under the contacts, on the side without copper."""
        length = dimensions.STIFFENER_LENGTH_MM
        size = (length, 2.0 * self.tail_half_width_mm)
        return [
            Pad(
                centre_mm=(self.tail_end_u_mm - length / 2.0, 0.0), size_mm=size, aperture_function="Material"
            )
        ]

    @property
    def polymer_half_side_mm(self) -> float:
        """Half the side of the polymer inside the ball [mm]: at least the sheet's, and clear of the copper."""
        return self.design.sheet_mm / 2.0 + max(0.0, dimensions.MIN_COPPER_TO_EDGE_MM - self.design.rim_mm)

    @cached_property
    def outline(self) -> Any:
        """Outline of the polymer, a shapely polygon in (u, v) [mm]."""
        half, fan = self.polymer_half_side_mm, self.tail_half_width_mm
        neck = shapely.Polygon(
            [(half, -half), (self.tail_start_u_mm, -fan), (self.tail_start_u_mm, fan), (half, half)]
        )
        tail = shapely.box(half, -fan, self.tail_end_u_mm, fan)
        ears = [alignment_ear(half, centre) for centre, _ in self.alignment_holes]
        whole = shapely.union_all([shapely.box(-half, -half, half, half), neck, tail, *ears])
        radius = dimensions.INNER_CORNER_RADIUS_MM  # inner corners are rounded, so that they do not tear
        return whole.buffer(radius, join_style="mitre").buffer(-radius).buffer(0.0)

    @property
    def profile(self) -> list[Pad | Trace]:
        """Outline of the flex as a closed trace of the Gerber profile layer."""
        points = [(float(u), float(v)) for u, v in self.outline.exterior.coords]
        return [
            Trace(points_mm=points, width_mm=dimensions.PROFILE_LINE_WIDTH_MM, aperture_function="Profile")
        ]


def alignment_ear(half_side_mm: float, hole: Point) -> Any:
    """Return the ear that carries an alignment hole beside a square sheet, a polygon [mm]."""
    across = (0.0, half_side_mm) if hole[0] else (half_side_mm, 0.0)
    towards = tuple(half_side_mm * (value > 0) - half_side_mm * (value < 0) for value in hole)
    side = [(towards[0] + s * across[0], towards[1] + s * across[1]) for s in (-1.0, 1.0)]
    round_end = shapely.Point(hole).buffer(dimensions.ALIGNMENT_EAR_RADIUS_MM, quad_segs=16)
    return shapely.union_all([round_end, shapely.MultiPoint([*side, hole])]).convex_hull


def flexes(design: FootDesign) -> tuple[Flex, Flex]:
    """Return the row flex and the column flex of a foot."""
    return Flex(line_kind="row", design=design), Flex(line_kind="column", design=design)
