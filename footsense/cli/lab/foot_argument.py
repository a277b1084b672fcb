"""The argument FOOT of commands: a foot.yaml, a folder with one, or the name of a released foot type."""

from pathlib import Path

from footsense.daemon.foot_types import released_path
from footsense.errors import ModelError


def foot_description_path(foot: str) -> Path:
    """Return the path of a foot's `foot.yaml`, from a foot type or a path.

    Raises:
        ModelError: There is none.
    """
    from footsense.lab.foot_file import FOOT_FILE

    candidates = [Path(foot), Path(foot) / FOOT_FILE]
    if "/" not in foot:
        candidates.append(released_path(FOOT_FILE, foot))
    for path in candidates:
        if path.is_file():
            return path
    known = sorted(
        folder.parent.name for folder in released_path(FOOT_FILE).parents[1].glob(f"*/{FOOT_FILE}")
    )
    raise ModelError(
        f"no foot {foot}: neither a file, nor a folder with {FOOT_FILE}, nor a released foot type ({', '.join(known)})"
    )
