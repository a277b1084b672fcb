"""Table of all faults of a scene: one simulated walk each, with its report on CAN and its effect on other legs."""

from collections.abc import Callable
from functools import partial
from itertools import islice
from typing import Any, NamedTuple

import msgspec
import numpy as np

from footsense.config import DEFAULT, SMALL_BOARD, Config
from footsense.config.sections import Mux
from footsense.sim.faults import scene_faults as faults
from footsense.sim.faults.scene_faults import CanFault, Fault
from footsense.sim.scene import Effects
from footsense.sim.scene_loads import Tripod
from footsense.validation.fault_trial import (
    BREAKS_AT_S,
    FAULTY_LEG,
    LOAD,
    PASSES_AT_S,
    WALK_SCENE,
    CanFigures,
    FaultFigures,
    PublishedWalk,
    can_trial,
    fault_figures,
    simulate_walk,
)

#: Robots of the table, by their board.
ROBOTS: dict[str, Config] = {robot.board: robot for robot in (DEFAULT, SMALL_BOARD)}


class FaultTrial(NamedTuple):
    """One row of the fault table: description, faults, robots.

    Attributes:
        description: The fault in words.
        script: The fault as in a scene.
        boards: The boards that can have it, keys of `ROBOTS`.
        has_reset: Whether the RESET pins of the multiplexers are wired.
        effects: Effects of the simulation.
    """

    description: str
    script: tuple[Fault, ...]
    boards: tuple[str, ...] = tuple(ROBOTS)
    has_reset: bool = True
    effects: Effects = WALK_SCENE.effects

    @property
    def fault_end_s(self) -> float | None:
        """End of the fault [s]; None for a permanent or a momentary fault."""
        return max((getattr(fault, "until_s", None) or 0.0 for fault in self.script), default=0.0) or None

    def robot(self, board: str) -> Config:
        """Return the robot of a board."""
        robot = ROBOTS[board]
        if self.has_reset:
            return robot
        buses = tuple(msgspec.structs.replace(bus, mux=Mux()) for bus in robot.buses)
        return msgspec.structs.replace(robot, buses=buses)


_TRANSFER_FAULT_PROBABILITY = 0.02
_BUS_STUCK_DURATION_S = 0.1
#: Boards of a robot of the table that switches rows, and has a multiplexer.
_SWITCHED = (SMALL_BOARD.board,)
_FAULT_SPAN: dict[str, Any] = {"at_s": BREAKS_AT_S, "until_s": PASSES_AT_S}


def _faults_on_trial_leg(kind: Callable[..., Fault], **values: float) -> tuple[Fault, ...]:
    """Return a tuple with one fault of a type on the tested leg."""
    return (kind(leg=FAULTY_LEG, **_FAULT_SPAN, **values),)


_SLOW_ADAPTER = msgspec.structs.replace(WALK_SCENE.effects, adapter_timeout_ms=1000.0)

#: A hang, and that of each kind of FDC1004, which the scanner ends with a reset.
_HANG_TRIALS = tuple(
    FaultTrial(
        f"converter hangs until it is reset{kind}",
        (faults.HungConverter(leg=FAULTY_LEG, at_s=BREAKS_AT_S),),
        boards=_SWITCHED if names else tuple(ROBOTS),
        effects=msgspec.structs.replace(WALK_SCENE.effects, **dict.fromkeys(names, True)),
    )
    for kind, *names in (
        ("",),
        ("; DONE needs both reads", "done_needs_both_reads"),
        ("; the old result stays", "keeps_old_result"),
        ("; both of that", "done_needs_both_reads", "keeps_old_result"),
    )
)
_STUCK_SDA_FAULTS = _faults_on_trial_leg(faults.StuckSda)

