"""The foot type of a configuration, and the files of the released ones."""

from pathlib import Path

from footsense.config import DEFAULT, Config
from footsense.errors import ModelError
from footsense.foot.type_folders import released_folder

#: Foot type where none is configured.
DEFAULT_FOOT_TYPE = DEFAULT.foot_type


def released_path(name: str, foot_type: str = DEFAULT_FOOT_TYPE) -> Path:
    """Return the path of a released file: in the installed package, or in a source checkout."""
    return released_folder(foot_type) / name


def foot_type_of(config: Config) -> str:
    """Return the name of the configured foot type, which is also its folder's name."""
    return Path(config.foot_type).name


def check_foot_type(path: Path, found: str, config: Config) -> None:
    """Raise an error unless a network or response table is of the configured foot type.

    Args:
        path: The file.
        found: Foot type in the file.
        config: The robot.

    Raises:
        ModelError: It is of another.
    """
    if found != foot_type_of(config):
        raise ModelError(f"{path}: made for foot type {found!r}, these feet are {foot_type_of(config)!r}")
