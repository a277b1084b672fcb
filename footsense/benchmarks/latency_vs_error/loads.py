"""True loads of the study `tradeoff`: walks, steps and ramps."""

from collections.abc import Callable
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np

from footsense.benchmarks.latency_vs_error.chain import FootLoad, conversion_timing
from footsense.benchmarks.latency_vs_error.latency_and_errors import TrueLoads
from footsense.frames import ELEMENTS, LEGS
from footsense.sim.loads.ground_load import GroundContact, RampContact
from footsense.sim.loads.measured_walk import measured_walk
from footsense.sim.loads.walk import Walk, smooth_stance_reaction

#: Largest vertical force of a walk [N] and lean of its legs [deg].
PEAK_N, PITCH_DEG = 1.0, 10.0
#: Forces of steps and ramps [N], and their rise times [ns].
PRESS_FORCES_N = ((0.0, 0.0, 0.8), (0.2, 0.1, 0.7), (-0.25, 0.1, 0.6), (0.1, -0.3, 0.7))
STEP_NS, RAMP_NS = 5_000_000, 200_000_000
#: Start of the counted time of a walk: the windows have filled by then [ns].
_WALK_EVALUATION_START_NS = 1_100_000_000
#: Start of the counted time of steps and ramps, start of the first load, end of the counted time [ns].
_COUNT_FROM_NS, _PRESS_NS, _COUNT_TO_NS = 200_000_000, 300_000_000, 800_000_000
#: Strides of the measured walk and of the tripod gait [ns].
_MEASURED_NS, _TRIPOD_NS = 1_145_000_000, 1_200_000_000
_DUTY_FACTOR = 0.6
_ROTATION_90_DEG = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


class TradeoffLoad(NamedTuple):
    """True loads of some feet, with title and start times of the loads.

    Attributes:
        title: Heading of its table.
        truth: True loads of the feet.
        load_starts_ns: Start of the load of each foot [ns]; None for a walk.
    """

    title: str
    truth: TrueLoads
    load_starts_ns: tuple[int, ...] | None = None


def _walk_loads(
    walk: Callable[[int], Walk], period_ns: int, strides: int, *, sideways: bool = False
) -> TrueLoads:
    """Return the true loads of six feet in a steady walk, each at another phase of the stride."""
    feet: list[FootLoad] = []
    for number, leg in enumerate(LEGS):
        contact = partial(walk(-4 * period_ns - number * period_ns // len(LEGS)).contact, leg)
        feet.append(partial(_contact_turned_left, contact) if sideways else contact)
    return TrueLoads.sample(feet, _WALK_EVALUATION_START_NS, _WALK_EVALUATION_START_NS + strides * period_ns)


def _contact_turned_left(contact: FootLoad, t_ns: int) -> GroundContact:
    """Return a foot's ground contact rotated 90 degrees to the left, as in a sideways walk."""
    return GroundContact(*(_ROTATION_90_DEG @ vector for vector in contact(t_ns)))


def _press_case(title: str, rise_ns: int, n_phases: int) -> TradeoffLoad:
    """Return the true loads of feet pressed in several directions, at several phases of the scan."""
    scan_ns = ELEMENTS * conversion_timing(400).step_ns
    cases = [
        (force_n, _PRESS_NS + phase * scan_ns // n_phases)
        for force_n, phase in product(PRESS_FORCES_N, range(n_phases))
    ]
    feet = [partial(RampContact(force_n, start_ns, rise_ns).contact, LEGS[0]) for force_n, start_ns in cases]
    return TradeoffLoad(
        title, TrueLoads.sample(feet, _COUNT_FROM_NS, _COUNT_TO_NS), tuple(start_ns for _, start_ns in cases)
    )


def measured_walk_truth(strides: int, *, sideways: bool = False) -> TrueLoads:
    """Return the true loads of six feet on the measured walk, over a number of strides."""
    return _walk_loads(partial(measured_walk, PEAK_N, PITCH_DEG), _MEASURED_NS, strides, sideways=sideways)


def load_cases(strides: int, phases: int) -> dict[str, TradeoffLoad]:
    """Return the load cases of the study's main tables, by name.

    Args:
        strides: Strides that are counted.
        phases: Phases of a scan at which a foot is pressed.
    """
    reactions = dict.fromkeys(LEGS, smooth_stance_reaction(_DUTY_FACTOR, PEAK_N, 0.15))
    tripod = partial(Walk, reactions, _TRIPOD_NS, _DUTY_FACTOR, PITCH_DEG)
    sideways = measured_walk_truth(strides, sideways=True)
    return {
        "measured_walk": TradeoffLoad("Measured walk", measured_walk_truth(strides)),
        "sideways": TradeoffLoad("Measured walk to the left: legs lean along the columns", sideways),
        "tripod": TradeoffLoad("Tripod gait with rounded stances", _walk_loads(tripod, _TRIPOD_NS, strides)),
        "step": _press_case("A step: full load within 5 ms", STEP_NS, phases),
        "ramp": _press_case("A ramp: full load within 200 ms", RAMP_NS, phases),
    }
