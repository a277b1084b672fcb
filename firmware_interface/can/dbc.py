"""Generate the DBC file (description of the CAN frames) for a robot of one to eight legs.

`footsense.dbc`, for a hexapod, is written by hand. Its left front leg is the model of all others: whatever is said of
node 1 is said again of each leg of the robot, with its id and its name. Nothing else differs but the unit of the forces
of feet beyond 32 N.
"""

import re
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from firmware_interface.can.codes import NODE_IDS
from firmware_interface.can.crc8 import kind_and_node

#: The description of a hexapod's frames.
HEXAPOD_DBC = Path(__file__).with_name("footsense.dbc")

_SIDES, _PLACES = {"l": "left", "r": "right"}, {"f": "front", "m": "middle", "r": "rear", "4": "fourth"}
_LEG_NAMES = {leg: f"{_SIDES[leg[0]]} {_PLACES[leg[1]]}" for leg in NODE_IDS}
_NUMBER_WORDS = ("one", "two", "three", "four", "five", "six", "seven", "eight")
_CAN_ID_PATTERN = re.compile(r'(?:BO_|CM_ SG_|CM_ BO_|VAL_|BA_ "\w+" BO_) (\d+) ')
_FORCE_SIGNAL_PATTERN = re.compile(r"( SG_ Force\w+ : \S+ )\((\S+),0\) \[(\S+)\|(\S+)\] \"N\"")


def make_dbc(legs: Sequence[str], force_step_mn: int = 1) -> str:
    """Return the DBC file's text for a robot.

    Args:
        legs: Names of its legs, of `NODE_IDS`.
        force_step_mn: What a bit of a force stands for [mN], as `footsense check-config` names it.

    Raises:
        KeyError: There is no such leg.
    """
    nodes = sorted(NODE_IDS[leg] for leg in legs)
    names = {node: leg for leg, node in NODE_IDS.items()}
    text: list[str] = []
    for can_id, lines in groupby(
        _lines_with_can_ids(HEXAPOD_DBC.read_text("utf-8").splitlines()), key=lambda one: one[0]
    ):
        block = [line for _, line in lines]
        if can_id is None:
            text += _general_lines(block, [names[node] for node in nodes])
        elif kind_and_node(can_id)[1] == 1:
            for node in nodes:
                text += _leg_frame_lines(block, can_id, node, names[node])
    return (
        "\n".join(line if force_step_mn == 1 else _with_force_step(line, force_step_mn) for line in text)
        + "\n"
    )


def _lines_with_can_ids(lines: Sequence[str]) -> list[tuple[int | None, str]]:
    """Return each text line with the CAN id of the frame it describes; None if it describes none."""
    can_id, before, found = None, "", []
    for line in lines:
        match = _CAN_ID_PATTERN.match(line)
        if match:
            can_id = int(match[1])
        elif not line.startswith(" SG_") and not (before.startswith(" SG_") and not line):
            can_id = None
        found.append((can_id, line))
        before = line
    return found


def _general_lines(lines: list[str], legs: Sequence[str]) -> list[str]:
    """Return the DBC's general text lines, adapted to the robot's legs."""
    nodes = ", ".join(f"{NODE_IDS[leg]} {leg}" for leg in legs)
    described = re.sub(r"1 lf, .*?\.", f"{nodes}.", "\n".join(lines))
    return described.replace("six-legged", f"{_NUMBER_WORDS[len(legs) - 1]}-legged").split("\n")


def _leg_frame_lines(lines: list[str], can_id: int, node: int, leg: str) -> list[str]:
    """Return the text lines of a left front leg's frame, adapted to another leg."""
    return [
        line.replace(f" {can_id} ", f" {can_id - 1 + node} ", 1)
        .replace("Lf:", f"{leg.capitalize()}:", 1)
        .replace("left front", _LEG_NAMES[leg])
        for line in lines
    ]


def _with_force_step(line: str, step: int) -> str:
    """Return a text line with the scale of its force signals multiplied by `step`."""

    def scale(match: re.Match[str]) -> str:
        factor, least, most = (format(step * float(number), ".6g") for number in match.groups()[1:])
        return f'{match[1]}({factor},0) [{least}|{most}] "N"'

    scaled = _FORCE_SIGNAL_PATTERN.sub(scale, line).replace("+-32.767 N", f"+-{step * 32.767:.6g} N")
    return scaled.replace("is 0.001 N times", f"is {step * 0.001:.6g} N times")
