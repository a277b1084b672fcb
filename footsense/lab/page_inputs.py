"""What a page was computed from: digests of model files, tables and robots, and which of them are others today.

A study names what it uses as it opens it (`StudyContext`), and the page's JSON keeps the digests. Code is no part of
them: docs/adr/0014.
"""

import hashlib
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path

import footsense
from footsense.foot.type_folders import released_folder

_MODELS, _ROBOT = "models/", "robot "
_PACKAGE = Path(footsense.__file__).parent


def model_name(file: Path) -> str:
    """Return what a file of a foot type is called in a page's JSON."""
    return f"{_MODELS}{file.parent.name}/{file.name}"


def table_name(file: Path) -> str:
    """Return what a table that comes with footsense is called in a page's JSON: its path in the checkout."""
    return file.relative_to(_PACKAGE.parent).as_posix()


def robot_name(board: str) -> str:
    """Return what the robot of a board is called in a page's JSON."""
    return f"{_ROBOT}{board}"


def digest_of(content: bytes) -> str:
    """Return the digest of a file's content: the first half of its SHA-256."""
    return hashlib.sha256(content).hexdigest()[:32]


def digest_today(name: str) -> str:
    """Return the digest that an input of a page has now, empty if it is no more.

    Args:
        name: As of `model_name`, `table_name` or `robot_name`.
    """
    if name.startswith(_ROBOT):
        robots: Mapping[str, bytes] = import_module("footsense.lab.studies.boards.robots").ENCODED
        content = robots.get(name.removeprefix(_ROBOT))
        return "" if content is None else digest_of(content)
    if name.startswith(_MODELS):
        foot_type, file_name = name.removeprefix(_MODELS).split("/")
        file = released_folder(foot_type) / file_name
    else:
        file = _PACKAGE.parent / name
    return digest_of(file.read_bytes()) if file.is_file() else ""


def changed_inputs(digests: Mapping[str, str]) -> list[str]:
    """Return the names of a page's inputs that are others today, or no more.

    Args:
        digests: Digest of each input, by name, when the page was computed.
    """
    return [name for name, digest in digests.items() if digest_today(name) != digest]
