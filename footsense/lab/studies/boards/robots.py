"""The robots of the studies of the service, by board, as their pages are bound to them."""

import msgspec

from footsense.config import DEFAULT, Config
from footsense.lab.page_inputs import robot_name
from footsense.lab.report import StudyContext
from footsense.validation.fault_table import ROBOTS

_ROBOTS = {DEFAULT.board: DEFAULT} | ROBOTS


def _encoded(robot: Config) -> bytes:
    whole = msgspec.structs.replace(robot, publish_every=robot.effective_publish_every)
    return msgspec.json.encode(whole).replace(b'"addresses":{},', b"")


#: The whole configuration of each, with what it does not set, but for addresses on a bus where it has none.
ENCODED = {board: _encoded(robot) for board, robot in _ROBOTS.items()}


def robot_of(context: StudyContext, board: str) -> Config:
    """Return the robot of a board, as an input of a page."""
    context.add_input(robot_name(board), ENCODED[board])
    return _ROBOTS[board]
