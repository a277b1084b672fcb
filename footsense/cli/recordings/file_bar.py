"""Progress of commands that read recordings."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

from footsense.progress import progress_bar


def file_progress_bar(title: str, *files: Path) -> AbstractContextManager[Callable[[float], None]]:
    """Return a bar whose work is the bytes of some recordings; a missing one is the reader's error."""
    return progress_bar(title, sum(file.stat().st_size for file in files if file.is_file()))
