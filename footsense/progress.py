"""Progress bars with the time left, for commands longer than two seconds; silent without a terminal."""

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from rich.console import Console, RenderableType
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

#: A task that takes longer than expected stays at this part of its bar.
_MAX_TIMED_BAR_REL = 0.99


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
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=total)
        yield lambda done: bar.update(task, completed=done)


def file_progress_bar(title: str, *files: Path) -> AbstractContextManager[Callable[[float], None]]:
    """Return a progress bar over the bytes of some files; missing ones count nothing."""
    return progress_bar(title, sum(file.stat().st_size for file in files if file.is_file()))


@contextmanager
def timed_bar(title: str, expected_s: float) -> Iterator[None]:
    """Show a progress bar that follows the elapsed time, for a task of known usual duration.

    Args:
        title: The task, in a word or two.
        expected_s: Its usual duration [s]; 0 if nothing is known: then no bar is shown.

    Yields:
        Nothing.
    """
    if not (stderr_is_terminal() and expected_s):
        yield
        return
    columns = (TextColumn("{task.description}"), BarColumn(), _TimeLeftColumn())
    with _TimedProgress(*columns, console=Console(stderr=True), transient=True) as bar:
        bar.add_task(title, total=expected_s)
        yield


class _TimedProgress(Progress):
    """Progress bars that advance with the elapsed time."""

    def get_renderables(self) -> Iterable[RenderableType]:
        for task in self.tasks:
            task.completed = min(task.elapsed or 0.0, _MAX_TIMED_BAR_REL * (task.total or 0.0))
        yield from super().get_renderables()


class _TimeLeftColumn(ProgressColumn):
    """Column of a progress bar with the estimated time left."""

    def render(self, task: Task) -> Text:
        left_s = (task.total or 0.0) - (task.elapsed or 0.0)
        words = "longer than usual" if left_s < 0 else f"about {left_s // 60:.0f}:{left_s % 60:02.0f} left"
        return Text(words, "progress.remaining")
