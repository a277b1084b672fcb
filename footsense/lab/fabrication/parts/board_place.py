"""Where the converter board of `deploy/board` is beside a foot, which says how long the common flex is.

The board stands in front of the socket, its parts forward and the connectors of the flexes below. The tail of the
element flex goes straight up to it. That of the common flex comes from the left, around the socket.
"""

import math

from footsense.lab.fabrication import dimensions
from footsense.lab.fabrication.dimensions import TAIL_CHANNEL_PLAY_PER_SIDE_MM, tail_half_width_mm

#: Contacts of the element and of the common flex; 4 are the fewest of common connectors.
N_ELEMENT_CONTACTS, N_COMMON_CONTACTS = 21, 4


def board_corner_mm(ball_radius_mm: float) -> tuple[float, float, float]:
    """Return the lower corner of the board's back that is on the right of the foot, left as seen from the front [mm].

    Args:
        ball_radius_mm: Radius of the ball [mm].
    """
    x = dimensions.socket_outer_radius_mm(ball_radius_mm) + dimensions.MOUNT_TO_SOCKET_MM
    x += dimensions.MOUNT_WALL_MM + dimensions.MOUNT_SPACER_MM
    floor_mm = _channel_floor_mm(ball_radius_mm, N_ELEMENT_CONTACTS)
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
    floor_mm = _channel_floor_mm(ball_radius_mm, N_COMMON_CONTACTS)
    up_mm = dimensions.socket_top_z_mm(ball_radius_mm, plate_mm) + dimensions.MOUNT_WALL_MM
    to_board = (_flexes_x_mm(x), floor_mm - y - dimensions.BOARD_COMMON_FLEX_MM, z - up_mm)
    rest_mm = dimensions.BOARD_COMMON_FLEX_END_MM + dimensions.TAIL_SLACK_MM
    return math.ceil(floor_mm + up_mm + math.hypot(*to_board) + rest_mm)


def _flexes_x_mm(board_x_mm: float) -> float:
    return board_x_mm + dimensions.BOARD_THICKNESS_MM + dimensions.FLEX_ABOVE_BOARD_MM


def _channel_floor_mm(ball_radius_mm: float, n_contacts: int) -> float:
    half_mm = tail_half_width_mm(n_contacts) + TAIL_CHANNEL_PLAY_PER_SIDE_MM
    return dimensions.channel_floor_mm(ball_radius_mm, half_mm)
