"""Commands that read recordings: `footsense export`, `replay` and `snapshot`."""

from collections.abc import Callable
from pathlib import Path

import click
import msgspec

from footsense.child_process import check_new_file
from footsense.cli.options import FILE, FOLDER, can_log_option, config_option, ring_option
from footsense.config import load_config
from footsense.daemon.can_output import can_sink
from footsense.daemon.estimation import pipeline_for
from footsense.daemon.loop import Loop
from footsense.daemon.models import Models, load_models
from footsense.daemon.recording_header import (
    board_mismatch_reason,
    model_mismatch_reason,
    recorded_config,
    recorded_flags,
)
from footsense.errors import FootsenseError, ModelError, RecordingError, require
from footsense.frames import Flag
from footsense.progress import file_progress_bar
from footsense.recording.compare import first_difference, same_processor_and_libraries
from footsense.recording.machine import platform_versions
from footsense.recording.replay import Replay
from footsense.recording.snapshot import SNAPSHOT_KEY, write_snapshot
from footsense.ring.records import LostCycles
from footsense.sim.can.frame_log import check_log_target
from footsense.sim.clock import VirtualClock


@click.command()
@click.argument("file", type=FILE)
@click.option(
    "--check", is_flag=True, help="Compare with the recorded forces: exit 1 at the first difference."
)
@can_log_option
@click.option(
    "--calibrations",
    "folder",
    type=FOLDER,
    help="Folder of the calibrations of the recorded feet; default: where it was on the robot.",
)
def replay(file: Path, *, check: bool, can_log: Path | None, folder: Path | None) -> None:
    """Run the recorded readings of FILE through the pipeline again and publish the forces.

    The recording brings its configuration; its readings meet the same code as those of a robot.
    With --check, forces must be equal bit for bit where processor and library versions are those of the
    recording, else to 1 mN. A recording that is cut short is replayed as far as it is whole, and compared up to
    its first gap (exit 74).
    """
    if can_log is not None:
        check_log_target(can_log, "virtual", "")
    with file_progress_bar("replay", file) as on_bytes_read:
        recording = Replay(file, on_bytes_read)
        _run_replay(recording, _recorded_models(recording, folder, check=check), can_log, check=check)


def _recorded_models(recording: Replay, folder: Path | None, *, check: bool) -> Models:
    """Load the models with which a recording was made; warn where there are only others.

    Raises:
        ModelError: The forces cannot be compared: they are of another network.
        RecordingError: They cannot be compared: the recording is a snapshot. Or its readings are of another board than
            its configuration.
    """
    file = recording.path
    if check and SNAPSHOT_KEY in recording.header:
        raise RecordingError(
            f"{file}: is a snapshot, which begins in the middle of a run: what the service had learnt before is not in "
            "it, so its forces cannot be computed again"
        )
    config = recorded_config(recording)
    if folder is not None and config.calibrations is not None:
        config = msgspec.structs.replace(config, calibrations=str(folder))
    models = load_models(config)
    first = next((entry for entry in recording.entries() if not isinstance(entry, LostCycles)), None)
    if first is not None and (reason := board_mismatch_reason(first.cycle.scan, config)):
        raise RecordingError(f"{file}: {reason}")
    if difference := model_mismatch_reason(recording.header, models):
        error = ModelError(f"{file}: {difference}")
        if check:
            raise error
        click.echo(f"warning: {error}", err=True)
    return models


def _run_replay(recording: Replay, models: Models, can_log: Path | None, *, check: bool) -> None:
    """Run a recording through the pipeline, and print the result of the comparison.

    Raises:
        FootsenseError: A force differs.
        RecordingError: The recording has gaps, or ends early.
    """
    file = recording.path
    pipeline = pipeline_for(models, recorded_flags(recording))
    exact = same_processor_and_libraries(recording.header, platform_versions())
    clock = VirtualClock()
    n_frames = n_equal = n_lost = 0
    damage = None
    with can_sink(models, clock, can_log) as sink:
        loop = Loop(pipeline, sink, (), clock)
        try:
            for entry in recording.entries():
                if isinstance(entry, LostCycles):
                    n_lost += entry.n_cycles
                    continue
                recorded = entry.cycle
                clock.sleep_until_ns(recorded.forces.t_sent_ns)
                commands = (*recorded.started_commands, *sink.commands())
                pipeline.set_degraded_timing(bool((recorded.forces.flags & Flag.DEGRADED_TIMING).any()))
                made = loop.run_cycle(recorded.scan, commands, temperature_c=recorded.temperature_c)
                if check and not n_lost:
                    if different := first_difference(recorded, made, exact=exact, legs=recording.legs):
                        raise FootsenseError(f"{file}: {different}")
                    n_equal += 1
                n_frames += 1
        except RecordingError as error:
            damage = error
    how = "bit for bit" if exact else "to 1 mN (another processor or library version)"
    click.echo(f"{n_equal} cycles equal {how}" if check else f"{n_frames} cycles replayed")
    lost = f"{n_lost} cycles were lost when it was recorded" if n_lost else ""
    if lost and check:
        lost += f", only the {n_equal} cycles before the first of them were compared"
    if damage is not None:
        raise RecordingError(f"{damage}; before that, {lost}" if lost else str(damage))
    if lost:
        raise RecordingError(f"{file}: {lost}")
    if check and not n_equal:
        raise RecordingError(f"{file}: has no cycle, nothing was compared")


_RecordingWriter = Callable[[Replay, Path], int]


@click.command("export")
@click.argument("file", type=FILE)
@click.option("--ros2", type=FILE, metavar="FOLDER", help="Write a bag: `ros2 bag play FOLDER`.")
@click.option("--csv", type=FILE, help="Write a table: a row for each leg and cycle, units in the headers.")
def export(file: Path, *, ros2: Path | None, csv: Path | None) -> None:
    """Convert the recording FILE; give one or both of the forms.

    What is not known is never a plausible number: a leg without a usable force has no wrench in a bag, and an empty
    cell in a table. A recording that is cut short is converted as far as it is whole (exit 74).
    """  # noqa: DOC501 - click shows this text
    forms: list[tuple[Path, _RecordingWriter]] = []
    if ros2 is not None:
        require("--ros2", "ros2", "rosbags")
        from footsense.ros2.bag import write_bag

        forms.append((ros2, write_bag))
    if csv is not None:
        from footsense.export.tables import write_csv

        forms.append((csv, write_csv))
    if not forms:
        raise click.UsageError("say what to write: --ros2 FOLDER or --csv FILE")
    Replay(file)
    for target, _ in forms:
        check_new_file(str(target), target)
    for target, write in forms:
        _convert(file, target, write)


def _convert(file: Path, target: Path, write: _RecordingWriter) -> None:
    with file_progress_bar(target.name, file) as on_bytes_read:
        try:
            n_cycles = write(Replay(file, on_bytes_read), target)
        except RecordingError:
            raise
        except BaseException as error:
            if target.is_file():
                target.unlink()
            if isinstance(error, OSError):
                raise RecordingError(f"{target}: cannot be written: {error.strerror}") from None
            raise
    click.echo(f"{target}: {n_cycles} cycles")


@click.command()
@click.argument("target", type=FILE, metavar="OUT.mcap")
@config_option("the service's ring where it is by default")
@ring_option
def snapshot(target: Path, config_file: Path | None, ring: Path | None) -> None:
    """Write the last 30 s or more of the running service to the recording OUT.mcap: all that its ring holds."""
    if ring is None and config_file is not None:
        ring = load_config(config_file).ring_path
    n_cycles = write_snapshot(ring, target)
    click.echo(f"{target}: {n_cycles} cycles")
