"""Artwork of the two flexes, seen from the copper side: electrodes, traces, guards, contacts, outline.

u is the direction in which the tail leaves, v across it. The lower flex leaves to the left, with the copper up; the
upper one forward, with the copper down, which mirrors it.

Board `ad7147`: below, nine electrodes that are joined to one; above, nine with a line each. The lines of the two rows
behind the first run in the bars beside their column, those of the outer columns in the inner bars, and between two
columns two guards. The electrodes below are joined where no line of another element runs. All guards are one
net, which a second layer of copper has too, behind the bars between the columns and behind the tail. Vias beside the
contacts join that layer to the guards.

Board `fdc1004`: rows below, columns above. In a square array both flexes have the same copper, and each line leaves the
sheet straight: no trace runs between electrodes of other lines, and no two nets cross.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple

import shapely

from footsense.lab.fabrication import dimensions
from footsense.lab.fabrication.parts.gerber import Pad, Point, Trace
from footsense.lab.geometry import FootDesign

Board = Literal["ad7147", "fdc1004"]
#: Reference of the contacts in the Gerber files.
CONNECTOR = "J1"
#: Net of the guard traces between rows or columns: the shield driver of board `fdc1004`.
GUARD_NET = "shld"
#: Net of the electrodes below where each element has a line of its own.
COMMON_NET = "gnd"
#: Net of all guards, and of the layer behind the lines, with board `ad7147`: the chip's shield driver.
AD7147_GUARD_NET = "acshield"

#: Rows of each column in the order of v, in which its lines reach the tail, and the contacts that are led through each
#: of the bars between columns, in the same order: lines of the second and third row, and the guards of both columns.
_ROWS_ACROSS = ((0, 1, 2), (1, 0, 2), (2, 1, 0))
_CONTACTS_IN_BARS = ((4, 6, 7, 8, 9), (13, 14, 15, 16, 18))
#: Pitch of the five traces in a bar, and middle of the first, over the width of the bar [1].
_BAR_PITCH_REL, _FIRST_IN_BAR_REL = 0.18, 0.14
# The converter board of `deploy/board` stands in front of the socket, its parts forward and the connectors of the
# flexes below: it says how long the common flex is. The tail of the element flex goes straight up to it; that of the
# common flex comes from the left, around the socket.
#: Contacts of the element and of the common flex; 4 are the fewest of common connectors.
N_ELEMENT_CONTACTS, N_COMMON_CONTACTS = 21, 4


class Wire(NamedTuple):
    """A trace within the sheet, and the contact that it leads to.

    Attributes:
        net: Its net.
        points_mm: Its points [mm]; the last one of a trace to a contact is where the traces begin to converge.
        contact: Number of the contact; 0 for none.
    """

    net: str
    points_mm: tuple[Point, ...]
    contact: int = 0


@dataclass(frozen=True, kw_only=True)
class Flex:
    """One of the two flexible circuits.

    Attributes:
        name: Name of the flex, also that of its files.
        towards: Where its tail leaves the foot.
        design: The foot.
        contacts: Net of each contact, contact 1, which has the lowest v, first.
        electrodes: Net and centre [mm] of each electrode.
        wires: Its traces within the sheet. A contact without one has a guard, from where the tail is straight.
        wire_mm: Width of these [mm].
        has_gentle_fan: Whether the traces converge over the whole way to the socket: steep ones come too close.
        shield_net: Net of a second layer of copper, behind the traces; empty for none.
    """

    name: str
    towards: Literal["left", "forward"]
    design: FootDesign
    contacts: tuple[str, ...]
    electrodes: tuple[tuple[str, Point], ...]
    wires: tuple[Wire, ...]
    wire_mm: float = dimensions.TRACE_WIDTH_MM
    has_gentle_fan: bool = False
    shield_net: str = ""

    @property
    def artwork_to_foot(self) -> Callable[[Point], Point]:
        """Function that converts artwork coordinates (u, v) to foot coordinates (x, y) [mm]."""
        if self.towards == "left":
            return lambda point: (-point[1], point[0])
        return lambda point: (point[0], -point[1])

    @property
    def n_layers(self) -> int:
        """Layers of copper."""
        return 2 if self.shield_net else 1

    @property
    def contact_v_mm(self) -> list[float]:
        """Coordinates v of the contacts [mm], contact 1 first."""
        return _contact_v_mm(len(self.contacts))

    @property
    def tail_half_width_mm(self) -> float:
        """Half the width of the tail [mm]."""
        return dimensions.tail_half_width_mm(len(self.contacts))

    @property
    def channel_half_width_mm(self) -> float:
        """Half the width of the tail's channel on the socket [mm]."""
        return dimensions.channel_half_width_mm(len(self.contacts))

    @property
    def channel_floor_mm(self) -> float:
        """Distance of the floor of its channel from the axis of the socket [mm]."""
        return dimensions.channel_floor_mm(self.design.ball_radius_mm, len(self.contacts))

    @property
    def trace_fan_length_mm(self) -> float:
        """Length along u over which the traces converge [mm]: at 45 degrees, or steeper near the socket."""
        room = self.channel_floor_mm - dimensions.INNER_CORNER_RADIUS_MM - _fan_start_u_mm(self.design)
        if self.has_gentle_fan:
            return room
        contact_v_mm = self.contact_v_mm
        across = (
            abs(wire.points_mm[-1][1] - contact_v_mm[wire.contact - 1]) for wire in self.wires if wire.contact
        )
        return min(max(across), room)

    @property
    def tail_start_u_mm(self) -> float:
        """Coordinate u from which the tail is straight [mm]: the traces have reached the contact pitch."""
        return _fan_start_u_mm(self.design) + self.trace_fan_length_mm + dimensions.INNER_CORNER_RADIUS_MM

    @property
    def tail_end_u_mm(self) -> float:
        """Coordinate u of the tail's end [mm]."""
        if self.name == "common-flex":
            return common_tail_end_mm(self.design.ball_radius_mm, self.design.plate_mm)
        return self.design.ball_radius_mm + dimensions.TAIL_BEYOND_BALL_MM

    @property
    def alignment_holes(self) -> list[Point]:
        """Centres [mm] of the alignment holes, on the sides of the foot that have no tail."""
        far = self.design.ball_radius_mm + dimensions.ALIGNMENT_HOLE_TO_BALL_MM
        return [(-far, 0.0), (0.0, far)]

    @cached_property
    def copper(self) -> list[Pad | Trace]:
        """Pads and traces of the copper layer."""
        side = self.design.electrode_mm
        contact_u = self.tail_end_u_mm - dimensions.TAIL_CONTACT_PAD_LENGTH_MM / 2.0
        fan_end_u = _fan_start_u_mm(self.design) + self.trace_fan_length_mm
        shapes: list[Pad | Trace] = [
            Pad(centre_mm=centre, size_mm=(side, side), aperture_function="Other,Electrode", net=net)
            for net, centre in self.electrodes
        ]
        led = {wire.contact for wire in self.wires}
        for net, points, contact in self.wires:
            way = points
            if contact:
                w = self.contact_v_mm[contact - 1]
                way = (*points, (fan_end_u, w), (contact_u, w))
            shapes.append(Trace(points_mm=way, width_mm=self.wire_mm, net=net))
        for number, (net, w) in enumerate(zip(self.contacts, self.contact_v_mm, strict=True), 1):
            if number not in led:
                way = ((self.tail_start_u_mm, w), (contact_u, w))
                shapes.append(Trace(points_mm=way, width_mm=self.wire_mm, net=net))
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
    def shield(self) -> list[Pad]:
        """Pads of the second layer: behind the bars between columns, and from the sheet to the contacts."""
        if not self.shield_net:
            return []
        design = self.design
        first_u, bare_u = -design.array_side_mm / 2.0, _polymer_half_side_mm(self.design)
        end_u = self.tail_end_u_mm - dimensions.TAIL_CONTACT_PAD_LENGTH_MM
        overlap_u = bare_u + dimensions.MIN_COPPER_TO_EDGE_MM
        middles_v = (-design.pitch_mm / 2.0, design.pitch_mm / 2.0)
        in_tail = 2.0 * (self.tail_half_width_mm - dimensions.MIN_COPPER_TO_EDGE_MM)
        spans = [
            *(((first_u, overlap_u), v, design.bar_mm) for v in middles_v),
            ((bare_u, overlap_u), 0.0, design.pitch_mm + design.bar_mm),  # joins bars beside a narrow tail
            ((bare_u, end_u), 0.0, in_tail),
        ]
        return [_rectangle(span_u, v, width, "Conductor", self.shield_net) for span_u, v, width in spans]

    @property
    def vias(self) -> list[Point]:
        """Centres of the vias that join the second layer to guards with a line on either side [mm]."""
        if not self.shield_net:
            return []
        u = self.tail_end_u_mm - dimensions.VIA_TO_END_MM
        return [
            (u, v)
            for k, v in enumerate(self.contact_v_mm[1:-1], 1)
            if self.contacts[k] == self.shield_net not in self.contacts[k - 1 : k + 2 : 2]
        ]

    @property
    def via_pads(self) -> list[Pad]:
        """Pads of the vias, alike on both layers."""
        size = (dimensions.VIA_PAD_MM, dimensions.VIA_PAD_MM)
        return [
            Pad(centre_mm=place, size_mm=size, aperture_function="ViaPad", net=self.shield_net, is_round=True)
            for place in self.vias
        ]

    @property
    def sheet_opening(self) -> list[Pad | Trace]:
        """Opening of a coverlay over the whole sheet area, whose coverlay is the foot's own layers."""
        half = _polymer_half_side_mm(self.design)
        return [_rectangle((-half, half), 0.0, 2.0 * half, "Material")]

    @property
    def coverlay_openings(self) -> list[Pad | Trace]:
        """Openings of the coverlay: the whole sheet area (bare electrodes) and the contacts."""
        return [*self.sheet_opening, self._at_tail_end(dimensions.TAIL_CONTACT_PAD_LENGTH_MM)]

    @property
    def stiffener(self) -> list[Pad | Trace]:
        """The stiffener under the contacts, on the side without contacts."""
        return [self._at_tail_end(dimensions.STIFFENER_LENGTH_MM)]

    def _at_tail_end(self, length_mm: float) -> Pad:
        """Return the last part of the tail in its whole width, no copper."""
        end_u = self.tail_end_u_mm
        return _rectangle((end_u - length_mm, end_u), 0.0, 2.0 * self.tail_half_width_mm, "Material")

    @cached_property
    def outline(self) -> Any:
        """Outline of the polymer, a shapely polygon in (u, v) [mm]."""
        half, fan = _polymer_half_side_mm(self.design), self.tail_half_width_mm
        neck = shapely.Polygon(
            [(half, -half), (self.tail_start_u_mm, -fan), (self.tail_start_u_mm, fan), (half, half)]
        )
        tail = shapely.box(half, -fan, self.tail_end_u_mm, fan)
        ears = [alignment_ear(half, centre) for centre in self.alignment_holes]
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


