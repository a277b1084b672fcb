"""`footsense replay`: run a recording through the same loop again, and compare the forces."""

from contextlib import ExitStack
from pathlib import Path

import click
import msgspec

from footsense.can.frame_log import check_log_target
from footsense.cli.options import FILE, FOLDER, can_log_option
from footsense.clock import MonotonicClock
from footsense.daemon.calibrations import load_calibrations
from footsense.daemon.can_output import can_sink
from footsense.daemon.estimation import load_network, pipeline_for
from footsense.daemon.loop import Paced, step
from footsense.daemon.recording_header import model_difference, recorded_config, recorded_flags
from footsense.errors import FootsenseError, ModelError, RecordingError
from footsense.frames import ContactFrame
from footsense.recording.compare import compare, same_machine
from footsense.recording.machine import platform_versions
from footsense.recording.replay import Replay, ReplayClock, ReplaySource


class DifferenceError(FootsenseError):
    """The replayed forces are not the recorded ones."""


class Comparison:
    """Compares replayed forces with the recorded ones.

    Args:
        file: The recording, for messages.
        recording: The recording; its header names processor and library versions.
    """

    def __init__(self, file: Path, recording: Replay) -> None:
        self._file = file
        self._legs = recording.legs
        self._exact = same_machine(recording.header, platform_versions())
        self.n_equal = 0

    def compare_frame(self, recorded: ContactFrame, forces: ContactFrame) -> None:
        """Compare the forces of one scan.

        Raises:
            DifferenceError: A force differs.
        """
        difference = compare(recorded, forces, exact=self._exact, legs=self._legs)
        if difference:
            raise DifferenceError(f"{self._file}: {difference}")
        self.n_equal += 1

    def __str__(self) -> str:
        how = "bit for bit" if self._exact else "to 1 mN (another processor or library version)"
        return f"{self.n_equal} scans equal {how}"


@click.command()
@click.argument("file", type=FILE)
@click.option(
    "--check", is_flag=True, help="Compare with the recorded forces: exit 1 at the first difference."
)
@can_log_option
@click.option("--realtime", is_flag=True, help="Play at the speed of the recording.")
@click.option(
    "--calibrations",
    "folder",
    type=FOLDER,
    help="Folder of the calibrations of the recorded feet; default: where it was on the robot.",
)
def replay(file: Path, *, check: bool, can_log: Path | None, realtime: bool, folder: Path | None) -> None:
    """Run the recorded scans of FILE through the pipeline again and publish the forces.

    The recording brings its configuration; its scans meet the same code as those of a robot.
    With --check, forces must be equal bit for bit where processor and library versions are those of the
    recording, else to 1 mN. A recording that is cut short is replayed as far as it is whole, and compared up to
    its first gap (exit 3).
    """  # noqa: DOC501 - click shows this text
    if can_log is not None:
        check_log_target(can_log)
    recording = Replay(file)
    source = ReplaySource(recording)
    clock = ReplayClock(source)
    config = recorded_config(recording)
    if folder is not None and config.calibrations is not None:
        config = msgspec.structs.replace(config, calibrations=str(folder))
    calibrations = load_calibrations(config)
    network = load_network(config, calibrations)
    comparison = Comparison(file, recording) if check else None
    difference = model_difference(recording.header, network, calibrations)
    if difference and check:
        raise ModelError(f"{file}: {difference}")
    if difference:
        click.echo(f"warning: {file}: {difference}", err=True)
    pipeline = pipeline_for(config, network, recorded_flags(recording), calibrations)
    n_frames = 0
    with ExitStack() as stack:
        sink = stack.enter_context(can_sink(config, clock, can_log, real_time=realtime))
        frames = Paced(source, clock, MonotonicClock()) if realtime else source
        while (scan := frames.read()) is not None:
            recorded = source.cycle
            assert recorded is not None
            commands = (*source.commands(), *sink.commands())
            made = step(scan, commands, pipeline, sink, (), clock, temperature_c=recorded.temperature_c)
            if comparison and not source.lost:
                comparison.compare_frame(recorded.forces, made.forces)
            n_frames += 1
    click.echo(str(comparison) if comparison else f"{n_frames} scans replayed")
    _require_whole(file, source, comparison)


def _require_whole(file: Path, source: ReplaySource, comparison: Comparison | None) -> None:
    """Check at the end that the recording has no gaps and a proper end.

    Raises:
        RecordingError: It has gaps, or ends early.
    """
    lost = f"{source.lost} cycles were lost when it was recorded" if source.lost else ""
    if lost and comparison:
        lost += f", only the {comparison.n_equal} scans before the first of them were compared"
    if source.damage is not None:
        raise RecordingError(f"{source.damage}; before that, {lost}" if lost else str(source.damage))
    if lost:
        raise RecordingError(f"{file}: {lost}")
