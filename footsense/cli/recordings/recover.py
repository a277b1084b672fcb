"""Command `footsense recover FILE`: rewrite a truncated recording."""

from pathlib import Path

import click

from footsense.cli.options import FILE
from footsense.cli.recordings.file_bar import file_progress_bar
from footsense.recording.recover import recover as rewrite
from footsense.recording.recover import recovered_path


@click.command("recover")
@click.argument("file", type=FILE)
@click.option("-o", "--output", type=FILE, help="New file; FILE is left as it is.")
def recover(file: Path, output: Path | None) -> None:
    """Rewrite the intact part of the recording FILE, with an index."""
    target = output or recovered_path(file)
    with file_progress_bar("recover", file) as on_bytes_read:
        recovered = rewrite(file, target, on_bytes_read)
    click.echo(f"{target}: {recovered.n_recovered_cycles} cycles")
    if recovered.damage is not None:
        click.echo(f"footsense: {recovered.damage}", err=True)
