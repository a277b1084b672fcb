"""Effect of one fault on a simulated walk: on the legs, and for a fault of CAN on a consumer of its frames.

Everything runs in virtual time: the same walk gives the same frames every time. The host costs nothing, so that the
number of transactions moves no conversion: an unaffected leg gives the same readings to the bit.
"""

import itertools
import math
from collections import Counter
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from firmware_interface.can.codes import NODE_IDS
from firmware_interface.can.force import FORCE_ID
from firmware_interface.can.socketcan import unpack_frame
from footsense.config import DEFAULT, Config
from footsense.daemon.service import open_service
from footsense.frames import (
    IS_USABLE_STATE,
    Cause,
    Codes,
    ContactFrame,
    Cycle,
    GaitEvent,
    Stamps,
    State,
    Vector,
)
from footsense.ports import Observer
from footsense.sim.faults.scene_faults import CanFault, Fault, Leg
from footsense.sim.scene import Effects, Scene
from footsense.sim.scene_loads import Tripod

#: Start of the fault, in the middle of the leg's stance, and end, in its next swing [s].
BREAKS_AT_S, PASSES_AT_S = 0.7, 1.2
DURATION_S = 2.6

LOAD = Tripod(period_s=1.0, duty_rel=0.6, peak_force_n=1.0)
WALK_SCENE = Scene(
    description="Six legs walk with a fault.",
    load=LOAD,
    lead_in_s=0.4,
    effects=Effects(converter_noise=True, gap_contact=True),
)

#: Fields of a frame that are kept.
_KEPT_FRAME_FIELDS = ("t_sent_ns", "t_ns", "state", "cause", "flags", "fault_mask", "force_n", "sigma_n")


class PublishedWalk(NamedTuple):
    """Published frames and true forces of one simulated walk, shape (frames, legs, ...) each.

    Attributes:
        legs: Names of the legs.
        t_sent_ns: Time of sending [ns], shape (frames,).
        t_ns: Time of the newest readings [ns].
        state: `State` of each leg.
        cause: `Cause` of each leg.
        flags: `Flag` of each leg.
        fault_mask: Elements that are not usable.
        force_n: Forces [N], NaN without one.
        sigma_n: Their standard deviations [N].
        true_force_n: True forces at the time of sending [N].
        events: Gait events, each with the row of the frame that has it.
    """

    legs: tuple[str, ...]
    t_sent_ns: Stamps
    t_ns: Stamps
    state: Codes
    cause: Codes
    flags: Codes
    fault_mask: NDArray[np.uint16]
    force_n: Vector
    sigma_n: Vector
    true_force_n: Vector
    events: list[tuple[int, GaitEvent]]


class _FrameCollector(Observer):
    """Observer that stores every published force frame of a walk."""

    def __init__(self) -> None:
        self.frames: list[ContactFrame] = []

    def observe(self, cycle: Cycle) -> None:
        """Store the published frame of a cycle."""
        self.frames.append(cycle.forces)


def simulate_walk(
    *faults: Fault, config: Config = DEFAULT, effects: Effects = WALK_SCENE.effects, load: Tripod = LOAD
) -> PublishedWalk:
    """Simulate a walk with faults; return its published frames.

    Args:
        faults: As in a scene.
        config: The robot, with its feet.
        effects: Effects of the simulation.
        load: The walk.

    Raises:
        ConfigError: The robot has no such leg or bus.
        ModelError: The released network or the response table is missing.
    """
    scene = msgspec.structs.replace(WALK_SCENE, load=load, faults=faults, effects=effects)
    return simulate_scene(scene, config, DURATION_S)


def simulate_scene(scene: Scene, config: Config, duration_s: float) -> PublishedWalk:
    """Simulate a scene; return its published frames.

    Args:
        scene: The scene.
        config: The robot, with its feet.
        duration_s: Length of it [s].

    Raises:
        ConfigError: The robot has no leg or bus that a fault names.
        ModelError: The released network or the response table is missing.
    """
    observer = _FrameCollector()
    with open_service(config, scene, real_time=False) as running:
        running.observers.append(observer)
        running.run(until_ns=duration_s * 1e9)
        true_force_n_at = running.true_force_n_at
        assert true_force_n_at is not None, "a scene is simulated"
        frames = observer.frames
        true_n = [true_force_n_at(frame.t_sent_ns) for frame in frames]
    arrays = {name: np.array([getattr(frame, name) for frame in frames]) for name in _KEPT_FRAME_FIELDS}
    events = [(row, event) for row, frame in enumerate(frames) if frame.gait for event in frame.gait.events]
    return PublishedWalk(legs=running.legs, true_force_n=np.array(true_n), events=events, **arrays)


