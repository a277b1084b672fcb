"""`footsense lab selection`: what contact and its thresholds are chosen by."""

import click

from footsense.cli.options import json_option
from footsense.cli.tables import echo_json


@click.command()
@json_option
def selection(*, as_json: bool) -> None:
    """Print how contact is told on the selection of gaits.

    Robots, gaits and slow loads of the selection go through the service's estimation: touches found, in the air and
    twice, when they are told, how they are dated. Numbers of `footsense/estimation` are chosen by it, and judged by
    `footsense lab study motion`, which has other robots and gaits. Takes a few minutes.
    """
    from footsense.foot.type_folders import released_folder, released_names
    from footsense.lab.walkers.selection import as_markdown, select

    figures = select([released_folder(foot) for foot in released_names()])
    if as_json:
        echo_json(figures)
        return
    click.echo(as_markdown(figures))
