"""`footsense lab shapes`: the solved shapes between which `lab design` interpolates."""

from pathlib import Path

import click

from footsense.cli.lab import options
from footsense.cli.options import FILE
from footsense.daemon.foot_types import released_path


@click.command()
@click.argument("output", type=FILE)
def shapes(*, output: Path) -> None:
    """Solve the shapes that `lab design` uses.

    OUTPUT replaces footsense/lab/design/shapes.npz, which a change of the solid's model makes out of date. It takes
    half an hour on one core.
    """
    from footsense.lab.design.solve_shapes import solve_shapes
    from footsense.lab.foot_file import FOOT_FILE, load_foot

    options.ensure_writable_folder(output.parent)
    solve_shapes(load_foot(released_path(FOOT_FILE)), output, options.elapsed_time_reporter())
