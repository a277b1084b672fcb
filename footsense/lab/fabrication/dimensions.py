"""Constants of all feet's parts: flex traces, contacts, alignment holes, moulds, sockets.

Flexes keep the rules of JLCPCB for flexes with one or two layers of copper of 12 um, without a surcharge; other makers
of flexes have the same or finer ones. All else is what common offers of 2024 to 2026 hold.

Source:
    JLCPCB, Flex PCB capabilities, jlcpcb.com/capabilities/flex-pcb-capabilities, as of 2026: traces and gaps of 3 mil,
    vias of 0.3 mm with pads of 0.55 mm, copper 0.3 mm from the edge and 0.15 mm from an opening of the coverlay.
"""

import math

# ------------------------------------------------------------------------------------------------ flexible circuits
#: Maker whose rules these are.
MAKER, MAKER_RULES = "JLCPCB", "https://jlcpcb.com/capabilities/flex-pcb-capabilities"
#: Least width of a trace and least distance of two nets [mm]: 3 mil.
MIN_TRACE_MM = 0.0762
MIN_NET_CLEARANCE_MM = 0.0762
#: Hole and pad of a via between two layers [mm]; the ring around the hole is half of their difference.
VIA_HOLE_MM, VIA_PAD_MM = 0.3, 0.55
#: Least distance from covered copper to an opening of the coverlay beside it [mm].
MIN_COPPER_TO_OPENING_MM = 0.15
#: Distance of two layers of copper [mm]: the polyimide between them.
LAYER_DISTANCE_MM = 0.05
#: Least distance from copper to the cut edge [mm]; electrodes may reach the edge of the sheet, where it is laser-cut.
MIN_COPPER_TO_EDGE_MM = 0.3
#: Width of the traces [mm]: thin, since they are stray capacitance, and well above what can be made.
TRACE_WIDTH_MM = 0.2
#: Width of each of the five traces in a bar between two columns, over the width of the bar [1], and the least such bar
#: [mm].
BAR_TRACE_REL = 0.08
MIN_TRACED_BAR_MM = MIN_TRACE_MM / BAR_TRACE_REL
#: Deviation of an electrode's side by etching [mm].
ETCH_DEVIATION_MM = 0.02
#: Radius of inner corners [mm], so that the polymer does not tear.
INNER_CORNER_RADIUS_MM = 0.5
#: Width of the line that draws the profile [mm]; its middle is the edge.
PROFILE_LINE_WIDTH_MM = 0.05

# ------------------------------------------------------------------------------------------------ contacts and tail
#: Pitch of a zero-insertion-force connector for flexes of 0.3 mm, contact width and bare length [mm].
TAIL_CONTACT_PAD_PITCH_MM = 0.5
TAIL_CONTACT_PAD_WIDTH_MM = 0.3
TAIL_CONTACT_PAD_LENGTH_MM = 4.0
#: Length of the stiffener under the contacts [mm], and distance of the vias from their end: on the stiffener, where the
#: tail does not bend, and under the coverlay.
STIFFENER_LENGTH_MM = 6.0
VIA_TO_END_MM = 5.0
#: Length of the tail beyond the ball [mm]: up the leg beside the socket to the converter board. That of the common flex
#: of board `ad7147` goes around the socket, and is longer.
TAIL_BEYOND_BALL_MM = 60.0

# ------------------------------------------------------------------------------------------------ alignment
#: Holes for dowel pins of 2 mm [mm], their play, and distance of their centre from the ball.
ALIGNMENT_HOLE_DIAMETER_MM = 2.05
ALIGNMENT_HOLE_TO_BALL_MM = 4.0
ALIGNMENT_EAR_RADIUS_MM = 3.0
#: Offset of row flex against column flex along each axis [mm]: play of the pins, and places of the holes.
FLEX_OFFSET_TOLERANCE_MM = 0.1

# ------------------------------------------------------------------------------------------------ spacer and film
#: Width of a channel that vents a cavity [mm].
CAVITY_VENT_WIDTH_MM = 0.3
#: Least rim of the spacer around cavities that have to be tight [mm].
MIN_SPACER_RIM_MM = 0.5