#: The leg with the fault.
FAULTY_LEG: Leg = "rm"


class FaultFigures(NamedTuple):
    """Effect of a fault on a walk: reported state and cause, detection and recovery time [s], force errors.

    Attributes:
        state: State of the leg in the second half of the fault; VALID if it never shows.
        cause: Cause that the leg reported.
        fault_mask: Elements that it reported.
        detection_s: Time from the fault to the first frame that shows it [s]; None if none does.
        recovery_s: Time from its end until the forces of the leg stay valid [s]; None if they do not, or if it never
            showed.
        longest_gap_s: Longest time between two forces of any other leg from the fault on [s].
        n_other_legs_lost_frames: Frames that the other legs lost.
        max_error_sigmas: Largest error of the leg's forces over their sigma while the fault shows [1]; None without a
            force.
        other_legs_max_error_n: Largest error of the forces of the other legs from the fault on [N].
    """

    state: State
    cause: Cause
    fault_mask: int
    detection_s: float | None
    recovery_s: float | None
    longest_gap_s: float
    n_other_legs_lost_frames: int
    max_error_sigmas: float | None
    other_legs_max_error_n: float


def fault_figures(
    faulty: PublishedWalk, fault_free: PublishedWalk, start_s: float, end_s: float | None
) -> FaultFigures:
    """Return the effect of a fault of the leg `FAULTY_LEG`, against the walk without faults.

    Args:
        faulty: The walk with the fault.
        fault_free: The same walk without it.
        start_s: Start of the fault [s].
        end_s: End of the fault [s]; None if it stays.
    """
    row = faulty.legs.index(FAULTY_LEG)
    others = [number for number in range(len(faulty.legs)) if number != row]
    t_s = faulty.t_sent_ns * 1e-9
    shows = (faulty.state[:, row] != State.VALID) & (t_s > start_s)
    last_s = DURATION_S if end_s is None else end_s
    lasting = shows & (t_s <= last_s)
    settled = lasting & (t_s > start_s + 0.5 * (last_s - start_s))
    lasting = next((frames for frames in (settled, lasting) if frames.any()), shows)
    showing = np.flatnonzero(shows)
    recovered = bool(len(showing)) and not shows[-1]
    over_s = start_s if end_s is None else end_s
    error_n = np.abs(faulty.force_n - faulty.true_force_n)
    affected = shows & IS_USABLE_STATE[faulty.state[:, row]]
    over_sigma = error_n[affected, row] / faulty.sigma_n[affected, row]
    return FaultFigures(
        state=State(most_frequent_code(faulty.state[lasting, row], State.VALID)),
        cause=Cause(
            most_frequent_code(faulty.cause[lasting & (faulty.cause[:, row] != Cause.NONE), row], Cause.NONE)
        ),
        fault_mask=most_frequent_code(faulty.fault_mask[lasting, row], 0),
        detection_s=float(t_s[showing[0]] - start_s) if len(showing) else None,
        recovery_s=max(float(t_s[showing[-1] + 1] - over_s), 0.0) if recovered else None,
        longest_gap_s=max(_longest_gap_s(faulty, number, start_s) for number in others),
        n_other_legs_lost_frames=len(fault_free.t_sent_ns) - len(t_s),
        max_error_sigmas=float(over_sigma.max()) if affected.any() else None,
        other_legs_max_error_n=float(np.nanmax(error_n[t_s > start_s][:, others])),
    )


def most_frequent_code(values: NDArray[np.unsignedinteger], otherwise: int) -> int:
    """Return the most frequent code, or `otherwise` without values."""
    return int(Counter(values.tolist()).most_common(1)[0][0]) if len(values) else int(otherwise)


def _longest_gap_s(walked: PublishedWalk, row: int, from_s: float) -> float:
    """Return the longest time between two usable forces of a leg, after a start time [s]."""
    usable = IS_USABLE_STATE[walked.state[:, row]]
    t_s = walked.t_sent_ns[usable] * 1e-9
    before = t_s[t_s <= from_s][-1:]
    ends = np.concatenate((before, t_s[t_s > from_s], walked.t_sent_ns[-1:] * 1e-9))
    return float(np.diff(ends).max())


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
