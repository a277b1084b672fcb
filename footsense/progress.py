"""Progress with the time left, for every command that may take more than two seconds; silent without a terminal."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def progress_bar(title: str, total: float) -> Iterator[Callable[[float], None]]:
    """Show a bar on the terminal of standard error while a task runs, and remove it at the end.

    Args:
        title: The task, in a word or two.
        total: All of the work, in any unit.

    Yields:
        A function that takes the work done so far, in the same unit.
    """
    if sys.stderr is None or not sys.stderr.isatty():
        yield lambda _: None
        return
    # A command without a terminal needs none of it.
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=total)
        yield lambda done: bar.update(task, completed=done)
