"""`footsense lab design`: `foot.yaml` files of feet for a robot, from its weight."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from footsense.cli.lab import options
from footsense.cli.options import FILE, FOLDER, json_option
from footsense.cli.tables import echo_json
from footsense.errors import FootsenseError

if TYPE_CHECKING:
    from rich.table import Table

    from footsense.lab.design.design import DesignResult

_POSITIVE = click.FloatRange(min=0, min_open=True)


@click.command()
@click.option("--mass", type=_POSITIVE, help="Mass of the robot [kg], with --legs.")
@click.option(
    "--legs", type=click.IntRange(2, 8), default=6, show_default=True, help="Legs; half of them carry it."
)
@click.option(
    "--load-factor",
    type=_POSITIVE,
    default=1.8,
    show_default=True,
    help="Largest force of a gait on a foot over its share of the weight: about 1.2 for a walk, 2 to 3 for a trot.",
)
@click.option("--max-force", type=_POSITIVE, help="Largest force on a foot [N]; in place of --mass.")
@click.option(
    "--recorded", type=FILE, help="CSV of recorded forces, columns with z in N; in place of --mass."
)
@click.option(
    "--min-force",
    type=_POSITIVE,
    help="Smallest force that matters [N]; without it a twentieth of the largest.",
)
@click.option(
    "--reach",
    type=click.FloatRange(5, 55),
    default=30.0,
    show_default=True,
    help="Largest angle between force and leg [deg].",
)
@click.option(
    "--error",
    type=_POSITIVE,
    default=1.0,
    show_default=True,
    help="Largest direction error that the converter's noise may cause, mean over the range [deg].",
)
@click.option(
    "--ball",
    type=(_POSITIVE, _POSITIVE),
    default=(20.0, 60.0),
    show_default=True,
    help="Least and largest diameter [mm].",
)
@click.option("--board", type=click.Choice(["fdc1004", "ad7746"]), default="fdc1004", show_default=True)
@click.option(
    "--process", default="flex", show_default=True, help="How the sheet is made, by name in its table."
)
@click.option(
    "--material", multiple=True, help="Rubber or sheet at hand; can be repeated. Without it the whole table."
)
@click.option("--materials", type=FILE, help="Your own table of materials.")
@click.option("--processes", type=FILE, help="Your own table of processes.")
@click.option("--name", default="foot", show_default=True, help="Beginning of the names of the foot types.")
@click.option("--keep", type=click.IntRange(1, 8), default=3, show_default=True, help="Feet to describe.")
@click.option(
    "--out", type=FOLDER, help="Folder for a foot.yaml of each, and the picture; without it ./design."
)
@json_option
def design(
    *,
    mass: float | None,
    legs: int,
    load_factor: float,
    max_force: float | None,
    recorded: Path | None,
    min_force: float | None,
    reach: float,
    error: float,
    ball: tuple[float, float],
    board: str,
    process: str,
    material: tuple[str, ...],
    materials: Path | None,
    processes: Path | None,
    name: str,
    keep: int,
    out: Path | None,
    as_json: bool,
) -> None:
    """Find feet for a robot, from its weight.

    Size, rubber, gap and electrodes, with their predicted errors.

    Writes a description of each foot, ready for `footsense lab build`, and a picture of all that were compared.
    """  # noqa: DOC501 - click shows this text
    from footsense.lab.design.design import design as design_feet
    from footsense.lab.design.inputs import materials as material_table
    from footsense.lab.design.inputs import processes as process_table
    from footsense.lab.design.inputs.boards import converter
    from footsense.lab.design.inputs.recorded import largest_recorded_vertical_force_n
    from footsense.lab.design.inputs.requirements import Requirements, largest_force_n

    given = {"--mass": mass, "--max-force": max_force, "--recorded": recorded}
    if sum(value is not None for value in given.values()) != 1:
        raise click.UsageError(f"give one of {', '.join(given)}")
    largest_n = max_force or 0.0
    if mass is not None:
        largest_n = largest_force_n(mass, legs, load_factor)
    if recorded is not None:
        largest_n = largest_recorded_vertical_force_n(recorded)
    known = process_table.load_processes(processes or process_table.PROCESSES_TABLE)
    if process not in known:
        raise FootsenseError(f"--process {process}: not in the table, which has {', '.join(known)}")
    least_n = min_force or largest_n / 20.0
    if least_n >= largest_n:
        raise FootsenseError(f"--min-force {least_n:g} is not below the largest force, {largest_n:g} N")
    if ball[0] > ball[1]:
        raise FootsenseError(f"--ball {ball[0]:g} {ball[1]:g}: the least diameter comes first")
    folder = out or Path("design")
    options.ensure_writable_folder(folder)
    requirements = Requirements(
        largest_n,
        least_n,
        reach,
        error,
        ball,
        material_table.load_materials(materials or material_table.MATERIALS_TABLE).select_materials(material),
        known[process],
        converter(board),
    )
    designed = design_feet(requirements, name, keep, folder)
    if as_json:
        echo_json(designed.json_values())
        return
    _print(designed)


@click.command()
@click.option(
    "--out",
    type=FILE,
    required=True,
    help="File to write; `footsense/lab/design/prediction/shapes.npz` is the released one.",
)
def shapes(*, out: Path) -> None:
    """Solve the shapes that `design` starts from.

    Half an hour, after a change of the solid's model alone.
    """
    from footsense.daemon.foot_types import released_path
    from footsense.lab.design.prediction.solving import solve_shapes
    from footsense.lab.foot_file import FOOT_FILE, load_foot

    solve_shapes(load_foot(released_path(FOOT_FILE)), out, options.elapsed_time_reporter())


def _print(designed: "DesignResult") -> None:
    """Print the table of the chosen feet, then the written files."""
    from rich.console import Console

    console = Console()
    console.width = max(console.width, 22 + 24 * len(designed.feet))  # a table that is cut off is of no use
    requirements = designed.requirements
    board = requirements.board
    click.echo(
        f"{designed.choice.n_all_candidates} feet compared for {requirements.min_evaluated_force_n:.3g} to "
        f"{requirements.max_n:.3g} N up to {requirements.max_force_to_leg_axis_deg:g} deg from the leg"
    )
    click.echo(
        f"board {board.name}: {1e3 * board.noise_pf:.2g} fF of noise, {1e3 * board.scan_s:.1f} ms for a scan"
    )
    console.print(_table(designed))
    for path in (*(foot.path for foot in designed.feet), designed.picture):
        click.echo(f"wrote {path}")


def _table(designed: "DesignResult") -> "Table":
    """Return the table of figures, one column per foot."""
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=None, pad_edge=False, padding=(0, 1))
    table.add_column("", no_wrap=True)
    for foot in designed.feet:
        table.add_column(foot.name, justify="right", no_wrap=True)
    for title, cells in designed.table_rows().items():
        table.add_row(escape(title), *cells)
    return table
