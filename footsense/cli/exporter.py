"""Command `footsense exporter`: serve the service's metrics to Prometheus, from a separate process."""

import signal
from pathlib import Path

import click

from footsense.cli.options import config_option, ring_option
from footsense.config import DEFAULT, load_config
from footsense.telemetry.exporter import start_metrics_server

#: Time between two looks at the ring [s].
_POLL_PERIOD_S = 1.0


@click.command()
@config_option("all defaults of its section `metrics`")
@ring_option
@click.option(
    "--port", type=click.IntRange(0, 65_535), help="TCP port, instead of metrics.port; 0: any free one."
)
def exporter(config_file: Path | None, ring: Path | None, port: int | None) -> None:
    """Serve the service's metrics to Prometheus, until it is stopped.

    The service may start, end and start again meanwhile: `footsense_up` is 1 while it runs.
    """
    config = load_config(config_file) if config_file else DEFAULT
    metrics = config.metrics
    ends = {signal.SIGINT, signal.SIGTERM}
    signal.pthread_sigmask(signal.SIG_BLOCK, ends)  # before the server's threads begin, which inherit it
    collector, port = start_metrics_server(
        ring or config.ring_path,
        metrics.address,
        metrics.port if port is None else port,
    )
    click.echo(f"http://{metrics.address}:{port}/metrics")
    while signal.sigtimedwait(ends, _POLL_PERIOD_S) is None:
        collector.poll()
    collector.close()
