"""The robots of the studies of the service, by board, as their pages are bound to them."""

import msgspec

from footsense.config import Config
from footsense.lab.page_inputs import robot_name
from footsense.lab.report import StudyContext
from footsense.validation.fault_table import ROBOTS


def _encoded(robot: Config) -> bytes:
    whole = msgspec.structs.replace(robot, publish_every=robot.effective_publish_every)
    return msgspec.json.encode(whole).replace(b'"addresses":{},', b"")


#: The whole configuration of each, with what it does not set, but for addresses on a bus, which none of them has.
ENCODED = {board: _encoded(robot) for board, robot in ROBOTS.items()}


def robots_of(context: StudyContext) -> dict[str, Config]:
    """Return the robot of each board, as inputs of a page, with the scene that the trials of faults walk."""
    context.scene("measured_walk")
    for board, encoded in ENCODED.items():
        context.add_input(robot_name(board), encoded)
    return ROBOTS
