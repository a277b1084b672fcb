"""`footsense lab design`: `foot.yaml` files of feet for a robot, from its weight."""

from pathlib import Path

import click

from footsense.cli.lab import options
from footsense.cli.options import FOLDER, json_option
from footsense.cli.tables import echo_json
from footsense.errors import FootsenseError

_POSITIVE = click.FloatRange(min=0, min_open=True)


@click.command()
@click.option("--mass", type=_POSITIVE, help="Mass of the robot [kg], with --legs.")
@click.option("--legs", type=click.IntRange(2, 8), default=6, help="Legs; half of them carry it.")
@click.option(
    "--load-factor",
    type=_POSITIVE,
    default=2.2,
    help="Largest normal load in a gait over the foot's share of the weight: 2 for a tripod or a slow trot, 2.2 for a "
    "fast one, 3.4 to 5 for hops.",
)
@click.option("--max-load", type=_POSITIVE, help="Largest normal load of a foot [N]; in place of --mass.")
@click.option(
    "--min-load",
    type=_POSITIVE,
    help="Smallest normal load that matters [N]; without it a twentieth of the largest.",
)
@click.option(
    "--lean",
    type=click.FloatRange(5, 35),
    default=30.0,
    help="Largest angle between force and contact normal [deg]: a friction of 0.577 is 30.",
)
@click.option(
    "--error",
    type=_POSITIVE,
    default=2.5,
    help="Largest direction error that the converter's noise may cause, mean over the range [deg].",
)
@click.option(
    "--ball", type=(_POSITIVE, _POSITIVE), default=(20.0, 60.0), help="Least and largest diameter [mm]."
)
@options.board_option(
    "Electronics of a foot: noise, range, time of a scan, and what its flex takes between the electrodes."
)
@click.option("--process", default="flex", help="How the sheet is made, by name in its table.")
@click.option(
    "--material",
    multiple=True,
    help="Rubber or sheet at hand, of footsense/lab/design/materials.yaml; can be repeated. Without it all.",
)
@click.option("--name", default="foot", help="Beginning of the names of the foot types.")
@click.option("--out", type=FOLDER, help="Folder for a foot.yaml of each; without it ./design.")
@json_option
def design(
    *,
    mass: float | None,
    legs: int,
    load_factor: float,
    max_load: float | None,
    min_load: float | None,
    lean: float,
    error: float,
    ball: tuple[float, float],
    board: str,
    process: str,
    material: tuple[str, ...],
    name: str,
    out: Path | None,
    as_json: bool,
) -> None:
    """Find feet for a robot, from its weight.

    Size, rubber, gap and electrodes, with their predicted errors.

    Writes a description of each foot, ready for `footsense lab build`.
    """  # noqa: DOC501 - click shows this text
    from footsense.lab.design.design import design as design_feet
    from footsense.lab.design.materials import load_materials
    from footsense.lab.design.processes import named_process
    from footsense.lab.design.requirements import PITCH_DEG, Requirements, converter, largest_normal_load_n

    if (mass is None) == (max_load is None):
        raise click.UsageError("give one of --mass, --max-load")
    largest_n = max_load or largest_normal_load_n(mass or 0.0, legs, load_factor)
    least_n = min_load or largest_n / 20.0
    if least_n >= largest_n:
        raise FootsenseError(f"--min-load {least_n:g} is not below the largest load, {largest_n:g} N")
    if ball[0] > ball[1]:
        raise FootsenseError(f"--ball {ball[0]:g} {ball[1]:g}: the least diameter comes first")
    made = named_process(process)
    folder = out or Path("design")
    options.ensure_writable_folder(folder)
    materials = load_materials().select_materials(material)
    requirements = Requirements(largest_n, least_n, lean, error, ball, materials, made, converter(board))
    feet, n_compared = design_feet(requirements, name)
    paths = [foot.write(folder) for foot in feet]
    if as_json:
        echo_json(
            {
                "max_load_n": largest_n,
                "min_load_n": least_n,
                "lean_deg": lean,
                "candidates": n_compared,
                "scan_s": requirements.board.scan_s,
                "feet": [foot.json_values() for foot in feet],
            }
        )
        return
    click.echo(
        f"{n_compared} feet compared for normal loads of {least_n:.3g} to {largest_n:.3g} N, upright or pitched by "
        f"{PITCH_DEG:g} deg, the force leaning up to {lean:g} deg\n"
        f"board {board}: {1e3 * requirements.board.noise_pf:.2g} fF of noise, "
        f"{1e3 * requirements.board.scan_s:.1f} ms for a scan. The errors are of a foot that stands; those in motion "
        f"depend on the\nscan, and `footsense lab build` tells them"
    )
    columns = [foot.cells for foot in feet]
    click.echo(" " * 22 + "".join(f"{foot.name:>28}" for foot in feet))
    for title in columns[0]:
        click.echo(f"{title:22}" + "".join(f"{cells[title]:>28}" for cells in columns))
    for path in paths:
        click.echo(f"wrote {path}")
