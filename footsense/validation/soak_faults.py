"""The faults of a soak: rows of the fault tables and of the disturbances' table, at random times, on random legs."""

from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from footsense.config import Config
from footsense.frames import ELEMENTS, ROWS
from footsense.sim.faults.scene_faults import ChannelsShifted, Disturbance, ElementDrifts, Fault
from footsense.validation.disturbance_table import DISTURBANCES
from footsense.validation.fault_table import CAN_FAULT_TRIALS, LEG_FAULT_TRIALS
from footsense.validation.fault_trial import WALK_SCENE

#: Mean time between the starts of two faults [s], and shortest and longest duration of a disturbance [s].
_MEAN_INTERVAL_S, _DISTURBED_S = 2.5, (0.5, 3.0)
#: Share of the disturbances that are of all legs [1].
_ALL_LEGS_REL = 0.5
#: Shares of rows of legs and their chips, of disturbances, and of CAN.
_SHARES = (0.5, 0.35, 0.15)


def soak_faults(rng: np.random.Generator, config: Config, from_s: float, until_s: float) -> tuple[Fault, ...]:
    """Return random rows of the tables, each as long as there, at independent random times; they may overlap.

    Args:
        rng: Source of randomness.
        config: The robot.
        from_s: Earliest start [s].
        until_s: Latest end [s].
    """
    tables = _rows(config.board)
    found: list[Fault] = []
    at_s = from_s
    while True:
        at_s = round(at_s + float(rng.exponential(_MEAN_INTERVAL_S)), 4)
        if at_s + _DISTURBED_S[1] >= until_s:
            return tuple(found)
        rows = tables[int(rng.choice(len(tables), p=_SHARES))]
        found += _moved(rng, rows[int(rng.integers(len(rows)))], config, at_s)


def _rows(board: str) -> tuple[list[tuple[Fault, ...]], ...]:
    """Return the faults of legs and their chips, disturbances, and faults of CAN that a board's robots have."""
    return (
        [
            trial.script
            for trial in LEG_FAULT_TRIALS
            if board in trial.boards and trial.has_reset and trial.effects == WALK_SCENE.effects
        ],
        # Channels that are shifted end with a reset: the table has no recovery from them.
        [
            script
            for script in DISTURBANCES.values()
            if script and isinstance(script[0], Disturbance) and not isinstance(script[0], ChannelsShifted)
        ],
        [(fault,) for fault in CAN_FAULT_TRIALS.values()],
    )


def _moved(rng: np.random.Generator, script: Sequence[Fault], config: Config, at_s: float) -> list[Fault]:
    """Return the faults of a row at another time, on other legs, elements and lines; a drift is taken back."""
    leg = str(rng.choice(config.legs))
    legs = config.legs if rng.random() < _ALL_LEGS_REL else (leg,)
    shift, bus = int(rng.integers(ELEMENTS)), int(rng.integers(len(config.buses)))
    disturbed_s = float(rng.uniform(*_DISTURBED_S))
    moved: list[Fault] = []
    for fault in script:
        fields: dict[str, Any] = {"at_s": at_s, "leg": leg, "legs": legs, "bus": bus}
        if hasattr(fault, "until_s"):
            lasts_s = disturbed_s if fault.until_s is None else fault.until_s - fault.at_s
            fields["until_s"] = round(at_s + lasts_s, 4)
        for name, n in (("element", ELEMENTS), ("row", ROWS), ("column", ROWS)):
            if hasattr(fault, name):
                fields[name] = (getattr(fault, name) + shift) % n
        kept = {name: value for name, value in fields.items() if name in fault.__struct_fields__}
        one = msgspec.structs.replace(fault, **kept)
        moved.append(one)
        if isinstance(one, ElementDrifts):
            end_s = fields["until_s"]
            back_s = round(2.0 * end_s - at_s, 4)
            back_ff_per_s = -one.rate_ff_per_s
            moved.append(
                msgspec.structs.replace(one, at_s=end_s, until_s=back_s, rate_ff_per_s=back_ff_per_s)
            )
    return moved
