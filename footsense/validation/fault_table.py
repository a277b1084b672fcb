"""Every fault that a scene can have, each in a walk of its own: what CAN showed of it, and what it cost the others."""

from collections.abc import Callable
from typing import Any, NamedTuple

import msgspec
import numpy as np

from footsense.config import DEFAULT, Config, Mux
from footsense.sim.faults import scene_faults
from footsense.sim.faults.scene_faults import CanFault, Fault
from footsense.validation.can_trial import CanFigures, can_trial
from footsense.validation.fault_trial import (
    BREAKS_AT_S,
    LEG,
    PASSES_AT_S,
    WALK,
    Figures,
    Walk,
    figures,
    walk,
)

__all__ = ["CAN_TRIALS", "TRIALS", "CanTrial", "Trial", "can_rows", "rows"]

#: How long a trial of CAN is [s]: the kernel looks after a carrier once a second, ours opens the interface in as much.
_CAN_WALK_S = 4.0
#: Rows of the quick table: each `n`-th.
_QUICK = 6


class Trial(NamedTuple):
    """One row of the table.

    Attributes:
        words: What breaks.
        script: The same as a scene has it.
        config: The robot.
        adapter_timeout_ms: How long an adapter waits for a line that is held [ms].
    """

    words: str
    script: tuple[Fault, ...]
    config: Config = DEFAULT
    adapter_timeout_ms: float = 20.0

    @property
    def until_s(self) -> float | None:
        """When it is over [s]; None if it is for good, or for a moment."""
        return max((getattr(fault, "until_s", None) or 0.0 for fault in self.script), default=0.0) or None


class CanTrial(NamedTuple):
    """One row of the table of CAN: what breaks, in words and as a scene has it."""

    words: str
    fault: CanFault


_WITHOUT_RESET = msgspec.structs.replace(
    DEFAULT, buses=tuple(msgspec.structs.replace(bus, mux=Mux()) for bus in DEFAULT.buses)
)
_LOOSE_REL = 0.02
_TRUNK_HELD_S = 0.1


def _passing(kind: Callable[..., Fault], **values: float) -> tuple[Fault, ...]:
    return (kind(leg=LEG, at_s=BREAKS_AT_S, until_s=PASSES_AT_S, **values),)


_AT: dict[str, Any] = {"leg": LEG, "at_s": BREAKS_AT_S}

TRIALS = (
    Trial("cable off and on", _passing(scene_faults.Absent)),
    Trial("2 % of the acknowledges lost", _passing(scene_faults.NackAtRandom, rate_rel=_LOOSE_REL)),
    Trial("a wrong bit in 2 % of the answers", _passing(scene_faults.CorruptReads, rate_rel=_LOOSE_REL)),
    Trial("conversions never finish", _passing(scene_faults.StuckConverter)),
    Trial("another chip at the address", _passing(scene_faults.WrongChip)),
    Trial("supply dips: all settings lost", (scene_faults.BrownOut(**_AT),)),
    Trial("row switch deaf", _passing(scene_faults.SwitchIgnoresWrites)),
    Trial("SDA held low by the leg", _passing(scene_faults.StuckSda)),
    Trial("the same, RESET pin not wired", _passing(scene_faults.StuckSda), config=_WITHOUT_RESET),
    Trial(
        "the same with RESET, adapter waits 1 s", _passing(scene_faults.StuckSda), adapter_timeout_ms=1000.0
    ),
    Trial(
        "SDA held low on the trunk, 0.1 s",
        (scene_faults.StuckUpstreamBus(at_s=BREAKS_AT_S, until_s=BREAKS_AT_S + _TRUNK_HELD_S),),
    ),
    Trial(
        "2 % of the arbitrations lost", (scene_faults.ArbitrationLost(at_s=BREAKS_AT_S, rate_rel=_LOOSE_REL),)
    ),
    Trial("mux forgets its channels", (scene_faults.MuxReset(at_s=BREAKS_AT_S),)),
    Trial("element open", _passing(scene_faults.ElementOpen, element=4)),
    Trial("element shorted", _passing(scene_faults.ElementShorted, element=0)),
    Trial("element stuck", _passing(scene_faults.ElementStuck, element=0)),
    Trial("element drifts, 0.5 pF/s", _passing(scene_faults.ElementDrifts, element=0, rate_ff_per_s=500.0)),
    Trial("gap full of water", _passing(scene_faults.GapClosed, element=5)),
    Trial("row line broken", _passing(scene_faults.BrokenRow, row=1)),
    Trial("column line broken", _passing(scene_faults.BrokenColumn, column=1)),
    Trial(
        "two row lines broken",
        _passing(scene_faults.BrokenRow, row=0) + _passing(scene_faults.BrokenRow, row=2),
    ),
)

_CAN_SPAN: dict[str, Any] = {"at_s": BREAKS_AT_S, "until_s": PASSES_AT_S}
CAN_TRIALS = (
    CanTrial("nobody acknowledges", scene_faults.CanNoAck(**_CAN_SPAN)),
    CanTrial("high and low shorted: bus-off", scene_faults.CanBusOff(**_CAN_SPAN)),
    CanTrial("interface down and up", scene_faults.CanDown(**_CAN_SPAN)),
    CanTrial("adapter unplugged, and new", scene_faults.CanDown(unplugged=True, **_CAN_SPAN)),
    CanTrial("another program floods the queue", scene_faults.CanQueueFull(**_CAN_SPAN)),
    CanTrial("1000 frames/s before ours", scene_faults.CanTraffic(rate_hz=1000.0, **_CAN_SPAN)),
)


def rows(say: Callable[[str], None], *, quick: bool = False) -> list[tuple[Trial, Figures]]:
    """Walk with nothing that breaks, then with each fault of legs, buses and feet, and return what became of it.

    Args:
        say: Told what has just been done.
        quick: Whether only a few are walked.

    Raises:
        ModelError: The released network or the response table is missing.
    """
    whole = walk()
    found = [(Trial("nothing", ()), _of_nothing(whole))]
    for trial in TRIALS[::_QUICK] if quick else TRIALS:
        effects = msgspec.structs.replace(WALK.effects, adapter_timeout_ms=trial.adapter_timeout_ms)
        broken = walk(*trial.script, config=trial.config, effects=effects)
        found.append((trial, figures(broken, whole, BREAKS_AT_S, trial.until_s)))
        say(trial.words)
    return found


def _of_nothing(whole: Walk) -> Figures:
    """Return the figures of a walk in which nothing breaks, with the leg's largest error over its sigma."""
    row = whole.legs.index(LEG)
    late = whole.t_sent_ns > BREAKS_AT_S * 1e9
    over_sigma = np.abs(whole.force_n - whole.true_force_n)[late, row] / whole.sigma_n[late, row]
    return figures(whole, whole, BREAKS_AT_S, None)._replace(worst_error_sigma=float(over_sigma.max()))


def can_rows(say: Callable[[str], None], *, quick: bool = False) -> list[tuple[CanTrial, CanFigures]]:
    """Walk with each fault of CAN, and return what a consumer noticed; arguments as of `rows`."""
    found = []
    for trial in CAN_TRIALS[::_QUICK] if quick else CAN_TRIALS:
        found.append((trial, can_trial(trial.fault, duration_s=_CAN_WALK_S)))
        say(trial.words)
    return found
