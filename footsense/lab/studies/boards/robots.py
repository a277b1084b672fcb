"""The robots of the studies of the service, by board, as their pages are bound to them."""

import msgspec

from footsense.config import Config
from footsense.lab.page_inputs import robot_name
from footsense.lab.report import StudyContext
from footsense.validation.fault_table import ROBOTS

#: The whole configuration of each, with what it does not set.
ENCODED = {
    board: msgspec.json.encode(msgspec.structs.replace(robot, publish_every=robot.effective_publish_every))
    for board, robot in ROBOTS.items()
}


def robot_of(context: StudyContext, board: str) -> Config:
    """Return the robot of a board, as an input of a page."""
    context.add_input(robot_name(board), ENCODED[board])
    return ROBOTS[board]