def board_corner_mm(ball_radius_mm: float) -> tuple[float, float, float]:
    """Return the lower corner of the board's back that is on the right of the foot, left as seen from the front [mm].

    Args:
        ball_radius_mm: Radius of the ball [mm].
    """
    x = dimensions.socket_outer_radius_mm(ball_radius_mm) + dimensions.MOUNT_TO_SOCKET_MM
    x += dimensions.MOUNT_WALL_MM + dimensions.MOUNT_SPACER_MM
    floor_mm = dimensions.channel_floor_mm(ball_radius_mm, N_ELEMENT_CONTACTS)
    way_mm = ball_radius_mm + dimensions.TAIL_BEYOND_BALL_MM - floor_mm - dimensions.TAIL_SLACK_MM
    end_z = math.sqrt(way_mm**2 - (_flexes_x_mm(x) - floor_mm) ** 2)
    return x, -dimensions.BOARD_ELEMENT_FLEX_MM, end_z - dimensions.BOARD_ELEMENT_FLEX_END_MM


def common_tail_end_mm(ball_radius_mm: float, plate_mm: float) -> float:
    """Return how far from the middle of the foot the tail of the common flex ends, laid flat [mm].

    It goes up beside socket and mount, and from there to the board.

    Args:
        ball_radius_mm: Radius of the ball [mm].
        plate_mm: Thickness of a plate [mm].
    """
    x, y, z = board_corner_mm(ball_radius_mm)
    floor_mm = dimensions.channel_floor_mm(ball_radius_mm, N_COMMON_CONTACTS)
    up_mm = dimensions.socket_top_z_mm(ball_radius_mm, plate_mm) + dimensions.MOUNT_WALL_MM
    to_board = (_flexes_x_mm(x), floor_mm - y - dimensions.BOARD_COMMON_FLEX_MM, z - up_mm)
    rest_mm = dimensions.BOARD_COMMON_FLEX_END_MM + dimensions.TAIL_SLACK_MM
    return math.ceil(floor_mm + up_mm + math.hypot(*to_board) + rest_mm)


