"""One fault of the CAN bus in a walk: what a consumer heard, and how soon all was well again. In virtual time."""

import itertools
from typing import NamedTuple

import msgspec

from firmware_interface.can_codes import NODE_IDS
from firmware_interface.can_frames import FORCE_ID
from firmware_interface.socketcan import split_frames
from footsense.config import DEFAULT, Config
from footsense.daemon.service import open_service
from footsense.frames import Cycle
from footsense.sim.faults.scene_faults import CanFault
from footsense.sim.scene import Scene, Tripod

__all__ = ["CanFigures", "can_trial"]

WALK = Scene(
    description="Six legs walk, and CAN breaks.",
    load=Tripod(period_s=1.0, duty_rel=0.6, peak_force_n=1.0),
    lead_in_s=0.4,
)


class CanFigures(NamedTuple):
    """What a consumer at the other end of the bus noticed of a fault.

    Attributes:
        heard_rel: Part of all Force frames that it heard [1].
        longest_silence_s: Longest time between two of one leg [s].
        back_after_s: From the end of the fault until it had heard every leg again [s]; None if the fault does not
            end, or if a leg stays silent.
        worst_wait_s: Longest that one was on its way [s].
        worst_age_s: Oldest measurement in one when it came [s].
        n_dropped: Frames that the sink could not hand over.
        n_bus_off: How often the controller went bus-off.
    """

    heard_rel: float
    longest_silence_s: float
    back_after_s: float | None
    worst_wait_s: float
    worst_age_s: float
    n_dropped: int
    n_bus_off: int


class _Consumer:
    """Notes when each force was published, and when it came."""

    def __init__(self, legs: tuple[str, ...]) -> None:
        self._nodes = [NODE_IDS[leg] for leg in legs]
        self._measured_ns: dict[int, dict[int, int]] = {}  # by time of sending, by node
        self.came_ns: dict[int, list[int]] = {node: [] for node in self._nodes}
        self.n_published = 0
        self.worst_wait_ns = 0
        self.worst_age_ns = 0

    def observe(self, cycle: Cycle) -> None:
        forces = cycle.forces
        self.n_published += len(self._nodes)
        self._measured_ns[forces.t_sent_ns] = dict(zip(self._nodes, forces.t_ns.tolist(), strict=True))

    def close(self) -> None:
        pass

    def hear(self, t_ns: int, handed_ns: int, frame: bytes) -> None:
        can_id, _ = next(split_frames(frame))
        node = can_id - FORCE_ID
        if node in self.came_ns:
            self.came_ns[node].append(t_ns)
            self.worst_wait_ns = max(self.worst_wait_ns, t_ns - handed_ns)
            if measured_ns := self._measured_ns[handed_ns][node]:
                self.worst_age_ns = max(self.worst_age_ns, t_ns - measured_ns)


def can_trial(fault: CanFault, *, duration_s: float, config: Config = DEFAULT) -> CanFigures:
    """Return what becomes of the forces of a walk in which something breaks on CAN.

    Args:
        fault: What, and when.
        duration_s: Length of the walk [s].
        config: The robot.

    Raises:
        CanError: The interface is down from the start.
        ModelError: The released network or the response table is missing.
    """
    consumer = _Consumer(config.legs)
    with open_service(config, msgspec.structs.replace(WALK, faults=(fault,)), real_time=False) as robot:
        assert robot.can is not None, "the scene names a fault of CAN"
        controller = robot.can.controller
        controller.hear = consumer.hear
        robot.observers.append(consumer)
        clock = robot.scan_source.clock
        robot.run(lambda: clock.now_ns() > duration_s * 1e9)
        n_dropped = robot.sink.stats.dropped
    came_ns = consumer.came_ns.values()
    again_ns = [next((t_ns for t_ns in times_ns if t_ns > fault.until_ns), None) for times_ns in came_ns]
    back_ns = [t_ns for t_ns in again_ns if t_ns is not None]
    return CanFigures(
        heard_rel=sum(map(len, came_ns)) / consumer.n_published,
        longest_silence_s=max(
            after_ns - before_ns
            for times_ns in came_ns
            for before_ns, after_ns in itertools.pairwise(times_ns)
        )
        / 1e9,
        back_after_s=(max(back_ns) - fault.until_ns) / 1e9 if len(back_ns) == len(again_ns) else None,
        worst_wait_s=consumer.worst_wait_ns / 1e9,
        worst_age_s=consumer.worst_age_ns / 1e9,
        n_dropped=n_dropped,
        n_bus_off=controller.n_bus_off,
    )
