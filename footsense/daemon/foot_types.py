"""Folders of the foot types, and the files of their network and response table."""

from pathlib import Path

import footsense
from footsense.config import DEFAULT, Config
from footsense.errors import ModelError

#: Foot type where none is configured.
DEFAULT_FOOT_TYPE = DEFAULT.foot_type


def released_path(name: str, foot_type: str = DEFAULT_FOOT_TYPE) -> Path:
    """Return the path of a released file: in the installed package, or in a source checkout."""
    package = Path(footsense.__file__).parent
    installed = package / "models" / foot_type / name
    return installed if installed.exists() else package.parent / "models" / foot_type / name


def foot_type_of(config: Config) -> str:
    """Return the name of the configured foot type, which is also its folder's name."""
    return Path(config.foot_type).name


def foot_type_folder(foot_type: str) -> Path:
    """Return the folder of a foot type: a released one by name, or any folder if the name has a slash.

    Raises:
        ModelError: There is no such foot type.
    """
    if "/" not in foot_type:
        folder = released_path("network.onnx", foot_type).parent
        remedy = f"a folder of your own is written with a slash, such as ./{foot_type}"
    else:
        folder, remedy = Path(foot_type), "`footsense lab build --foot` makes one"
    if not folder.is_dir():
        raise ModelError(f"foot_type: no foot type {foot_type}: {folder} is not a folder; {remedy}")
    return folder


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