def _flexes_x_mm(board_x_mm: float) -> float:
    return board_x_mm + dimensions.BOARD_THICKNESS_MM + dimensions.FLEX_ABOVE_BOARD_MM


def alignment_ear(half_side_mm: float, hole: Point) -> Any:
    """Return the ear that carries an alignment hole beside a square sheet, a polygon [mm]."""
    across = (0.0, half_side_mm) if hole[0] else (half_side_mm, 0.0)
    towards = tuple(half_side_mm * (value > 0) - half_side_mm * (value < 0) for value in hole)
    side = [(towards[0] + s * across[0], towards[1] + s * across[1]) for s in (-1.0, 1.0)]
    round_end = shapely.Point(hole).buffer(dimensions.ALIGNMENT_EAR_RADIUS_MM, quad_segs=16)
    return shapely.union_all([round_end, shapely.MultiPoint([*side, hole])]).convex_hull


def flexes(design: FootDesign, board: Board) -> tuple[Flex, Flex]:
    """Return the lower and the upper flex of a foot for a board."""
    if board == "ad7147":
        return _common_flex(design), _element_flex(design)
    return _line_flex(design, "row", "left"), _line_flex(design, "column", "forward")


def _line_flex(design: FootDesign, kind: str, towards: Literal["left", "forward"]) -> Flex:
    """Return the flex of the rows or of the columns: row1, row2, ... or col1, col2, ..., the first lowest."""
    nets = [f"{kind[:3]}{k}" for k in range(1, len(design.line_mm) + 1)]
    lines = list(zip(nets, (-x for x in design.line_mm), strict=True))
    contacts = [GUARD_NET]
    for net in nets:
        contacts += [net, GUARD_NET]
    return Flex(
        name=f"{kind}-flex",
        towards=towards,
        design=design,
        contacts=tuple(contacts),
        electrodes=tuple((net, (u, v)) for net, v in lines for u in design.line_mm),
        wires=tuple(
            Wire(net, ((design.line_mm[-1], v), (_fan_start_u_mm(design), v)), 1 + contacts.index(net))
            for net, v in lines
        ),
    )


