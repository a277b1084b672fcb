"""Random faults of every type that a scene can have, for long simulated walks."""

from typing import Any, get_args

import msgspec
import numpy as np

from footsense.frames import ELEMENTS
from footsense.sim.faults import scene_faults

#: Kinds of faults of a leg or its bus, of disturbances of readings, of faults of CAN, and the share of the latter.
ROBOT_FAULT_TYPES: tuple[type[scene_faults.Fault], ...] = get_args(
    scene_faults.ChipFault | scene_faults.FootDamage | scene_faults.WireFault
)
#: Kinds that only a board has that switches its rows.
_SWITCHED_FAULT_TYPES = (scene_faults.BrokenRow, scene_faults.SwitchIgnoresWrites)
DISTURBANCE_TYPES: tuple[type[scene_faults.Fault], ...] = get_args(scene_faults.Disturbance)
CAN_FAULT_TYPES: tuple[type[scene_faults.Fault], ...] = get_args(scene_faults.CanFault)
_CAN_FAULT_SHARE_REL = 0.2
#: Noise [fF], shifts and impulses up or down [fF], and tones [Hz]: from what is hardly seen to many times what a tare
#: allows.
MAX_NOISE_FF, MAX_AMPLITUDE_FF, MAX_FREQUENCY_HZ = 30.0, 200.0, 5_000.0
#: Shares of noise that all readings of a leg have in common.
COMMON_NOISE_RELS = (0.0, 0.8)
#: Bursts of noise: the drive of one phase of the gait [s].
_BURST_PERIOD_S, _BURST_S = 0.5, 0.15
#: Rates of lost acknowledges, corrupt reads and impulses.
READ_ERROR_RATES_REL = (0.01, 0.05, 0.3)
#: Largest rate of lost arbitrations; beyond, the bus belongs to the other master.
_MAX_ARBITRATION_LOSS_REL = 0.05
#: Ids of another node on CAN: above all of ours in priority, among them, and below.
OTHER_TRAFFIC_CAN_IDS = (0x000, 0x10B, 0x7FF)
#: More than a bus carries at 500 kbit/s.
_FLOODING_RATE_HZ = 5_000.0
#: Durations of a fault, and mean time between two starts [s].
_MIN_DURATION_S, _MAX_DURATION_S, _MEAN_INTERVAL_S = 0.05, 6.0, 30.0
#: Mean time between two starts in a short walk, over its duration [1].
_SHORT_WALK_INTERVAL_REL = 0.1


def robot_fault_types(board: str) -> tuple[type[scene_faults.Fault], ...]:
    """Return the kinds of faults that a leg with a board or its bus can have."""
    if board == "fdc1004":
        return ROBOT_FAULT_TYPES
    return tuple(kind for kind in ROBOT_FAULT_TYPES if kind not in _SWITCHED_FAULT_TYPES)


def random_faults(
    rng: np.random.Generator, legs: tuple[str, ...], from_s: float, until_s: float, board: str = "fdc1004"
) -> tuple[scene_faults.Fault, ...]:
    """Return random faults of 0.05 s to 6 s each, at independent random times; in a short walk closer together.

    Args:
        rng: Source of randomness.
        legs: Legs that may have a fault.
        from_s: Earliest start [s].
        until_s: Latest end [s].
        board: Board of the robot.
    """
    interval_s = min(_MEAN_INTERVAL_S, _SHORT_WALK_INTERVAL_REL * (until_s - from_s))
    script: list[scene_faults.Fault] = []
    at_s = from_s
    while True:
        at_s = round(at_s + rng.exponential(interval_s), 4)
        lasts_s = round(float(np.exp(rng.uniform(np.log(_MIN_DURATION_S), np.log(_MAX_DURATION_S)))), 4)
        if at_s + lasts_s >= until_s:
            return tuple(script)
        script += random_transient_fault(rng, str(rng.choice(legs)), at_s, lasts_s, board)


def random_transient_fault(
    rng: np.random.Generator, leg: str, at_s: float, lasts_s: float, board: str
) -> list[scene_faults.Fault]:
    """Return a random fault of any type that leaves no lasting effect; for a drifting element, two faults.

    Args:
        rng: Source of randomness.
        leg: The leg of a fault that is not of all legs.
        at_s: Start [s].
        lasts_s: Duration [s].
        board: Board of the robot.
    """
    of_legs = robot_fault_types(board) + DISTURBANCE_TYPES
    kinds = CAN_FAULT_TYPES if rng.random() < _CAN_FAULT_SHARE_REL else of_legs
    kind = kinds[int(rng.integers(len(kinds)))]
    return transient_fault(
        kind,
        leg=leg,
        at_s=at_s,
        until_s=round(at_s + lasts_s, 4),
        element=int(rng.integers(ELEMENTS)),
        row=int(rng.integers(3)),
        column=int(rng.integers(3)),
        rate_rel=float(rng.choice(READ_ERROR_RATES_REL)),
        rate_ff_per_s=float(rng.uniform(-800.0, 800.0)) / max(lasts_s, 1.0),
        unplugged=bool(rng.integers(2)),
        can_id=int(rng.choice(OTHER_TRAFFIC_CAN_IDS)),
        rate_hz=float(rng.uniform(1.0, 1800.0)),
        noise_ff=float(rng.uniform(1.0, MAX_NOISE_FF)),
        common_rel=float(rng.choice(COMMON_NOISE_RELS)),
        amplitude_ff=float(rng.uniform(-MAX_AMPLITUDE_FF, MAX_AMPLITUDE_FF)),
        frequency_hz=float(np.exp(rng.uniform(0.0, np.log(MAX_FREQUENCY_HZ)))),
    )


def transient_fault(kind: type[scene_faults.Fault], **values: Any) -> list[scene_faults.Fault]:  # noqa: ANN401 - a field of any fault
    """Return the default faults of a type, made to leave no lasting effect; a drift is reverted by a second fault.

    Args:
        kind: Class of the fault.
        values: Values of all fields that any fault has; others than those of the class are ignored.
    """
    if kind is scene_faults.CanQueueFull:
        values["rate_hz"] = _FLOODING_RATE_HZ
    if kind is scene_faults.ArbitrationLost:
        values["rate_rel"] = min(values["rate_rel"], _MAX_ARBITRATION_LOSS_REL)
    if kind in DISTURBANCE_TYPES:
        values |= {"legs": (values["leg"],), "period_s": _BURST_PERIOD_S, "active_s": _BURST_S}
    fault = kind(**{name: values[name] for name in kind.__struct_fields__ if name in values})
    if not isinstance(fault, scene_faults.ElementDrifts):
        return [fault]
    half_s = round(0.5 * (fault.at_s + values["until_s"]), 4)
    back = msgspec.structs.replace(
        fault, at_s=half_s, until_s=round(2.0 * half_s - fault.at_s, 4), rate_ff_per_s=-fault.rate_ff_per_s
    )
    return [msgspec.structs.replace(fault, until_s=half_s), back]
