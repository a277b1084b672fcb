"""`footsense lab response`: closures and capacitances of the foot under one load."""

from pathlib import Path

import click

from footsense.cli.lab import options
from footsense.cli.options import json_option
from footsense.cli.tables import echo_json
from footsense.errors import FootsenseError


def _parse_direction(_: click.Context, __: click.Parameter, text: str) -> tuple[float, float]:
    """Return the two angles [deg] of a direction option.

    Raises:
        click.BadParameter: They are not two numbers.
    """
    try:
        azimuth, elevation = map(float, text.split(","))
    except ValueError as error:
        raise click.BadParameter(f"two angles in degrees, such as 0,45; got {text!r}") from error
    return azimuth, elevation


@click.command()
@click.option(
    "--direction",
    "direction_deg",
    required=True,
    callback=_parse_direction,
    metavar="T1,T2",
    help="Azimuth and elevation of the force [deg].",
)
@click.option("--force-n", type=float, required=True, help="Its magnitude [N].")
@click.option("--level", default="contact", show_default=True, help="half-space, linear, contact or mesh.")
@options.models_option
@json_option
def response(
    *,
    direction_deg: tuple[float, float],
    force_n: float,
    level: str,
    models: Path | None,
    as_json: bool,
) -> None:
    """Print the elements' answer to one centred load.

    Closures and capacitances, by one of the models of the foot.
    """  # noqa: DOC501 - click shows this text
    from footsense.lab.evaluation.evaluate_models import open_models
    from footsense.lab.evaluation.fidelity_levels import response_json
    from footsense.lab.foot_file import FOOT_FILE, load_foot

    folder = models or options.released_folder()
    table, _ = open_models(folder)
    try:
        found = response_json(table, load_foot(folder / FOOT_FILE), direction_deg, force_n, level)
    except ValueError as error:
        raise FootsenseError(str(error)) from error
    if as_json:
        echo_json(found)
        return
    click.echo(
        f"{level}: {force_n:g} N at {direction_deg[0]:g}, {direction_deg[1]:g} deg; row 0 forward, column 0 left"
    )
    for what, unit in (("closure_um", "um"), ("capacitance_pf", "pF")):
        click.echo(f"{what.partition('_')[0]} [{unit}]")
        for row in found[what]:
            click.echo("  " + "  ".join(f"{value:8.3f}" for value in row))
