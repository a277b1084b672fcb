"""Export of a recording as a ROS 2 bag."""

from pathlib import Path

from footsense.errors import RecordingError
from footsense.recording.replay import Replay
from footsense.ros2.bag import Bag, create_bag
from footsense.ros2.recorded_samples import RecordedCycleSamples, recorded_samples
from footsense.ros2.topics import DIAGNOSTICS_PERIOD_NS, FootFrame, TopicMessageBuilder


def write_bag(replay: Replay, folder: Path, frames: dict[str, FootFrame] | None = None) -> int:
    """Write a recording as a ROS 2 bag; return the number of cycles.

    A wrench for each new force, a contact state ten times a second and with each event, diagnostics once a second and
    with each change of a state.

    Args:
        replay: The recording.
        folder: The new folder.
        frames: Frames of the feet by leg, see `load_foot_frames`.

    Raises:
        RecordingError: The folder exists or cannot be written, or the recording is cut short; then what is whole was
            written.
    """
    topics = TopicMessageBuilder(replay.legs, frames)
    damage: RecordingError | None = None
    n_cycles = 0
    with create_bag(folder, topics) as bag:
        cycles = _CycleWriter(bag, topics)
        try:
            for cycle in recorded_samples(replay):
                cycles.add(cycle)
                n_cycles += 1
        except RecordingError as error:
            damage = error
    if damage is not None:
        raise damage
    return n_cycles


class _CycleWriter:
    """Writes the ROS 2 messages of each cycle to a bag."""

    def __init__(self, bag: Bag, topics: TopicMessageBuilder) -> None:
        self._bag, self._topics = bag, topics
        self._measured_ns: dict[str, int | None] = {}
        self._states: list[object] = []
        self._diagnosed_ns: int | None = None

    def add(self, cycle: RecordedCycleSamples) -> None:
        """Write the ROS 2 messages of one cycle to the bag."""
        t_ns, samples, has_gait = cycle
        if self._diagnosed_ns is None:
            for message in self._topics.transforms(t_ns):
                self._bag.add(message, t_ns)
        for sample in samples:
            if sample.t_wall_ns != self._measured_ns.get(sample.leg):
                self._measured_ns[sample.leg] = sample.t_wall_ns
                for message in self._topics.wrench(sample):
                    self._bag.add(message, t_ns)
            if has_gait:
                self._bag.add(self._topics.contact(sample), t_ns)
        states = [(sample.state, sample.cause) for sample in samples]
        if (
            self._diagnosed_ns is None
            or states != self._states
            or t_ns - self._diagnosed_ns >= DIAGNOSTICS_PERIOD_NS
        ):
            self._bag.add(self._topics.diagnostics(samples, t_ns), t_ns)
            self._states, self._diagnosed_ns = list(states), t_ns
