"""Options (interface, channel) of the commands that receive from CAN."""

from collections.abc import Callable
from typing import Any

import click

from footsense.config.contradictions import is_multicast

#: Default channel of each interface; the multicast address is that of python-can and of deploy/simulated.yaml.
_DEFAULT_CHANNELS = {"socketcan": "can0", "udp_multicast": "239.74.163.2"}

_interface_option = click.option(
    "--interface",
    type=click.Choice(list(_DEFAULT_CHANNELS)),
    default="socketcan",
    is_eager=True,  # the default of the channel depends on it
    show_default=True,
    help="udp_multicast: a simulation on this computer, without CAN.",
)


def _channel_or_default(ctx: click.Context, param: click.Parameter, value: str | None) -> str:
    """Return the given channel, or the interface type's default channel.

    Raises:
        BadParameter: It is no multicast address, and has to be one.
    """
    del param
    interface = ctx.params["interface"]
    name = value or _DEFAULT_CHANNELS[interface]
    if interface == "udp_multicast" and not is_multicast(name):
        raise click.BadParameter(
            f"{name} is no IPv4 multicast address; try {_DEFAULT_CHANNELS[interface]}", param_hint="--channel"
        )
    return name


_channel_option = click.option(
    "--channel", callback=_channel_or_default, help="Name of the channel. Default: can0, or 239.74.163.2."
)


def can_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options `--interface` and `--channel`."""
    return _interface_option(_channel_option(command))
