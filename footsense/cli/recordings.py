"""Commands that read recordings: `footsense export`, `replay` and `snapshot`."""

from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path

import click
import msgspec

from footsense.child_process import check_new_file
from footsense.cli.options import FILE, FOLDER, can_log_option, config_option, ring_option
from footsense.clock import wall_time_iso
from footsense.config import load_config
from footsense.daemon.can_output import can_sink
from footsense.daemon.estimation import pipeline_for
from footsense.daemon.loop import Loop
from footsense.daemon.models import Models, load_models
from footsense.daemon.recording_header import (
    model_mismatch_reason,
    recorded_config,
    recorded_flags,
    recorded_start,
)
from footsense.errors import FootsenseError, ModelError, RecordingError, require
from footsense.frames import Flag
from footsense.progress import file_progress_bar
from footsense.recording.compare import Comparison, differing_entries
from footsense.recording.fault_recordings import FaultRecorder
from footsense.recording.machine import platform_versions
from footsense.recording.recorder import check_recording_target
from footsense.recording.replay import Replay
from footsense.recording.snapshot import SNAPSHOT_KEY, write_snapshot
from footsense.ring.cycle_reader import CycleReader
from footsense.ring.following import follow_services
from footsense.ring.records import LostCycles
from footsense.sim.can.frame_log import check_log_target
from footsense.sim.clock import VirtualClock


@click.command()
@click.argument("file", type=FILE)
@click.option(
    "--check", is_flag=True, help="Compare with the recorded forces: exit 1 at the first that is another."
)
@click.option(
    "--exact", is_flag=True, help="Compare bit for bit: exit 1 also where only the last bits differ."
)
@can_log_option
@click.option(
    "--calibrations",
    "folder",
    type=FOLDER,
    help="Folder of the calibrations of the recorded feet; default: where it was on the robot.",
)
def replay(file: Path, *, check: bool, exact: bool, can_log: Path | None, folder: Path | None) -> None:
    """Run the recorded readings of FILE through the pipeline again and publish the forces.

    The recording brings its configuration; its readings meet the same code as those of a robot.
    With --check, forces must be equal to 1 mN, states and times of measurement the same; how many cycles are equal
    bit for bit is printed, and by how much the others differ. On the same kind of processor, with the same BLAS and
    library versions, all are: --exact fails otherwise. A recording that is cut short is replayed as far as it is
    whole, and compared up to its first gap (exit 74).
    """
    check = check or exact
    if can_log is not None:
        check_log_target(can_log, "virtual", "")
    with file_progress_bar("replay", file) as on_bytes_read:
        recording = Replay(file, on_bytes_read)
        comparison = Comparison(recording.legs, exact=exact) if check else None
        _run_replay(recording, _recorded_models(recording, folder, check=check), can_log, comparison)


def _recorded_models(recording: Replay, folder: Path | None, *, check: bool) -> Models:
    """Load the models with which a recording was made; warn where there are only others.

    Raises:
        ModelError: The forces cannot be compared: they are of another network.
        RecordingError: They cannot be compared: the recording is a snapshot.
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
    models = load_models(config, recorded_start(recording))
    if difference := model_mismatch_reason(recording.header, models):
        error = ModelError(f"{file}: {difference}")
        if check:
            raise error
        click.echo(f"warning: {error}", err=True)
    return models


def _run_replay(
    recording: Replay, models: Models, can_log: Path | None, comparison: Comparison | None
) -> None:
    """Run a recording through the pipeline, and print the result of the comparison.

    Raises:
        FootsenseError: A force differs.
        RecordingError: The recording has gaps, or ends early.
    """
    file = recording.path
    pipeline = pipeline_for(models, recorded_flags(recording))
    clock = VirtualClock()
    n_frames = n_lost = 0
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
                made = loop.run_cycle(
                    recorded.scan,
                    commands,
                    temperature_c=recorded.temperature_c,
                    motion=recorded.motion,
                )
                if comparison is not None and not n_lost and (different := comparison.add(recorded, made)):
                    raise FootsenseError(f"{file}: {different}{_made_elsewhere(recording)}")
                n_frames += 1
        except RecordingError as error:
            damage = error
    if comparison is None:
        click.echo(f"{n_frames} cycles replayed")
    else:
        is_bitwise = comparison.n_bitwise == comparison.n_cycles
        click.echo(comparison.summary() + ("" if is_bitwise else _made_elsewhere(recording)))
    lost = f"{n_lost} cycles were lost when it was recorded" if n_lost else ""
    if lost and comparison is not None:
        lost += f", only the {comparison.n_cycles} cycles before the first of them were compared"
    if damage is not None:
        raise RecordingError(f"{damage}; before that, {lost}" if lost else str(damage))
    if lost:
        raise RecordingError(f"{file}: {lost}")
    if comparison is not None and not comparison.n_cycles:
        raise RecordingError(f"{file}: has no cycle, nothing was compared")


def _made_elsewhere(recording: Replay) -> str:
    """Return what was another where the recording was made, for the end of a line; empty if nothing was."""
    others = differing_entries(recording.header, platform_versions())
    return f" (recorded with another {', '.join(others)})" if others else ""


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
@click.argument("target", type=FILE, metavar="[OUT.mcap]", required=False)
@click.option(
    "--of-faults",
    "folder",
    type=FOLDER,
    help="Stay, and write one to this folder ten seconds after each fault; the oldest are removed.",
)
@config_option("the service's ring where it is by default")
@ring_option
def snapshot(target: Path | None, folder: Path | None, config_file: Path | None, ring: Path | None) -> None:
    """Write the last 30 s or more of the running service to the recording OUT.mcap: all that its ring holds.

    With --of-faults it watches the service, and the next one when that has ended: when a leg gets another cause, it
    writes what came before and the ten seconds after, at most once a minute. Of a leg and cause the newest three
    are kept, twenty in all. `footsense info FOLDER` lists them.
    """  # noqa: DOC501 - click shows this text
    if (target is None) == (folder is None):
        raise click.UsageError("say what to write: OUT.mcap, or --of-faults FOLDER")
    if ring is None and config_file is not None:
        ring = load_config(config_file).ring_path
    if folder is not None:
        follow_services(ring, partial(FaultRecorder, folder=folder, wall_time=wall_time_iso))
    if target is not None:
        check_recording_target(target)
        with closing(CycleReader(ring)) as reader:
            n_cycles = write_snapshot(reader, target)
        click.echo(f"{target}: {n_cycles} cycles")
