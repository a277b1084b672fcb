"""One fault in a walk: what was shown, how soon, when it was over, and what the other legs noticed of it.

Everything is in virtual time, so that the same trial gives the same figures every time. The host costs nothing, so
that a transaction more or less moves no conversion: a leg that is untouched gives the same forces to the bit.
"""

from collections import Counter
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from footsense.config import DEFAULT, Config
from footsense.daemon.service import open_service
from footsense.frames import USABLE, Cause, Cycle, State
from footsense.sim.faults.scene_faults import Fault
from footsense.sim.scene import Effects, Scene, Tripod

#: The leg on which something breaks.
LEG = "rm"
#: It breaks in the middle of the leg's stance, and if it passes, it does so in the next swing [s].
BREAKS_AT_S, PASSES_AT_S = 0.7, 1.2
DURATION_S = 2.6

WALK = Scene(
    description="Six legs walk, and something breaks.",
    load=Tripod(period_s=1.0, duty_rel=0.6, peak_force_n=1.0),
    lead_in_s=0.4,
    effects=Effects(converter_noise=True, gap_contact=True),
)

_USABLE = [int(state) for state in USABLE]


class Walk(NamedTuple):
    """What was published in one walk, shape (frames, legs, ...) each.

    Attributes:
        legs: Names of the legs.
        t_sent_ns: When each frame was sent [ns], shape (frames,).
        t_ns: Time that its forces belong to [ns].
        state: `State` of each leg.
        cause: `Cause` of each leg.
        fault_mask: Elements that are not usable.
        force_n: Forces [N], NaN where there is none.
        sigma_n: Their standard deviations [N].
        true_force_n: What each foot felt at `t_ns` [N].
    """

    legs: tuple[str, ...]
    t_sent_ns: NDArray[np.int64]
    t_ns: NDArray[np.int64]
    state: NDArray[np.uint8]
    cause: NDArray[np.uint8]
    fault_mask: NDArray[np.uint16]
    force_n: NDArray[np.float64]
    sigma_n: NDArray[np.float64]
    true_force_n: NDArray[np.float64]


class Figures(NamedTuple):
    """What became of a fault.

    Attributes:
        state: State of the leg in the second half of the fault; VALID if it never shows.
        cause: What the leg named as its cause.
        fault_mask: Elements that it named.
        shown_after_s: From the fault until the first frame that shows it [s]; None if none does.
        recovered_after_s: From its end until the leg's forces are valid again for good [s]; None if they are not, or
            if nothing was shown.
        worst_gap_s: Longest time between two forces of any other leg from the fault on [s].
        lost_frames: Frames that the other legs have lost.
        worst_error_sigma: Largest error of the leg's forces over their sigma while it lasts [1]; None without any.
        others_worst_n: Largest error of the other legs' forces [N] from the fault on.
    """

    state: State
    cause: Cause
    fault_mask: int
    shown_after_s: float | None
    recovered_after_s: float | None
    worst_gap_s: float
    lost_frames: int
    worst_error_sigma: float | None
    others_worst_n: float


class _Watch:
    """Keeps every cycle of a walk."""

    def __init__(self) -> None:
        self.cycles: list[Cycle] = []

    def observe(self, cycle: Cycle) -> None:
        self.cycles.append(cycle)

    def close(self) -> None:
        pass


def walk(*faults: Fault, config: Config = DEFAULT, effects: Effects = WALK.effects) -> Walk:
    """Return what is published in a walk in which something may break.

    Raises:
        ConfigError: The robot has no such leg or bus.
        ModelError: The released network or the response table is missing.
    """
    watch = _Watch()
    scene = msgspec.structs.replace(WALK, faults=faults, effects=effects)
    with open_service(config, scene, real_time=False) as running:
        scan_source = running.scan_source
        running.observers.append(watch)
        running.run(lambda: scan_source.clock.now_ns() > DURATION_S * 1e9)
        assert scan_source.true_force_n is not None, "a scene is simulated"
        forces = [cycle.forces for cycle in watch.cycles]
        true_force_n = [
            [scan_source.true_force_n(int(t_ns))[row] for row, t_ns in enumerate(frame.t_ns)]
            for frame in forces
        ]
    return Walk(
        legs=running.legs,
        t_sent_ns=np.array([frame.t_sent_ns for frame in forces]),
        t_ns=np.array([frame.t_ns for frame in forces]),
        state=np.array([frame.state for frame in forces]),
        cause=np.array([frame.cause for frame in forces]),
        fault_mask=np.array([frame.fault_mask for frame in forces]),
        force_n=np.array([frame.force_n for frame in forces]),
        sigma_n=np.array([frame.sigma_n for frame in forces]),
        true_force_n=np.array(true_force_n),
    )


def figures(broken: Walk, whole: Walk, begins_s: float, ends_s: float | None, leg: str = LEG) -> Figures:
    """Return what became of a fault.

    Args:
        broken: The walk with it.
        whole: The same walk without.
        begins_s: When it happens [s].
        ends_s: When it is over [s]; None if it is for good.
        leg: Where.
    """
    row = broken.legs.index(leg)
    others = [number for number in range(len(broken.legs)) if number != row]
    t_s = broken.t_sent_ns * 1e-9
    shows = (broken.state[:, row] != State.VALID) & (t_s > begins_s)
    lasting = shows & (t_s <= (DURATION_S if ends_s is None else ends_s))
    settled = lasting & (t_s > begins_s + 0.5 * ((DURATION_S if ends_s is None else ends_s) - begins_s))
    lasting = next((frames for frames in (settled, lasting) if frames.any()), shows)
    after_s = t_s[shows]
    over_s = begins_s if ends_s is None else ends_s
    recovered = bool(len(after_s)) and not shows[-1]
    error_n = np.abs(broken.force_n - broken.true_force_n)
    own = (t_s > begins_s) & np.isin(broken.state[:, row], _USABLE)
    affected = own & shows
    return Figures(
        state=State(_usual(broken.state[lasting, row], State.VALID)),
        cause=Cause(_usual(broken.cause[lasting & (broken.cause[:, row] != Cause.NONE), row], Cause.NONE)),
        fault_mask=_usual(broken.fault_mask[lasting, row], 0),
        shown_after_s=float(after_s[0] - begins_s) if len(after_s) else None,
        recovered_after_s=max(float(t_s[np.flatnonzero(shows)[-1] + 1] - over_s), 0.0) if recovered else None,
        worst_gap_s=max(_worst_gap_s(broken, number, begins_s) for number in others),
        lost_frames=len(whole.t_sent_ns) - len(t_s),
        worst_error_sigma=(
            float((error_n[affected, row] / broken.sigma_n[affected, row]).max()) if affected.any() else None
        ),
        others_worst_n=float(np.nanmax(error_n[t_s > begins_s][:, others])),
    )


def _usual(values: NDArray[np.unsignedinteger], otherwise: int) -> int:
    """Return the value that occurs most often."""
    return int(Counter(values.tolist()).most_common(1)[0][0]) if len(values) else int(otherwise)


def _worst_gap_s(walked: Walk, row: int, from_s: float) -> float:
    """Return the longest time between two usable forces of a leg from the last one before a time on [s]."""
    usable = np.isin(walked.state[:, row], _USABLE)
    t_s = walked.t_sent_ns[usable] * 1e-9
    before = t_s[t_s <= from_s][-1:]
    ends = np.concatenate((before, t_s[t_s > from_s], walked.t_sent_ns[-1:] * 1e-9))
    return float(np.diff(ends).max())