# ------------------------------------------------------------------------------------------------ mould and socket
#: Walls of the mould and of the socket [mm].
MOULD_WALL_MM = 5.0
SOCKET_WALL_MM = 3.0
#: Solid part of the socket above the ball, where the leg is screwed on [mm].
SOCKET_TOP_THICKNESS_MM = 6.0
#: Gap between ball and socket that the adhesive fills [mm].
ADHESIVE_THICKNESS_MM = 0.1
#: Dowels of the mould, sprue and vents of its lid, and their diameters [mm].
MOULD_DOWEL_DIAMETER_MM = 3.0
SPRUE_DIAMETER_MM = 4.0
MOULD_VENT_DIAMETER_MM = 1.5
#: Tapped holes for the leg, M2.5: core diameter, depth, and number on the circle.
CORE_MM, CORE_DEPTH_MM, SCREWS = 2.05, 5.0, 4
#: Play of a tail in its channel on the socket on either side, depth of the channel in its middle, and at its sides at
#: least [mm].
TAIL_CHANNEL_PLAY_PER_SIDE_MM = 0.25
TAIL_CHANNEL_DEPTH_MM = 0.8
MIN_TAIL_CHANNEL_SIDE_MM = 0.4

# ------------------------------------------------------------------------------------------------ converter board
#: Side and thickness of the board of `deploy/board` [mm]. Places on it are from its lower left corner, seen from the
#: side of its parts, with the connectors of the flexes below.
BOARD_SIDE_MM, BOARD_THICKNESS_MM = 25.0, 1.6
#: Centres of its holes, and their diameter, for M2 [mm].
BOARD_HOLES_MM = ((2.2, 22.8), (22.8, 22.8), (2.2, 9.2), (23.0, 2.2))
BOARD_HOLE_DIAMETER_MM = 2.2
#: Middle of the connectors of element and common flex along the lower edge, and how high the end of each is in its
#: connector [mm].
BOARD_ELEMENT_FLEX_MM, BOARD_ELEMENT_FLEX_END_MM = 9.4, 3.4
BOARD_COMMON_FLEX_MM, BOARD_COMMON_FLEX_END_MM = 19.8, 10.4
#: Thickness of the mount, height of its spacers, their diameter, and that of the cores of their M2 threads [mm].
MOUNT_WALL_MM, MOUNT_SPACER_MM, MOUNT_SPACER_DIAMETER_MM, MOUNT_CORE_MM = 3.0, 3.0, 4.4, 1.6
#: Distance of its wall from the socket, holes for the screws of the leg and for excess adhesive [mm].
MOUNT_TO_SOCKET_MM, MOUNT_SCREW_HOLE_MM, MOUNT_VENT_MM = 0.5, 2.7, 4.0
#: Flexes above the board in their connectors, and slack of each [mm].
FLEX_ABOVE_BOARD_MM, TAIL_SLACK_MM = 0.6, 3.0


def socket_outer_radius_mm(ball_radius_mm: float) -> float:
    """Return the outer radius of the socket for a ball of given radius [mm]."""
    return ball_radius_mm + ADHESIVE_THICKNESS_MM + SOCKET_WALL_MM


def socket_top_z_mm(ball_radius_mm: float, plate_mm: float) -> float:
    """Return the height of the socket's flat top, where the leg is screwed on [mm].

    Args:
        ball_radius_mm: Radius of the ball [mm].
        plate_mm: Thickness of the plate between sheet and hemisphere [mm].
    """
    return plate_mm + ball_radius_mm + SOCKET_TOP_THICKNESS_MM


def tail_half_width_mm(n_contacts: int) -> float:
    """Return half the width of a tail with a number of contacts [mm]."""
    return (n_contacts + 1) / 2.0 * TAIL_CONTACT_PAD_PITCH_MM


def least_ball_radius_mm(n_contacts: int) -> float:
    """Return the least radius of a ball whose socket has room for the widest tail of a foot [mm].

    A channel spans at most 60 degrees of the socket: so two do not meet, and leave the socket a wall.

    Args:
        n_contacts: Contacts of that tail.
    """
    outer_mm = 2.0 * channel_half_width_mm(n_contacts)
    return math.ceil(10.0 * (outer_mm - socket_outer_radius_mm(0.0))) / 10.0


def channel_half_width_mm(n_contacts: int) -> float:
    """Return half the width of the channel for a tail with a number of contacts on the socket [mm]."""
    return tail_half_width_mm(n_contacts) + TAIL_CHANNEL_PLAY_PER_SIDE_MM


def channel_floor_mm(ball_radius_mm: float, n_contacts: int) -> float:
    """Return the distance of the floor of a tail's channel from the axis of the socket [mm].

    Args:
        ball_radius_mm: Radius of the ball [mm].
        n_contacts: Contacts of the tail, whose channel is narrower than the socket.
    """
    outer_mm = socket_outer_radius_mm(ball_radius_mm)
    at_sides_mm = math.sqrt(outer_mm**2 - channel_half_width_mm(n_contacts) ** 2)
    return min(outer_mm - TAIL_CHANNEL_DEPTH_MM, at_sides_mm - MIN_TAIL_CHANNEL_SIDE_MM)
