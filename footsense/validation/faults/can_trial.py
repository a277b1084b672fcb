"""Simulated walk with one fault of the CAN bus: frames that a consumer received, and time to recovery."""

import itertools
import math
from typing import NamedTuple

import msgspec

from firmware_interface.can.codes import NODE_IDS
from firmware_interface.can.force import FORCE_ID
from firmware_interface.can.socketcan import unpack_frame
from footsense.config import DEFAULT
from footsense.daemon.service import open_service
from footsense.frames import Cycle
from footsense.ports import Observer
from footsense.sim.faults.scene_faults import CanFault
from footsense.sim.scene import Effects
from footsense.validation.faults.fault_trial import WALK_SCENE


class CanFigures(NamedTuple):
    """Effect of one CAN fault on a consumer: fraction of frames received, silences, delays, recovery time.

    Attributes:
        received_share: Share of all Force frames that it received [1].
        longest_silence_s: Longest time between two of one leg [s].
        recovery_s: Time from the end of the fault until it received every leg again [s]; None if the fault stays, or
            if a leg stays silent.
        longest_frame_delay_s: Longest time of a frame from the kernel to the consumer [s].
        max_age_on_arrival_s: Largest age of a measurement on its arrival [s].
        n_dropped_before_sending: Frames that the sink could not hand over.
        n_bus_off: Times that the controller went bus-off.
    """

    received_share: float
    longest_silence_s: float
    recovery_s: float | None
    longest_frame_delay_s: float
    max_age_on_arrival_s: float
    n_dropped_before_sending: int
    n_bus_off: int


class _Consumer(Observer):
    """Observer that records when forces were measured and when the consumer received them."""

    def __init__(self, legs: tuple[str, ...]) -> None:
        self.measured_ns: dict[int, dict[int, int]] = {}  # by time of sending, by node
        self.received_ns: dict[int, list[int]] = {NODE_IDS[leg]: [] for leg in legs}
        self.longest_delay_ns = 0
        self.oldest_ns = 0

    def observe(self, cycle: Cycle) -> None:
        """Record the measurement times of a cycle."""
        forces = cycle.forces
        self.measured_ns[forces.t_sent_ns] = dict(zip(self.received_ns, forces.t_ns.tolist(), strict=True))

    def on_delivered(self, t_ns: int, queued_ns: int, frame: bytes) -> None:
        """Record the arrival of a frame."""
        node = unpack_frame(frame)[0] - FORCE_ID
        if node in self.received_ns:
            self.received_ns[node].append(t_ns)
            self.longest_delay_ns = max(self.longest_delay_ns, t_ns - queued_ns)
            if measured_ns := self.measured_ns[queued_ns][node]:
                self.oldest_ns = max(self.oldest_ns, t_ns - measured_ns)


def can_trial(fault: CanFault, *, duration_s: float) -> CanFigures:
    """Simulate a walk with a CAN fault; return its effect on what a consumer receives.

    Args:
        fault: The fault.
        duration_s: Length of the walk [s].

    Raises:
        CanError: The interface is down from the start.
        ModelError: The released network or the response table is missing.
    """
    consumer = _Consumer(DEFAULT.legs)
    scene = msgspec.structs.replace(WALK_SCENE, effects=Effects(), faults=(fault,))
    with open_service(DEFAULT, scene, real_time=False) as robot:
        assert robot.simulated_can is not None, "the scene has a fault of CAN"
        controller = robot.simulated_can.controller
        controller.on_delivered = consumer.on_delivered
        robot.observers.append(consumer)
        robot.run(until_ns=duration_s * 1e9)
        stats = robot.sink.stats
    received_ns = consumer.received_ns.values()
    again_ns = [
        min((t_ns for t_ns in of_leg if t_ns > fault.until_ns), default=math.inf) for of_leg in received_ns
    ]
    silences_ns = [after - before for of_leg in received_ns for before, after in itertools.pairwise(of_leg)]
    return CanFigures(
        received_share=sum(map(len, received_ns)) / (stats.published_cycles * len(received_ns)),
        longest_silence_s=max(silences_ns) / 1e9,
        recovery_s=(max(again_ns) - fault.until_ns) / 1e9 if math.isfinite(max(again_ns)) else None,
        longest_frame_delay_s=consumer.longest_delay_ns / 1e9,
        max_age_on_arrival_s=consumer.oldest_ns / 1e9,
        n_dropped_before_sending=stats.dropped,
        n_bus_off=controller.n_bus_off,
    )
