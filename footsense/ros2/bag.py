"""Export of a recording as a ROS 2 bag: a folder with an MCAP file of CDR messages, for `ros2 bag play`.

Version 8 of the metadata: Humble reads it, as later distributions do; in version 9 Humble cannot read the QoS profiles.
None are written, so that the topics are played with ROS's own: reliable, volatile, the last ten.
"""

import shutil
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from footsense.errors import RecordingError
from footsense.frames import USABLE, BaselineStatus, Cause, ContactFrame, Flag, State
from footsense.recording.replay import Replay
from footsense.ring.records import leg_entries
from footsense.ros2.messages import LegSample, LegTopics
from footsense.ros2.store import STORE

_METADATA_VERSION: Final = 8


def write_bag(replay: Replay, folder: Path) -> int:
    """Write a recording as a ROS 2 bag; return the number of cycles.

    A wrench and the probabilities for each new force, a contact state ten times a second and with each event,
    diagnostics once a second and with each change of a state. The folder gets its name once it is complete.

    Args:
        replay: The recording.
        folder: The new folder.

    Raises:
        RecordingError: The folder exists or cannot be written, or the recording is cut short; then what is whole was
            written.
    """
    if folder.exists():
        raise RecordingError(f"{folder}: exists and is not overwritten; choose another name or remove it")
    partial = folder.with_name(f"{folder.name}.partial")
    n_cycles, damage = 0, None
    try:
        partial.mkdir()
        bag = Writer(partial / folder.name, version=_METADATA_VERSION, storage_plugin=StoragePlugin.MCAP)
        bag.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with bag:
            topics = LegTopics(replay.legs)
            connections = {
                topic: bag.add_connection(topic, kind, typestore=STORE)
                for topic, kind in topics.types.items()
            }
            try:
                for t_ns, samples in _recorded_samples(replay):
                    for topic, cdr in topics.due_messages(samples, t_ns):
                        bag.write(connections[topic], t_ns, cdr)
                    n_cycles += 1
            except RecordingError as error:
                damage = error
            except struct.error:
                damage = RecordingError(
                    f"{replay.path}: a time after cycle {n_cycles} is none that ROS 2 can write"
                )
        (partial / folder.name).rename(folder)
    except OSError as error:
        raise RecordingError(f"{folder}: cannot be written: {error.strerror}") from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    if damage is not None:
        raise damage
    return n_cycles


def _recorded_samples(replay: Replay) -> Iterator[tuple[int, list[LegSample]]]:
    """Yield the time of sending of each cycle, since 1970 [ns], and the samples of its legs.

    Raises:
        RecordingError: The rest of the file is cut off or damaged.
    """
    offset_ns = _wall_offset_ns(replay)
    feet = leg_entries(replay.header, "feet")
    measured_ns = dict.fromkeys(replay.legs, -1)
    for cycle in replay:
        forces = cycle.forces
        samples = []
        for row, leg in enumerate(replay.legs):
            sample = _leg_sample(forces, row, leg, offset_ns)
            is_new_force = forces.t_ns[row] != measured_ns[leg]
            samples.append(sample._replace(foot_id=feet.get(leg, ""), is_new_force=is_new_force))
            measured_ns[leg] = forces.t_ns[row]
        yield forces.t_sent_ns + offset_ns, samples


def _wall_offset_ns(replay: Replay) -> int:
    """Return wall-clock time minus recorded time [ns].

    Raises:
        RecordingError: The header does not have it.
    """
    try:
        return int(replay.header["wall_offset_ns"])
    except (KeyError, ValueError):
        raise RecordingError(
            f"{replay.path}: its header has no wall_offset_ns, the time of the wall clock"
        ) from None


def _leg_sample(forces: ContactFrame, row: int, leg: str, offset_ns: int) -> LegSample:
    state, cause, gait = State(int(forces.state[row])), int(forces.cause[row]), forces.gait
    sample = LegSample(
        leg=leg,
        state=state,
        cause=Cause(cause),
        fault_mask=int(forces.fault_mask[row]),
        baseline_status=BaselineStatus(int(forces.baseline.status[row])),
    )
    if state in USABLE:
        sample = sample._replace(
            t_wall_ns=int(forces.t_ns[row]) + offset_ns,
            force_n=forces.force_n[row].tolist(),
            sigma_n=forces.sigma_n[row].tolist(),
            age_ms=float(forces.age_ns[row]) * 1e-6,
            contact=bool(forces.flags[row] & Flag.CONTACT),
            contact_probability=float(forces.contact_probability[row]),
            holds=float(forces.holds[row]),
        )
    if gait is not None:
        sample = sample._replace(
            is_new_contact=True,
            events=[(event.kind, event.t_ns + offset_ns) for event in gait.events if event.leg == row],
            ground_normal=gait.normal[row].tolist(),
            friction_coefficient=gait.friction,
        )
    return sample
