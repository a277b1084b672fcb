"""What feet are put through in the study `tradeoff`: walks, steps and ramps."""

from collections.abc import Callable
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np

from footsense.benchmarks.latency_vs_error.chain import Felt, pace
from footsense.benchmarks.latency_vs_error.errors import Truth
from footsense.frames import ELEMENTS, LEGS
from footsense.sim.loads.ground_load import Contact, Load, Ramp, Walk, measured_walk, smooth_step

#: Largest vertical force of a walk [N] and lean of its legs [deg].
PEAK_N, PITCH_DEG = 1.0, 10.0
#: What a foot is pressed with in steps and ramps [N], and how fast [ns].
PRESSES_N = ((0.0, 0.0, 0.8), (0.2, 0.1, 0.7), (-0.25, 0.1, 0.6), (0.1, -0.3, 0.7))
STEP_NS, RAMP_NS = 5_000_000, 200_000_000
#: When walks begin to count: every filter has filled by then [ns].
_WALK_FROM_NS = 1_100_000_000
#: When pressed feet begin to count, are pressed, and end to count [ns].
_COUNT_FROM_NS, _PRESS_NS, _COUNT_TO_NS = 200_000_000, 300_000_000, 800_000_000
#: Strides of the measured walk and of the tripod gait [ns].
_MEASURED_NS, _TRIPOD_NS = 1_145_000_000, 1_200_000_000
_TO_THE_LEFT = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


class Scene(NamedTuple):
    """A load, and the feet that it is tried on.

    Attributes:
        title: In words.
        truth: What the feet feel.
        begins_ns: When each begins to be pressed [ns]; None for a walk.
    """

    title: str
    truth: Truth
    begins_ns: tuple[int, ...] | None = None


def _walking(walk: Callable[[int], Walk], period_ns: int, strides: int, *, sideways: bool = False) -> Truth:
    """Return six legs of a walk, which have been walking for long, each at another place of its stride."""
    feet: list[Felt] = []
    for number, leg in enumerate(LEGS):
        begun = walk(-4 * period_ns - number * period_ns // len(LEGS))
        feet.append(partial(_sideways, begun, leg) if sideways else partial(begun.contact, leg))
    return Truth.of(feet, _WALK_FROM_NS, _WALK_FROM_NS + strides * period_ns)


def _pressed(title: str, rise_ns: int, n_phases: int) -> Scene:
    """Return feet that are pressed in several directions, at several phases of the scan."""
    scan_ns = ELEMENTS * pace(400).step_ns
    loads: list[Load] = []
    begins_ns = []
    for force_n, phase in product(PRESSES_N, range(n_phases)):
        begins_ns.append(_PRESS_NS + phase * scan_ns // n_phases)
        loads.append(Ramp(force_n, begins_ns[-1], rise_ns))
    feet: list[Felt] = [partial(load.contact, LEGS[0]) for load in loads]
    return Scene(title, Truth.of(feet, _COUNT_FROM_NS, _COUNT_TO_NS), tuple(begins_ns))


def _sideways(walk: Walk, leg: str, t_ns: int) -> Contact:
    """Return the contact of a foot that walks to its left instead of ahead."""
    (normal, force_n) = walk.contact(leg, t_ns)
    return Contact(_TO_THE_LEFT @ normal, _TO_THE_LEFT @ force_n)


def measured_truth(strides: int, *, sideways: bool = False) -> Truth:
    """Return what six feet feel on the measured walk."""
    return _walking(partial(measured_walk, PEAK_N, PITCH_DEG), _MEASURED_NS, strides, sideways=sideways)


def scenes(strides: int, phases: int) -> dict[str, Scene]:
    """Return the loads of the main table, by name.

    Args:
        strides: Strides that are counted.
        phases: Phases of a scan at which a foot is pressed.
    """
    duty_rel = 0.6
    reactions = dict.fromkeys(LEGS, smooth_step(duty_rel, PEAK_N, 0.15))
    tripod = partial(Walk, reactions, _TRIPOD_NS, duty_rel, PITCH_DEG)
    return {
        "measured_walk": Scene("Measured walk", measured_truth(strides)),
        "sideways": Scene(
            "The same to the left: legs lean along the columns", measured_truth(strides, sideways=True)
        ),
        "tripod": Scene("Tripod gait with rounded stances", _walking(tripod, _TRIPOD_NS, strides)),
        "step": _pressed("A step: all of the load within 5 ms", STEP_NS, phases),
        "ramp": _pressed("A ramp: all of the load within 200 ms", RAMP_NS, phases),
    }