LEG_FAULT_TRIALS = (
    FaultTrial("cable off and on", _faults_on_trial_leg(faults.Absent)),
    FaultTrial(
        "2 % of the acknowledges lost",
        _faults_on_trial_leg(faults.NackAtRandom, rate_rel=_TRANSFER_FAULT_PROBABILITY),
    ),
    FaultTrial(
        "a wrong bit in 2 % of the answers",
        _faults_on_trial_leg(faults.CorruptReads, rate_rel=_TRANSFER_FAULT_PROBABILITY),
    ),
    FaultTrial("conversions never finish", _faults_on_trial_leg(faults.StuckConverter)),
    *_HANG_TRIALS,
    FaultTrial("another chip at the address", _faults_on_trial_leg(faults.WrongChip)),
    FaultTrial("supply dips: all settings lost", (faults.BrownOut(leg=FAULTY_LEG, at_s=BREAKS_AT_S),)),
    FaultTrial("row switch ignores writes", _faults_on_trial_leg(faults.SwitchIgnoresWrites), _SWITCHED),
    FaultTrial("SDA held low by the leg", _STUCK_SDA_FAULTS),
    FaultTrial("the same, RESET pin not wired", _STUCK_SDA_FAULTS, _SWITCHED, has_reset=False),
    FaultTrial("the same with RESET, adapter waits 1 s", _STUCK_SDA_FAULTS, _SWITCHED, effects=_SLOW_ADAPTER),
    FaultTrial(
        "SDA held low on the upstream bus, 0.1 s",
        (faults.StuckUpstreamBus(at_s=BREAKS_AT_S, until_s=BREAKS_AT_S + _BUS_STUCK_DURATION_S),),
    ),
    FaultTrial(
        "2 % of the arbitrations lost",
        (faults.ArbitrationLost(at_s=BREAKS_AT_S, rate_rel=_TRANSFER_FAULT_PROBABILITY),),
    ),
    FaultTrial("mux reset", (faults.MuxReset(at_s=BREAKS_AT_S),), _SWITCHED),
    FaultTrial("mux keeps its channels", (faults.MuxKeepsChannels(**_FAULT_SPAN),), _SWITCHED),
    FaultTrial("element open", _faults_on_trial_leg(faults.ElementOpen, element=4)),
    FaultTrial("element shorted", _faults_on_trial_leg(faults.ElementShorted, element=0)),
    FaultTrial("element stuck", _faults_on_trial_leg(faults.ElementStuck, element=0)),
    FaultTrial(
        "element drifts, 0.5 pF/s", _faults_on_trial_leg(faults.ElementDrifts, element=0, rate_ff_per_s=500.0)
    ),
    FaultTrial("gap full of water", _faults_on_trial_leg(faults.GapClosed, element=5)),
    FaultTrial("row line broken", _faults_on_trial_leg(faults.BrokenRow, row=1), _SWITCHED),
    FaultTrial("column line broken", _faults_on_trial_leg(faults.BrokenColumn, column=1)),
    FaultTrial(
        "two row lines broken",
        _faults_on_trial_leg(faults.BrokenRow, row=0) + _faults_on_trial_leg(faults.BrokenRow, row=2),
        _SWITCHED,
    ),
    FaultTrial(
        "element shorted, another stuck",
        _faults_on_trial_leg(faults.ElementShorted, element=0)
        + _faults_on_trial_leg(faults.ElementStuck, element=8),
    ),
)

CAN_FAULT_TRIALS: dict[str, CanFault] = {
    "no acknowledge": faults.CanNoAck(**_FAULT_SPAN),
    "high and low shorted: bus-off": faults.CanBusOff(**_FAULT_SPAN),
    "interface down and up": faults.CanDown(**_FAULT_SPAN),
    "adapter unplugged, and new": faults.CanDown(unplugged=True, **_FAULT_SPAN),
    "another program floods the queue": faults.CanQueueFull(**_FAULT_SPAN),
    "1000 frames/s before ours": faults.CanTraffic(rate_hz=1000.0, **_FAULT_SPAN),
}


#: Length of a walk with a fault of CAN [s]: the kernel checks a carrier once a second, and the daemon opens the
#: interface again as often.
_CAN_WALK_DURATION_S = 4.0
#: Step between the rows of the quick table.
_QUICK_EVERY_NTH_TRIAL = 6


def simulate_leg_faults(
    report: Callable[[str], None],
    board: str = DEFAULT.board,
    *,
    quick: bool = False,
    foot_type: str = DEFAULT.foot_type,
    load: Tripod = LOAD,
) -> dict[str, FaultFigures]:
    """Simulate a walk without faults and one per fault of legs, buses and feet; return the effects by description.

    Args:
        report: Called with the words of each row as it is complete.
        board: Board of the robot, a key of `ROBOTS`.
        quick: Whether only every sixth fault is walked.
        foot_type: The feet, as in a configuration.
        load: The walk.

    Raises:
        ModelError: The feet's network or response table is missing.
    """
    of_feet = partial(msgspec.structs.replace, foot_type=foot_type)
    whole = simulate_walk(config=of_feet(ROBOTS[board]), load=load)
    found = {"nothing": _fault_free_figures(whole)}
    trials = [trial for trial in LEG_FAULT_TRIALS if board in trial.boards]
    for trial in trials[:: _QUICK_EVERY_NTH_TRIAL if quick else 1]:
        config = of_feet(trial.robot(board))
        broken = simulate_walk(*trial.script, config=config, effects=trial.effects, load=load)
        found[trial.description] = fault_figures(broken, whole, BREAKS_AT_S, trial.fault_end_s)
        report(trial.description)
    return found


def _fault_free_figures(whole: PublishedWalk) -> FaultFigures:
    """Return the figures of the walk without faults; its error is the leg's largest error over its sigma."""
    row = whole.legs.index(FAULTY_LEG)
    late = whole.t_sent_ns > BREAKS_AT_S * 1e9
    over_sigma = np.abs(whole.force_n - whole.true_force_n)[late, row] / whole.sigma_n[late, row]
    return fault_figures(whole, whole, BREAKS_AT_S, None)._replace(max_error_sigmas=float(over_sigma.max()))


def simulate_can_faults(report: Callable[[str], None], *, quick: bool = False) -> dict[str, CanFigures]:
    """Simulate one walk per CAN fault; return the effects by description; see `simulate_leg_faults`."""
    found = {}
    for description, fault in islice(
        CAN_FAULT_TRIALS.items(), None, None, _QUICK_EVERY_NTH_TRIAL if quick else 1
    ):
        found[description] = can_trial(fault, duration_s=_CAN_WALK_DURATION_S)
        report(description)
    return found
