"""Command `footsense tare`: command the service over CAN to take the present readings of legs as unloaded."""

import sys
from collections.abc import Collection
from contextlib import closing

import click

from firmware_interface.can.codes import NODE_IDS, CommandKind, Result
from footsense.cli.can.can_options import ROBOT, can_options
from footsense.client.commander import Commander, open_command_wire
from footsense.clock import MonotonicClock
from footsense.errors import ConfigError, FootsenseError
from footsense.wires.address import CanAddress


def _legs_of_robot(ctx: click.Context, param: click.Parameter, legs: tuple[str, ...]) -> tuple[str, ...]:
    """Return the legs.

    Raises:
        BadParameter: The robot of `--config` has not all of them.
        ConfigError: It executes no commands.
    """
    del param
    robot = ctx.meta.get(ROBOT)
    if robot is None:
        return legs
    if absent := set(legs) - set(robot.legs):
        raise click.BadParameter(f"{', '.join(sorted(absent))}: this robot has {', '.join(robot.legs)}")
    if not robot.can.executes_commands:
        raise ConfigError(
            f"can.commands: this robot executes no commands on {robot.can.channel}; set `commands: true` under can in "
            "its file, and start its service again"
        )
    return legs


@click.command()
@click.argument(
    "legs",
    nargs=-1,
    metavar="[LEG]...",
    type=click.Choice([*NODE_IDS]),
    callback=_legs_of_robot,
)
@can_options
def tare(legs: tuple[str, ...], address: CanAddress) -> None:
    """Take the present readings of each LEG as those of the unloaded foot; without LEG, of all on CAN.

    Sends the command that a gait controller sends, and prints the answers. The service refuses the tare of a foot that
    is loaded or moves; then, and without an answer in 20 s, the command ends with exit code 1.
    """

    def tell_wait(waiting: Collection[str], limit_s: float) -> None:
        click.echo(f"waiting for an answer of {', '.join(waiting)}, up to {limit_s:g} s", err=True)

    is_done = True
    with closing(open_command_wire(address)) as wire:
        for answer in Commander(MonotonicClock()).command(wire, CommandKind.TARE, legs, on_wait=tell_wait):
            if answer.result is Result.DONE:
                click.echo(f"{answer.leg}: tared in {answer.response_s:.2f} s")
            else:
                is_done = False
                click.echo(f"footsense: {answer.leg}: {answer.refusal(address.channel)}", err=True)
    sys.exit(0 if is_done else FootsenseError.exit_code)
