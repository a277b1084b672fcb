"""What a text file is that somebody gives to a command that reads others: its kind, and what reads it."""

import re
from pathlib import Path

from footsense.plain_yaml import YamlError, YamlReader, read_text

#: Kind of a robot's file.
ROBOT = "a robot's file"
#: A key that one kind of YAML file alone has: that kind, and the command that reads it.
_KIND_OF_KEY = {
    **dict.fromkeys(("buses", "serial"), (ROBOT, "footsense check-config {}")),
    "sensor": ("a test stand's file", "footsense test-stand record --reference {}"),
    "load": ("a scene", "footsense run --scene {}"),
    "ball_radius_mm": ("the design of a foot", "footsense lab build --foot {}"),
}
_CANDUMP_LINE = re.compile(r"\(\d+\.\d+\) \S+ [0-9A-Fa-f]+#")
_CANDUMP = (
    "a log of CAN frames as candump writes it",
    "can.LogReader and footsense.client.Link read it (docs/tutorial/first-walk.md), canplayer sends it again",
)


def kind_of_text(file: Path) -> tuple[str, str] | None:
    """Return what a text file is, and what reads it; None if it is none that footsense knows."""
    try:
        text = read_text(file)
        if _CANDUMP_LINE.match(text):
            return _CANDUMP
        keys = YamlReader(text).read()
    except YamlError:
        return None
    kinds = [kind for key, kind in _KIND_OF_KEY.items() if isinstance(keys, dict) and key in keys]
    return (kinds[0][0], kinds[0][1].format(file)) if kinds else None
