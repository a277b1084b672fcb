"""Options of the commands that receive from CAN: the robot's file, or interface and channel."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from footsense.cli.options import FILE
from footsense.config import load_config
from footsense.errors import CanError, ConfigError
from footsense.wires.address import DEFAULT_CHANNELS, CanAddress, address_of

#: Key in the context of a command of the robot's file, as a configuration.
ROBOT = "footsense.robot"


def _take_from_file(ctx: click.Context, param: click.Parameter, value: Path | None) -> None:
    """Let interface and channel of a robot's file be the defaults of the options, and keep the robot.

    Raises:
        ConfigError: It is no such file, or no other program hears its frames.
    """
    del param
    if value is None:
        return
    config = load_config(value)
    can = config.can
    if can.interface not in DEFAULT_CHANNELS:
        raise ConfigError(
            f"{value}: can.interface: the frames of {can.interface} stay within the service's process; "
            "with udp_multicast other programs on this computer hear them"
        )
    ctx.meta[ROBOT] = config
    ctx.default_map = {"interface": can.interface, "address": can.channel} | dict(ctx.default_map or {})


def _take_channel(ctx: click.Context, param: click.Parameter, value: str | None) -> None:
    del param
    if value is not None:
        ctx.default_map = dict(ctx.default_map or {}) | {"address": value}


#: Argument of a command with `can_options`, for its channel alone.
channel_argument = click.argument(
    "can_channel",
    metavar="[CHANNEL]",
    required=False,
    is_eager=True,
    expose_value=False,
    callback=_take_channel,
)


def _address(ctx: click.Context, param: click.Parameter, value: str | None) -> CanAddress:
    """Return the address of a channel on the interface of `--interface`, if there is one.

    Raises:
        BadParameter: There is no such channel.
    """
    del param
    try:
        return address_of(value, ctx.params.pop("interface"))
    except CanError as error:
        raise click.BadParameter(str(error), param_hint="--channel") from None


#: In the order in which they are read; each is the default of the next.
_OPTIONS = (
    click.option(
        "--config",
        type=FILE,
        is_eager=True,
        expose_value=False,
        callback=_take_from_file,
        help="YAML file of the robot, which names its CAN interface.",
    ),
    click.option(
        "--interface",
        type=click.Choice(list(DEFAULT_CHANNELS)),
        is_eager=True,
        help="Without a file: socketcan, or udp_multicast for a simulation on this computer. Default: what the channel "
        "is, or socketcan.",
    ),
    click.option(
        "--channel",
        "address",
        callback=_address,
        help="Without a file: name of the channel. Default: can0, or 239.74.163.2.",
    ),
)


def can_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options `--config`, `--interface` and `--channel`, and the `address` that they name."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command
