"""`footsense lab walking-electrodes`: what feet that find their electrodes while they walk gain."""

import click

from footsense.cli.options import json_option
from footsense.cli.tables import echo_json


@click.command("walking-electrodes")
@click.option(
    "--feet", "n_feet", type=click.IntRange(1, 200), default=6, show_default=True, help="Feet of each case."
)
@json_option
def walking_electrodes(n_feet: int, *, as_json: bool) -> None:
    """Print how far forces err before and after a minute of walking.

    Feet as made, with calibrations that are right or old, and with wear, walk in gaits of which nothing was chosen;
    `footsense selfcal` finds their electrodes, and proposes a calibration or objects. Feet 0, 1, ... of seed 0. Takes
    a minute for each foot.
    """
    from footsense.lab.studies.boards.walking_electrodes import as_markdown, walking_figures

    figures = walking_figures(n_feet)
    if as_json:
        echo_json(figures)
        return
    click.echo(as_markdown(figures))
