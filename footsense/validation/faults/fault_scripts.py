"""All faults of a scene as trials: scripts of one walk each."""

from collections.abc import Callable
from typing import Any, NamedTuple

import msgspec

from footsense.config import DEFAULT, Config
from footsense.config.sections import Mux
from footsense.sim.faults import scene_faults as faults
from footsense.sim.faults.scene_faults import CanFault, Fault
from footsense.validation.faults.fault_trial import LEG
from footsense.validation.faults.published_walk import BREAKS_AT_S, PASSES_AT_S


class FaultTrial(NamedTuple):
    """A row of the table.

    Attributes:
        words: The fault in words.
        script: The fault as in a scene.
        config: The robot.
        adapter_timeout_ms: Timeout of the adapter for a held line [ms].
    """

    words: str
    script: tuple[Fault, ...]
    config: Config = DEFAULT
    adapter_timeout_ms: float = 20.0

    @property
    def until_s(self) -> float | None:
        """End of the fault [s]; None for a permanent or a momentary fault."""
        return max((getattr(fault, "until_s", None) or 0.0 for fault in self.script), default=0.0) or None


_WITHOUT_RESET = msgspec.structs.replace(
    DEFAULT, buses=tuple(msgspec.structs.replace(bus, mux=Mux()) for bus in DEFAULT.buses)
)
_LOOSE_REL = 0.02
_BUS_STUCK_S = 0.1
_SPAN: dict[str, Any] = {"at_s": BREAKS_AT_S, "until_s": PASSES_AT_S}


def _on_leg(kind: Callable[..., Fault], **values: float) -> tuple[Fault, ...]:
    return (kind(leg=LEG, **_SPAN, **values),)


_STUCK_SDA = _on_leg(faults.StuckSda)

TRIALS = (
    FaultTrial("cable off and on", _on_leg(faults.Absent)),
    FaultTrial("2 % of the acknowledges lost", _on_leg(faults.NackAtRandom, rate_rel=_LOOSE_REL)),
    FaultTrial("a wrong bit in 2 % of the answers", _on_leg(faults.CorruptReads, rate_rel=_LOOSE_REL)),
    FaultTrial("conversions never finish", _on_leg(faults.StuckConverter)),
    FaultTrial("another chip at the address", _on_leg(faults.WrongChip)),
    FaultTrial("supply dips: all settings lost", (faults.BrownOut(leg=LEG, at_s=BREAKS_AT_S),)),
    FaultTrial("row switch ignores writes", _on_leg(faults.SwitchIgnoresWrites)),
    FaultTrial("SDA held low by the leg", _STUCK_SDA),
    FaultTrial("the same, RESET pin not wired", _STUCK_SDA, config=_WITHOUT_RESET),
    FaultTrial("the same with RESET, adapter waits 1 s", _STUCK_SDA, adapter_timeout_ms=1000.0),
    FaultTrial(
        "SDA held low on the upstream bus, 0.1 s",
        (faults.StuckUpstreamBus(at_s=BREAKS_AT_S, until_s=BREAKS_AT_S + _BUS_STUCK_S),),
    ),
    FaultTrial(
        "2 % of the arbitrations lost", (faults.ArbitrationLost(at_s=BREAKS_AT_S, rate_rel=_LOOSE_REL),)
    ),
    FaultTrial("mux reset", (faults.MuxReset(at_s=BREAKS_AT_S),)),
    FaultTrial("element open", _on_leg(faults.ElementOpen, element=4)),
    FaultTrial("element shorted", _on_leg(faults.ElementShorted, element=0)),
    FaultTrial("element stuck", _on_leg(faults.ElementStuck, element=0)),
    FaultTrial("element drifts, 0.5 pF/s", _on_leg(faults.ElementDrifts, element=0, rate_ff_per_s=500.0)),
    FaultTrial("gap full of water", _on_leg(faults.GapClosed, element=5)),
    FaultTrial("row line broken", _on_leg(faults.BrokenRow, row=1)),
    FaultTrial("column line broken", _on_leg(faults.BrokenColumn, column=1)),
    FaultTrial("two row lines broken", _on_leg(faults.BrokenRow, row=0) + _on_leg(faults.BrokenRow, row=2)),
)

CAN_TRIALS: dict[str, CanFault] = {
    "no acknowledge": faults.CanNoAck(**_SPAN),
    "high and low shorted: bus-off": faults.CanBusOff(**_SPAN),
    "interface down and up": faults.CanDown(**_SPAN),
    "adapter unplugged, and new": faults.CanDown(unplugged=True, **_SPAN),
    "another program floods the queue": faults.CanQueueFull(**_SPAN),
    "1000 frames/s before ours": faults.CanTraffic(rate_hz=1000.0, **_SPAN),
}
