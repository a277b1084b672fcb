"""Options, output folders and progress lines common to the `footsense lab` commands."""

import tempfile
from collections.abc import Callable
from pathlib import Path

import click

from footsense.cli.options import FOLDER, Decorator
from footsense.clock import stopwatch_ns
from footsense.errors import FootsenseError

output_option = click.option(
    "--output",
    type=FOLDER,
    help="Folder for pages and figures; without it ./docs/report, quick ones ./docs/report-quick.",
)
quick_option = click.option(
    "--quick", is_flag=True, help="Every step in seconds; its figures are no results."
)


def board_option(text: str) -> Decorator:
    """Return the option `--board`, the electronics of a foot, with the given help."""
    return click.option("--board", type=click.Choice(["ad7147", "fdc1004"]), default="ad7147", help=text)


def ensure_report_folder(output: Path | None, *, quick: bool) -> Path:
    """Return the folder for report pages, `output` or the default, created if missing and checked to be writable.

    Raises:
        FootsenseError: It cannot be made, or not be written to.
    """
    folder = output or Path("docs") / ("report-quick" if quick else "report")
    ensure_writable_folder(folder)
    return folder


def ensure_writable_folder(folder: Path) -> None:
    """Create a folder and check that it is writable, before minutes of computing start.

    Raises:
        FootsenseError: It cannot be made, or not be written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryDirectory(dir=folder).cleanup()
    except OSError as error:
        raise FootsenseError(
            f"{folder}: cannot be written to: {error.strerror}; choose another folder"
        ) from error


def elapsed_time_reporter() -> Callable[[str], None]:
    """Return a function that prints a line with the seconds elapsed since this call."""
    started_ns = stopwatch_ns()

    def report(line: str) -> None:
        """Print a line with the elapsed seconds."""
        click.echo(f"[{(stopwatch_ns() - started_ns) / 1e9:6.1f} s] {line}")

    return report
