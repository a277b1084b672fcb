"""Command `footsense export FILE`: convert a recording to ROS 2, to a table, or to a plot."""

from collections.abc import Callable
from pathlib import Path

import click

from footsense.child_process import check_new_file
from footsense.cli.options import FILE
from footsense.cli.recordings.file_bar import file_progress_bar
from footsense.errors import RecordingError
from footsense.recording.replay import Replay
from footsense.ros2 import require

_RecordingWriter = Callable[[Replay, Path], int]


@click.command("export")
@click.argument("file", type=FILE)
@click.option("--ros2", type=FILE, metavar="FOLDER", help="Write a bag: `ros2 bag play FOLDER`.")
@click.option(
    "--tf", type=FILE, metavar="FRAMES.yaml", help="Frames of the feet, for the bag; without it lf_foot etc."
)
@click.option("--csv", type=FILE, help="Write a table: a row for each leg and cycle, units in the headers.")
@click.option("--parquet", type=FILE, help="Write the same table as Parquet (needs footsense[parquet]).")
@click.option(
    "--plot", type=FILE, help="Draw forces, states and events: a .png, .svg or .pdf (needs footsense[plot])."
)
def export(
    file: Path,
    *,
    ros2: Path | None,
    tf: Path | None,
    csv: Path | None,
    parquet: Path | None,
    plot: Path | None,
) -> None:
    """Convert the recording FILE; give one or more of the forms.

    What is not known is never a plausible number: a leg without a usable force has no wrench in a bag, an empty cell in
    a table, and a gap in a picture. A recording that is cut short is converted as far as it is whole (exit 74).
    """  # noqa: DOC501 - click shows this text
    if tf is not None and ros2 is None:
        raise click.UsageError("--tf is for a bag: give --ros2 FOLDER too")
    forms: list[tuple[Path, _RecordingWriter]] = []
    if ros2 is not None:
        require("rosbags", "--ros2")
        from footsense.ros2.bag import write_bag
        from footsense.ros2.messages import load_foot_frames

        frames = None if tf is None else load_foot_frames(tf)
        forms.append((ros2, lambda replay, folder: write_bag(replay, folder, frames)))
    if csv is not None:
        from footsense.export.csv_file import write_csv

        forms.append((csv, write_csv))
    if parquet is not None:
        from footsense.export.parquet_file import require_pyarrow, write_parquet

        require_pyarrow()
        forms.append((parquet, write_parquet))
    if plot is not None:
        from footsense.export.plot import require_plotting, write_plot

        require_plotting(plot)
        forms.append((plot, write_plot))
    if not forms:
        raise click.UsageError("say what to write: --ros2 FOLDER, --csv, --parquet or --plot FILE")
    Replay(file)
    for target, _ in forms:
        check_new_file(str(target), target)
    for target, write in forms:
        _convert(file, target, write)


def _convert(file: Path, target: Path, write: _RecordingWriter) -> None:
    """Write a recording in one output format, with a progress bar.

    Raises:
        RecordingError: It cannot be written, or the recording is cut short.
    """
    with file_progress_bar(target.name, file) as on_bytes_read:
        try:
            n_cycles = write(Replay(file, on_bytes_read), target)
        except RecordingError:
            raise
        except BaseException as error:
            if target.is_file():
                target.unlink()
            if isinstance(error, OSError):
                raise RecordingError(f"{target}: cannot be written: {error.strerror}") from None
            raise
    click.echo(f"{target}: {n_cycles} cycles")
