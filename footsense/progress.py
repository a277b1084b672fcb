"""Progress bars with the time left, for commands longer than two seconds; silent without a terminal.

Rich is imported where a bar is drawn: it would cost a service a tenth of a second at its start.
"""

import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path


def stderr_is_terminal() -> bool:
    """Return whether standard error is a terminal, where progress bars are drawn."""
    return sys.stderr is not None and sys.stderr.isatty()


@contextmanager
def progress_bar(title: str, total: float) -> Iterator[Callable[[float], None]]:
    """Show a progress bar on standard error during a `with` block; yield a function that sets the amount done.

    Args:
        title: The task, in a word or two.
        total: All of the work, in any unit.

    Yields:
        A function that takes the work done so far, in the same unit.
    """
    if not stderr_is_terminal():
        yield lambda _: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=total)
        yield lambda done: bar.update(task, completed=done)


def file_progress_bar(title: str, *files: Path) -> AbstractContextManager[Callable[[float], None]]:
    """Return a progress bar over the bytes of some files; missing ones count nothing."""
    return progress_bar(title, sum(file.stat().st_size for file in files if file.is_file()))


@contextmanager
def timed_bar(title: str, expected_s: float) -> Iterator[None]:
    """Show the elapsed time beside the usual one, for a task of known usual duration.

    Args:
        title: The task, in a word or two.
        expected_s: Its usual duration [s]; 0 if nothing is known: then nothing is shown.

    Yields:
        Nothing.
    """
    if not (stderr_is_terminal() and expected_s):
        yield
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    usual = f"of usually {expected_s // 60:.0f}:{expected_s % 60:02.0f}"
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TextColumn(usual))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        bar.add_task(title, total=None)
        yield
