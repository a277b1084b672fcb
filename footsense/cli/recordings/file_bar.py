"""Progress bar of commands that read recordings."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

from footsense.progress import progress_bar


def file_progress_bar(title: str, *files: Path) -> AbstractContextManager[Callable[[float], None]]:
    """Return a progress bar over the bytes of some recordings; missing files count nothing."""
    return progress_bar(title, sum(file.stat().st_size for file in files if file.is_file()))
