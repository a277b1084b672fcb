"""Faults at random, of every kind that a scene can have, for walks that are long enough to meet them all."""

from typing import Any, get_args

import msgspec
import numpy as np

from footsense.frames import ELEMENTS
from footsense.sim.faults.scene_faults import (
    ArbitrationLost,
    CanFault,
    CanQueueFull,
    ElementDrifts,
    Fault,
    OnChips,
    OnFoot,
    OnWires,
)

#: Kinds that strike a leg or its bus, and kinds that strike CAN; how often it is one of the latter.
ON_ROBOT: tuple[type[Fault], ...] = get_args(OnChips | OnFoot | OnWires)
ON_CAN: tuple[type[Fault], ...] = get_args(CanFault)
_SHARE_OF_CAN = 0.2
#: Grades of a loose contact, and of noise on a line.
GRADES_REL = (0.01, 0.05, 0.3)
#: Another master wins no more often; beyond, a bus is no longer ours.
_MOST_CONTENDED_REL = 0.05
#: Ids of another node on CAN: before all of ours, among them, and behind them.
IDS = (0x000, 0x183, 0x7FF)
#: More than a bus takes at 500 kbit/s.
_FLOOD_HZ = 5_000.0
_SHORTEST_S, _LONGEST_S = 0.05, 6.0


def random_faults(
    rng: np.random.Generator, legs: tuple[str, ...], from_s: float, until_s: float, every_s: float = 30.0
) -> tuple[Fault, ...]:
    """Return faults that last 0.05 s to 6 s, at times that know nothing of each other.

    Args:
        rng: Where chance comes from.
        legs: Legs that may be struck.
        from_s: Time of the first at the earliest [s].
        until_s: When the last has ended [s].
        every_s: Mean time from one to the next [s].
    """
    script: list[Fault] = []
    at_s = from_s
    while True:
        at_s = round(at_s + rng.exponential(every_s), 4)
        lasts_s = round(float(np.exp(rng.uniform(np.log(_SHORTEST_S), np.log(_LONGEST_S)))), 4)
        if at_s + lasts_s >= until_s:
            return tuple(script)
        script += random_fault(rng, str(rng.choice(legs)), at_s, lasts_s)


def random_fault(rng: np.random.Generator, leg: str, at_s: float, lasts_s: float) -> list[Fault]:
    """Return a fault of any kind, as `fault_of` does.

    Args:
        rng: Where chance comes from.
        leg: The leg that it strikes, unless it strikes them all.
        at_s: When it begins [s].
        lasts_s: How long it lasts [s].
    """
    kinds = ON_CAN if rng.random() < _SHARE_OF_CAN else ON_ROBOT
    kind = kinds[int(rng.integers(len(kinds)))]
    return fault_of(
        kind,
        leg=leg,
        at_s=at_s,
        until_s=round(at_s + lasts_s, 4),
        element=int(rng.integers(ELEMENTS)),
        row=int(rng.integers(3)),
        column=int(rng.integers(3)),
        rate_rel=float(rng.choice(GRADES_REL)),
        rate_ff_per_s=float(rng.uniform(-800.0, 800.0)) / max(lasts_s, 1.0),
        unplugged=bool(rng.integers(2)),
        can_id=int(rng.choice(IDS)),
        rate_hz=float(rng.uniform(1.0, 1800.0)),
    )


def fault_of(kind: type[Fault], **values: Any) -> list[Fault]:  # noqa: ANN401 - a field of any fault
    """Return a fault that is over in the end: two for an element that drifts, the second back to where it was.

    Args:
        kind: Which.
        values: Every field that a fault may have; those that this one has are taken.
    """
    if kind is CanQueueFull:
        values["rate_hz"] = _FLOOD_HZ
    if kind is ArbitrationLost:
        values["rate_rel"] = min(values["rate_rel"], _MOST_CONTENDED_REL)
    fault = kind(**{name: values[name] for name in kind.__struct_fields__ if name in values})
    if not isinstance(fault, ElementDrifts):
        return [fault]
    half_s = round(0.5 * (fault.at_s + values["until_s"]), 4)
    back = msgspec.structs.replace(
        fault, at_s=half_s, until_s=round(2.0 * half_s - fault.at_s, 4), rate_ff_per_s=-fault.rate_ff_per_s
    )
    return [msgspec.structs.replace(fault, until_s=half_s), back]
