"""Command `footsense exporter`: serve the service's metrics to Prometheus, from a separate process."""

import signal
from pathlib import Path

import click

from footsense.cli.options import FILE, config_option
from footsense.config import load_config
from footsense.config.sections import Metrics
from footsense.errors import ConfigError
from footsense.telemetry.exporter import start_metrics_server


@click.command()
@config_option("all defaults of its section `metrics`")
@click.option("--counters", type=FILE, help="File of the counters, instead of metrics.counters.")
@click.option(
    "--port", type=click.IntRange(0, 65_535), help="TCP port, instead of metrics.port; 0: any free one."
)
def exporter(config_file: Path | None, counters: Path | None, port: int | None) -> None:
    """Serve the service's metrics to Prometheus, until it is stopped.

    The service may start, end and start again meanwhile: `footsense_up` tells whether it runs.
    """  # noqa: DOC501 - click shows this text
    metrics = load_config(config_file).metrics if config_file else Metrics()
    if metrics is None:
        raise ConfigError(f"{config_file}: has no section metrics, so the service counts nothing")
    ends = {signal.SIGINT, signal.SIGTERM}
    signal.pthread_sigmask(signal.SIG_BLOCK, ends)  # before the server's threads begin, which inherit it
    port = start_metrics_server(
        counters or Path(metrics.counters), metrics.address, metrics.port if port is None else port
    )
    click.echo(f"http://{metrics.address}:{port}/metrics")
    signal.sigwait(ends)
