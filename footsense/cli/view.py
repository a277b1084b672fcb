"""`footsense view`: the page of a running service or of a recording."""

import asyncio
import os
import threading
from contextlib import ExitStack, closing
from pathlib import Path
from typing import TYPE_CHECKING

import click

from footsense.child_process import drop_realtime
from footsense.cli.options import FILE, config_option
from footsense.clock import MonotonicClock
from footsense.config import load_config
from footsense.config.sections import View
from footsense.errors import ConfigError

if TYPE_CHECKING:
    from footsense.view.recorded import Recorded


@click.command()
@click.argument("file", type=FILE, required=False)
@config_option("all defaults of its section `view`")
@click.option("--cycles", type=FILE, help="File of the shared cycles, instead of view.cycles.")
@click.option("--address", help="IP address to serve on, instead of view.address.")
@click.option(
    "--port", type=click.IntRange(0, 65_535), help="TCP port, instead of view.port; 0: any free one."
)
def view(
    file: Path | None, config_file: Path | None, cycles: Path | None, address: str | None, port: int | None
) -> None:
    """Serve the page of a running service, or of the recording FILE, until it is stopped.

    The service may start, end and start again meanwhile.
    """  # noqa: DOC501 - click shows this text
    settings = load_config(config_file).view if config_file else View()
    if settings is None:
        raise ConfigError(f"{config_file}: has no section view, so the service shares no cycles")
    from footsense.view.live import Live
    from footsense.view.recorded import Recorded
    from footsense.view.server import ViewServer

    drop_realtime()
    os.nice(5)  # a viewer never competes with what else the robot's computer does
    with ExitStack() as stack:
        source: Live | Recorded
        if file is None:
            source = Live(cycles or Path(settings.cycles), MonotonicClock())
        else:
            source = Recorded(file)
            threading.Thread(target=_read, args=(source,), daemon=True).start()
        stack.enter_context(closing(source))
        server = ViewServer(source)
        asyncio.run(
            server.run(address or settings.address, settings.port if port is None else port, click.echo)
        )


def _read(recorded: "Recorded") -> None:
    """Read a recording, with a bar of progress on a terminal."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("reading", total=recorded.total_s or None)
        recorded.read(lambda end_s: progress.update(task, completed=end_s))
