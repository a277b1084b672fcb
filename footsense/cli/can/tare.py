"""Command `footsense tare`: command the service over CAN to take the present readings of legs as unloaded."""

import sys

import click

from firmware_interface.can.codes import NODE_IDS, Result
from footsense.api.tare import tare_on
from footsense.can.interface import Can, Interface
from footsense.cli.can.can_options import can_options
from footsense.errors import FootsenseError


@click.command()
@click.argument("legs", nargs=-1, required=True, metavar="LEG...", type=click.Choice([*NODE_IDS, "all"]))
@can_options
def tare(legs: tuple[str, ...], interface: Interface, channel: str) -> None:
    """Take the present readings of each LEG as those of the unloaded foot; `all`: of every leg on CAN.

    Sends the command that a gait controller sends, and prints the answers. The service refuses the tare of a foot that
    is loaded or moves; then, and without an answer in 20 s, the command ends with exit code 1.
    """
    is_done = True
    for answer in tare_on(Can(interface=interface, channel=channel), legs):
        if answer.result is Result.DONE:
            click.echo(f"{answer.leg}: tared in {answer.response_s:.2f} s")
        else:
            is_done = False
            click.echo(f"footsense: {answer.leg}: not tared: {answer.refusal(channel)}", err=True)
    sys.exit(0 if is_done else FootsenseError.exit_code)
