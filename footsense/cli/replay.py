"""`footsense replay`: a recorded walk through the very same loop, and whether it still gives the same forces."""

import sys
from contextlib import ExitStack
from pathlib import Path

import click

from footsense import app
from footsense.clock import MonotonicClock
from footsense.errors import FootsenseError, ModelError
from footsense.loop import Paced, step
from footsense.recording.compare import compare, same_machine
from footsense.recording.machine import this_machine
from footsense.recording.replay import Replay, ReplayClock, ReplaySource


class DifferenceError(FootsenseError):
    """The forces made again are not those that were recorded."""


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--check", is_flag=True, help="Compare with the recorded forces: exit 1 at the first difference."
)
@click.option(
    "--can-log",
    type=click.Path(path_type=Path),
    help="Write what was sent on CAN: .log (candump), .asc or .blf.",
)
@click.option("--realtime", is_flag=True, help="Play at the speed of the recording.")
def replay(file: Path, *, check: bool, can_log: Path | None, realtime: bool) -> None:
    r"""Run the recorded scans of FILE through the pipeline again and publish the forces.

    The recording brings its configuration; its scans meet the same code as those of a robot.
    With --check, forces must be equal bit for bit where processor and library versions are those of the
    recording, else to 1 mN. A recording that is cut short is replayed as far as it is whole (exit 3).
    \f

    Raises:
        ModelError: The recording was made with another network.
        DifferenceError: A force is not what it was.
    """
    recording = Replay(file)
    source = ReplaySource(recording)
    clock = ReplayClock(source)
    config = app.recorded_config(recording)
    network = app.load_network(config)
    if check and network.sha256 != recording.header.get("model_sha256"):
        raise ModelError(
            f"{file}: recorded with network {recording.header.get('model_sha256', 'unknown')[:12]}, "
            f"here is {network.sha256[:12]}; only the same network can give the same forces"
        )
    exact = same_machine(recording.header, this_machine())
    pipeline = app.pipeline_for(config, network, app.recorded_flags(recording))
    n_frames = 0
    with ExitStack() as stack:
        sink = stack.enter_context(app.can_sink(config, clock, can_log))
        frames = Paced(source, clock, MonotonicClock()) if realtime else source
        while (scan := frames.read()) is not None:
            recorded = source.cycle
            assert recorded is not None
            commands = (*source.commands(), *sink.commands())
            forces = step(scan, commands, pipeline, sink, (), clock).forces
            difference = check and compare(recorded.forces, forces, exact=exact, legs=recording.legs)
            if difference:
                raise DifferenceError(f"{file}: {difference}")
            n_frames += 1
    how = (
        ("equal bit for bit" if exact else "equal to 1 mN (another processor or library version)")
        if check
        else "replayed"
    )
    click.echo(f"{n_frames} scans {how}")
    if source.damage is not None:
        click.echo(f"footsense: {source.damage}", err=True)
        sys.exit(source.damage.exit_code)
