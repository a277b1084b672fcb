"""Options of the commands that receive from CAN: the robot's file, or interface and channel."""

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any

import click

from footsense.cli.options import FILE
from footsense.config import load_config
from footsense.errors import CanError, ConfigError
from footsense.wires.address import DEFAULT_CHANNELS, is_multicast

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
    ctx.default_map = {"interface": can.interface, "channel": can.channel} | dict(ctx.default_map or {})


def _take_channel(ctx: click.Context, param: click.Parameter, value: str | None) -> None:
    del param
    if value is not None:
        ctx.default_map = dict(ctx.default_map or {}) | {"channel": value}


#: Argument of a command with `can_options`, for its channel alone.
channel_argument = click.argument(
    "can_channel",
    metavar="[CHANNEL]",
    required=False,
    is_eager=True,
    expose_value=False,
    callback=_take_channel,
)


def _channel_or_default(ctx: click.Context, param: click.Parameter, value: str | None) -> str:
    """Return the given channel, or the interface type's default channel.

    Raises:
        BadParameter: It is no multicast address, and has to be one.
    """
    del param
    interface = ctx.params["interface"]
    name = value or DEFAULT_CHANNELS[interface]
    if interface == "udp_multicast" and not is_multicast(name):
        raise click.BadParameter(
            f"{name} is no IPv4 multicast address; try {DEFAULT_CHANNELS[interface]}", param_hint="--channel"
        )
    return name


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
        default="socketcan",
        is_eager=True,
        help="Without a file: socketcan (default), or udp_multicast for a simulation on this computer.",
    ),
    click.option(
        "--channel",
        callback=_channel_or_default,
        help="Without a file: name of the channel. Default: can0, or 239.74.163.2.",
    ),
)


def silence_text(channel: str) -> str:
    """Return the error line of a channel on which nothing is heard."""
    return f"no frames on {channel}; is the service running?"


def can_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options `--config`, `--interface` and `--channel`.

    Where the interface was not chosen and CAN fails, the error names the one of a simulation.
    """

    @wraps(command)
    def told(*arguments: Any, **options: Any) -> Any:  # noqa: ANN401 - the command's own
        try:
            return command(*arguments, **options)
        except CanError as error:
            if options["interface"] != "socketcan" or ROBOT in click.get_current_context().meta:
                raise
            raise CanError(f"{error}; of a simulation: --interface udp_multicast") from None

    for option in reversed(_OPTIONS):
        told = option(told)
    return told
