"""`footsense lab selfcal`: what feet that find their electrodes while they walk gain."""

import click

from footsense.cli.options import json_option
from footsense.cli.tables import echo_json


@click.command()
@click.option(
    "--feet",
    "n_feet",
    type=click.IntRange(11, 2000),
    default=44,
    show_default=True,
    help="Feet in all cases.",
)
@json_option
def selfcal(n_feet: int, *, as_json: bool) -> None:
    """Print what feet gain that find their electrodes.

    How far forces err before and after a minute of walking: feet as made, with calibrations that are right or old, and
    with wear, in gaits of which nothing was chosen; and whether `footsense selfcal` proposes a calibration. Feet 0, 1,
    ... of seed 0, a case each in turn. Takes a quarter of a minute for each foot.
    """
    from footsense.lab.studies.boards.walking_electrodes import as_markdown, walking_figures

    figures = walking_figures(n_feet)
    if as_json:
        echo_json(figures)
        return
    click.echo(as_markdown(figures))
