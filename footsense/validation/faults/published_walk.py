"""The frames of a simulated walk with faults, one for each conversion.

Everything runs in virtual time: the same walk gives the same frames every time. The host costs nothing, so that the
number of transactions moves no conversion: an unaffected leg gives the same readings to the bit.
"""

from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from footsense.config import DEFAULT, Config
from footsense.daemon.service import open_service
from footsense.frames import Codes, ContactFrame, Cycle, Stamps, Vector
from footsense.ports import Observer
from footsense.sim.faults.scene_faults import Fault
from footsense.sim.scene import Scene
from footsense.sim.scene_effects import Effects
from footsense.sim.scene_loads import Tripod

#: Start of the fault, in the middle of the leg's stance, and end, in its next swing [s].
BREAKS_AT_S, PASSES_AT_S = 0.7, 1.2
DURATION_S = 2.6

WALK = Scene(
    description="Six legs walk with a fault.",
    load=Tripod(period_s=1.0, duty_rel=0.6, peak_force_n=1.0),
    lead_in_s=0.4,
    effects=Effects(converter_noise=True, gap_contact=True),
)

#: Fields of a frame that are kept.
_KEPT = ("t_sent_ns", "t_ns", "state", "cause", "fault_mask", "force_n", "sigma_n")


class PublishedWalk(NamedTuple):
    """Frames of one walk, shape (frames, legs, ...) each.

    Attributes:
        legs: Names of the legs.
        t_sent_ns: Time of sending [ns], shape (frames,).
        t_ns: Time of the newest readings [ns].
        state: `State` of each leg.
        cause: `Cause` of each leg.
        fault_mask: Elements that are not usable.
        force_n: Forces [N], NaN without one.
        sigma_n: Their standard deviations [N].
        true_force_n: True forces at the time of sending [N].
    """

    legs: tuple[str, ...]
    t_sent_ns: Stamps
    t_ns: Stamps
    state: Codes
    cause: Codes
    fault_mask: NDArray[np.uint16]
    force_n: Vector
    sigma_n: Vector
    true_force_n: Vector


class _Observer(Observer):
    """Keeps every frame of a walk."""

    def __init__(self) -> None:
        self.frames: list[ContactFrame] = []

    def observe(self, cycle: Cycle) -> None:
        self.frames.append(cycle.forces)


def walk(*faults: Fault, config: Config = DEFAULT, effects: Effects = WALK.effects) -> PublishedWalk:
    """Return the frames of a walk with faults.

    Raises:
        ConfigError: The robot has no such leg or bus.
        ModelError: The released network or the response table is missing.
    """
    observer = _Observer()
    scene = msgspec.structs.replace(WALK, faults=faults, effects=effects)
    with open_service(config, scene, real_time=False) as running:
        running.observers.append(observer)
        running.run(until_ns=DURATION_S * 1e9)
        true_force_at_time_n = running.true_force_at_time_n
        assert true_force_at_time_n is not None, "a scene is simulated"
        frames = observer.frames
        true_n = [true_force_at_time_n(frame.t_sent_ns) for frame in frames]
    arrays = {name: np.array([getattr(frame, name) for frame in frames]) for name in _KEPT}
    return PublishedWalk(legs=running.legs, true_force_n=np.array(true_n), **arrays)
