"""Folders of the foot types: those that come with footsense by name, others by path."""

from difflib import get_close_matches
from pathlib import Path

from footsense.errors import ModelError


def released_folder(foot_type: str) -> Path:
    """Return the folder of a released foot type: in the installed package, or in a source checkout."""
    package = Path(__file__).parents[1]
    installed = package / "models" / foot_type
    return installed if installed.exists() else package.parent / "models" / foot_type


def released_names() -> list[str]:
    """Return the names of the released foot types."""
    beside_the_default = released_folder("aoyagi-3x3").parent
    return sorted(path.parent.name for path in beside_the_default.glob("*/foot.yaml"))


def unknown_name_remedy(foot_type: str) -> str:
    """Return what to write in place of a name that is no released foot type's."""
    names = released_names()
    near = "".join(f"did you mean {name}? " for name in get_close_matches(foot_type.lower(), names, n=1))
    return f"{near}there are {', '.join(names)}; a folder of your own is written with a slash, such as ./{foot_type}"


def foot_type_folder(foot_type: str) -> Path:
    """Return the folder of a foot type: a released one by name, or any folder if the name has a slash.

    Raises:
        ModelError: There is no such foot type.
    """
    if "/" not in foot_type:
        folder, remedy = released_folder(foot_type), unknown_name_remedy(foot_type)
    else:
        folder, remedy = Path(foot_type), "it is not a folder; `footsense lab build --foot` makes one"
    if not folder.is_dir():
        raise ModelError(f"foot_type: no foot type {foot_type}: {remedy}")
    return folder
