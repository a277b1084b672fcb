"""Command `footsense view`: serve the web page of a running service or of a recording."""

import asyncio
import os
import signal
import threading
from contextlib import suppress
from pathlib import Path

import click
import msgspec

from footsense.child_process import drop_realtime, end_with_parent
from footsense.cli.options import FILE, config_option, ring_option
from footsense.config import DEFAULT, load_config
from footsense.errors import ConfigError
from footsense.progress import file_progress_bar
from footsense.view.live import LiveSource
from footsense.view.recorded import RecordingSource
from footsense.view.server import ViewServer


@click.command()
@click.argument("file", type=FILE, required=False)
@config_option("all defaults of its section `view`")
@ring_option
@click.option("--address", help="Address to serve on, instead of view.address; 0.0.0.0 for every network.")
@click.option(
    "--port", type=click.IntRange(0, 65_535), help="TCP port, instead of view.port; 0: any free one."
)
@click.option(
    "--with-parent", is_flag=True, hidden=True, help="For a run: end with it; take a free port if need be."
)
def view(
    file: Path | None,
    config_file: Path | None,
    ring: Path | None,
    address: str | None,
    port: int | None,
    *,
    with_parent: bool,
) -> None:
    """Serve the page of a running service, or of the recording FILE, until it is stopped.

    The service may start, end and start again meanwhile. Foxglove, Lichtblick and PlotJuggler connect to the same port,
    with ws:// in place of http://. Who can reach the port can read; only the loopback is served unless an address says
    otherwise.
    """  # noqa: DOC501 - click shows this text
    config = load_config(config_file) if config_file else DEFAULT
    settings = config.view
    if address is not None:
        settings = msgspec.structs.replace(settings, address=address)
    if with_parent:
        end_with_parent()
    drop_realtime()
    with suppress(OSError):  # its unit denies the call, and has set its own
        os.nice(5)  # a viewer never competes with what else the robot's computer does
    source = LiveSource(ring or config.ring_path) if file is None else RecordingSource(file)
    port = settings.port if port is None else port
    try:
        asyncio.run(_serve_until_stopped(ViewServer(source), settings.address, port))
    except ConfigError:
        if not with_parent:
            raise
        asyncio.run(_serve_until_stopped(ViewServer(source), settings.address, 0))


async def _serve_until_stopped(server: ViewServer, address: str, port: int) -> None:
    """Serve the page until SIGTERM or SIGINT."""
    loop, stop = asyncio.get_running_loop(), asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    async with server.serving(address, port) as url:
        click.echo(url)
        if isinstance(server.source, RecordingSource):
            threading.Thread(target=_read_with_progress, args=(server.source,), daemon=True).start()
        await stop.wait()


def _read_with_progress(recorded: RecordingSource) -> None:
    with file_progress_bar("reading", recorded.path) as on_bytes_read:
        recorded.read(on_bytes_read)
    if problem := recorded.status()["problem"]:
        click.echo(f"footsense: {problem}", err=True)
