"""Options that several commands share, and the end of a run by time or signal."""

import math
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import click

from footsense.errors import ConfigError

#: Not checked by click: a file that cannot be read is an error of what it holds, in one line, and no wrong usage.
FILE = click.Path(path_type=Path, readable=False)
FOLDER = click.Path(file_okay=False, path_type=Path, readable=False)

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]

can_log_option = click.option(
    "--can-log",
    type=FILE,
    help="Write the CAN frames of a simulation to this file: .log (candump), .asc or .blf. On a robot: candump -l.",
)
ring_option = click.option(
    "--ring",
    type=FILE,
    help="The service's ring, instead of that of the configuration. Default: /run/footsense/ring, or without one that "
    "of a simulation of yours.",
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON.")
pace_option = click.option(
    "--realtime/--fast",
    default=None,
    help="Pace a simulation with the wall clock, or not. Default: paced if a live picture is shown, or if others "
    "hear its CAN frames.",
)


foot_option = click.option("--foot", required=True, help="The foot on the test stand, such as foot-0007.")


def config_option(default: str) -> Decorator:
    """Return the option `--config`; `default` describes in its help what is used without it."""
    return click.option(
        "--config", "config_file", type=FILE, help=f"YAML file of a robot. Default: {default}."
    )


def duration_option(text: str) -> Decorator:
    """Return the option `--duration` [s] with the given help; without it the value is infinity."""
    return click.option(
        "--duration",
        "duration_s",
        type=click.FloatRange(min=0, min_open=True),
        metavar="SECONDS",
        callback=_duration_s,
        help=text,
    )


def _duration_s(ctx: click.Context, param: click.Parameter, value: float | None) -> float:
    """Return the duration [s]; infinity for None.

    Raises:
        BadParameter: It is infinite or not a number.
    """
    del ctx, param
    if value is not None and not math.isfinite(value):
        raise click.BadParameter(f"{value} is not a duration; without the option it runs until it is stopped")
    return math.inf if value is None else value


def is_paced(*, simulated: bool, realtime: bool | None, followed: bool) -> bool:
    """Return whether a simulation runs at the speed of real time.

    Args:
        simulated: Whether there is a simulation to pace.
        realtime: The option `--realtime/--fast`; None without it.
        followed: Whether a live picture is shown, or other programs hear its CAN frames.

    Raises:
        ConfigError: There is none, and the option is given.
    """
    if not simulated and realtime is not None:
        raise ConfigError("--realtime and --fast are for simulations; this configuration names real buses")
    return simulated and (followed if realtime is None else realtime)


class StopRequest:
    """Whether SIGTERM or SIGINT has arrived; creating it installs the signal handlers.

    Until somebody asks for the first time, a signal ends the process by itself, well: a start may wait for something.
    """

    def __init__(self) -> None:
        self._is_asked = self._has_arrived = False
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._set_stop)

    @property
    def requested(self) -> bool:
        """Whether a signal has arrived."""
        self._is_asked = True
        return self._has_arrived

    def _set_stop(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        is_first, self._has_arrived = not self._has_arrived, True
        if is_first and not self._is_asked:  # a second one does not disturb what the first one closes
            sys.exit()