def _common_flex(design: FootDesign) -> Flex:
    """Return the flex of the common electrode: columns joined along the foot, and to each other in the last row."""
    lines, (first, *_, last) = design.line_mm, design.line_mm
    wires = [Wire(COMMON_NET, ((u, -first), (u, -last))) for u in lines]
    wires.append(Wire(COMMON_NET, ((last, -last), (first, -last))))
    contacts = (COMMON_NET,) * N_COMMON_CONTACTS
    wires += [
        Wire(COMMON_NET, ((first, v), (_fan_start_u_mm(design), v)), contact)
        for contact, v in enumerate(_contact_v_mm(len(contacts)), 1)
    ]
    return Flex(
        name="common-flex",
        towards="left",
        design=design,
        contacts=contacts,
        electrodes=tuple((COMMON_NET, (u, -x)) for x in lines for u in lines),
        wires=tuple(wires),
    )


def element_net(row: int, column: int) -> str:
    """Return the net of an element: row1col1 is the most forward row and the leftmost column."""
    return f"row{row + 1}col{column + 1}"


def _element_flex(design: FootDesign) -> Flex:
    """Return the flex of the elements: of each column three lines between four guards."""
    lines, bar, fan_u = design.line_mm, design.bar_mm, _fan_start_u_mm(design)
    width = min(dimensions.TRACE_WIDTH_MM, dimensions.BAR_TRACE_REL * bar)
    to_corner = design.electrode_mm / 2.0 - width / 2.0
    places = {
        element_net(row, column): (x, -y) for row, x in enumerate(lines) for column, y in enumerate(lines)
    }
    contacts: list[str] = []
    for column, rows in enumerate(_ROWS_ACROSS):
        contacts.append(AD7147_GUARD_NET)
        for row in rows:
            contacts += [element_net(row, column), AD7147_GUARD_NET]
    wires = []
    for column, y in enumerate(lines):
        net = element_net(0, column)
        wires.append(Wire(net, (places[net], (fan_u, -y)), 1 + contacts.index(net)))
    for y, in_bar in zip(lines, _CONTACTS_IN_BARS, strict=False):
        for lane, contact in enumerate(in_bar):
            net = contacts[contact - 1]
            v = -y + design.electrode_mm / 2.0 + (_FIRST_IN_BAR_REL + lane * _BAR_PITCH_REL) * bar
            # A line leaves its electrode at the corner that is nearer to the tail, and a guard begins beside the last.
            u, of_electrode_v = places.get(net, (lines[-1], v))
            points = ((u + to_corner, of_electrode_v), (u + to_corner, v), (fan_u, v))
            wires.append(Wire(net, points if net in places else points[1:], contact))
    return Flex(
        name="element-flex",
        towards="forward",
        design=design,
        contacts=tuple(contacts),
        electrodes=tuple(places.items()),
        wires=tuple(wires),
        wire_mm=width,
        has_gentle_fan=True,
        shield_net=AD7147_GUARD_NET,
    )


def _rectangle(
    span_u_mm: tuple[float, float], v_mm: float, width_mm: float, aperture_function: str, net: str = ""
) -> Pad:
    """Return a rectangle by its span along u, the middle and the width across."""
    from_u, to_u = span_u_mm
    return Pad(
        centre_mm=((from_u + to_u) / 2.0, v_mm),
        size_mm=(to_u - from_u, width_mm),
        aperture_function=aperture_function,
        net=net,
    )


def _contact_v_mm(n_contacts: int) -> list[float]:
    return [(k - (n_contacts - 1) / 2.0) * dimensions.TAIL_CONTACT_PAD_PITCH_MM for k in range(n_contacts)]


def _polymer_half_side_mm(design: FootDesign) -> float:
    return design.sheet_mm / 2.0 + max(0.0, dimensions.MIN_COPPER_TO_EDGE_MM - design.rim_mm)


def _fan_start_u_mm(design: FootDesign) -> float:
    return _polymer_half_side_mm(design) + dimensions.MIN_COPPER_TO_EDGE_MM
