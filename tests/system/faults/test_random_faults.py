"""Whatever breaks, wherever, whenever: the invariants hold in every cycle, and in the end all legs are back."""

from collections import Counter
from typing import get_args

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_interface.can.codes import NODE_IDS
from firmware_interface.can.commands import ANSWER, ANSWER_ID, COMMAND_ID, UNSOLICITED_COUNTER, encode_command
from firmware_interface.can.crc8 import kind_and_node
from firmware_interface.can.socketcan import pack_frame, unpack_frame
from footsense.config import SMALL_BOARD, Config
from footsense.daemon.service import open_service
from footsense.estimation.tare import MAX_WINDOWS, SETTLING_SCANS
from footsense.frames import ELEMENTS, USABLE, CommandKind, Cycle
from footsense.sim.can.interface import SimulatedCan
from footsense.sim.faults.scene_faults import CanBusOff, CanTraffic, Fault, Leg
from footsense.sim.scene import Effects, Scene
from footsense.sim.scene_loads import Tripod
from footsense.validation.invariants import InvariantChecker
from footsense.validation.random_faults import (
    CAN_FAULT_TYPES,
    COMMON_NOISE_RELS,
    DISTURBANCE_TYPES,
    MAX_AMPLITUDE_FF,
    MAX_FREQUENCY_HZ,
    MAX_NOISE_FF,
    OTHER_TRAFFIC_CAN_IDS,
    READ_ERROR_RATES_REL,
    ROBOT_FAULT_TYPES,
    transient_fault,
)
from footsense.validation.tolerances import WalkLimits
from tests.support.seen import Seen

#: Half of the legs in half of the time: one steps while the other two carry.
LEGS = ("lf", "lm", "rm")
SCENE = Scene(
    description="Three legs walk, and anything breaks.",
    load=Tripod(period_s=0.8, duty_rel=0.6, peak_force_n=0.9, friction_rel=0.15, pitch_deg=10.0),
    lead_in_s=0.4,
    gait_table=True,
    effects=Effects(converter_noise=True, gap_contact=True),
)
TARED_S, BREAKS_S = 1.2, 1.3
PERIOD_S = 0.0027
#: Standard deviations of a count that are chance, and neighbouring frames that count as one.
CHANCE, AS_ONE = 5.0, 20
#: Cycles until the answer to a TARE: its windows, the scans in which a step settles, and those that the frames wait.
LONGEST_ANSWER_CYCLES = ELEMENTS * (MAX_WINDOWS * SMALL_BOARD.tare.window_scans + SETTLING_SCANS + 2)

times = st.floats(BREAKS_S, 2.0).map(lambda t_s: round(t_s, 3))
lengths = st.floats(0.002, 0.6).map(lambda t_s: round(t_s, 3))


@st.composite
def faults(draw: st.DrawFn, kinds: tuple[type[Fault], ...]) -> list[Fault]:
    """A fault of any of some kinds, which passes."""
    at_s = draw(times)
    return transient_fault(
        draw(st.sampled_from(kinds)),
        leg=draw(st.sampled_from(LEGS)),
        at_s=at_s,
        until_s=round(at_s + draw(lengths), 3),
        element=draw(st.integers(0, 8)),
        row=draw(st.integers(0, 2)),
        column=draw(st.integers(0, 2)),
        rate_rel=draw(st.sampled_from(READ_ERROR_RATES_REL)),
        rate_ff_per_s=draw(st.floats(-800.0, 800.0)),
        unplugged=draw(st.booleans()),
        can_id=draw(st.sampled_from(OTHER_TRAFFIC_CAN_IDS)),
        rate_hz=draw(st.floats(1.0, 1800.0)),
        noise_ff=draw(st.floats(1.0, MAX_NOISE_FF)),
        common_rel=draw(st.sampled_from(COMMON_NOISE_RELS)),
        amplitude_ff=draw(st.floats(-MAX_AMPLITUDE_FF, MAX_AMPLITUDE_FF)),
        frequency_hz=draw(st.floats(1.0, MAX_FREQUENCY_HZ)),
    )


def scripts(*kinds: type[Fault]) -> st.SearchStrategy[list[Fault]]:
    """Up to six of them."""
    return st.lists(faults(kinds), max_size=6).map(lambda found: [fault for some in found for fault in some])


commands = st.tuples(st.floats(0.1, 2.5), st.sampled_from(LEGS), st.sampled_from(CommandKind))


class Consumer:
    """Another node that sends commands, and hears the answers; it observes the service to know the time.

    Attributes:
        waiting: Node, kind and counter of each command without an answer, and the cycle after which it was sent.
        slowest: Most cycles until an answer.
    """

    def __init__(self, can: SimulatedCan, script: list[tuple[float, str, CommandKind]]) -> None:
        self._can, self._script = can, sorted(script, reverse=True)
        self._counters = Counter[str]()
        self._n_cycles = 0
        self.waiting: dict[tuple[int, int, int], int] = {}
        self.slowest = 0
        can.controller.on_delivered = self.hear

    def observe(self, cycle: Cycle) -> None:
        self._n_cycles += 1
        while self._script and self._script[-1][0] * 1e9 <= cycle.forces.t_sent_ns:
            _, leg, kind = self._script.pop()
            node, counter = NODE_IDS[leg], self._counters[leg]
            self._counters[leg] += 1
            self.waiting[node, kind, counter] = self._n_cycles
            self._can.deliver_to_sockets(pack_frame(COMMAND_ID + node, encode_command(node, counter, kind)))

    def hear(self, _t_ns: int, _queued_ns: int, frame: bytes) -> None:
        can_id, data = unpack_frame(frame)
        if kind_and_node(can_id)[0] != ANSWER_ID:
            return
        answer = ANSWER.decode(can_id, data)
        if answer.command_counter != UNSOLICITED_COUNTER:
            sent = self.waiting.pop((answer.node, answer.command_kind, answer.command_counter))
            self.slowest = max(self.slowest, self._n_cycles - sent)

    def close(self) -> None: ...


def robot(publish_every: int) -> Config:
    return msgspec.structs.replace(
        SMALL_BOARD,
        buses=(msgspec.structs.replace(SMALL_BOARD.buses[0], legs={"lf": 0, "lm": 1, "rm": 4}),),
        publish_every=publish_every,
        can=msgspec.structs.replace(SMALL_BOARD.can, bitrate=1_000_000),
    )


def walk(publish_every: int, script: list[Fault]) -> InvariantChecker:
    """Walk until all that breaks is over and should be well again, and check all but how often errors are large."""
    config = robot(publish_every)
    script = [CanTraffic(at_s=0.0, can_id=0x7FF, rate_hz=1.0), *script]
    ends_s = max(getattr(fault, "until_s", None) or fault.at_s for fault in script)
    rules = WalkLimits(
        legs=LEGS,
        cycle_period_s=PERIOD_S,
        max_age_s=config.effective_max_age_ms * 1e-3,
        gait_period_s=0.8,
        checks_start_s=TARED_S,
        cycles_per_can_force=publish_every,
        bit_s=config.can.bit_ns * 1e-9,
    )
    scene = msgspec.structs.replace(SCENE, faults=tuple(script))
    with open_service(config, scene, real_time=False) as service:
        assert service.true_force_n_at is not None
        assert service.simulated_can is not None
        seen = InvariantChecker(rules, script, service.true_force_n_at)
        service.simulated_can.controller.on_delivered = seen.on_delivered
        ends_s = max(seen.recovered_s, ends_s + 2.1, TARED_S) + 0.1
        every = Seen()
        service.observers += [seen, every]
        service.run(until_ns=ends_s * 1e9)
    assert seen.violations == []
    assert set(every.cycles[-1].forces.state.tolist()) <= set(USABLE)
    return seen


def test_every_kind_of_fault_may_break() -> None:
    """None is forgotten when one is added."""
    drawn = ROBOT_FAULT_TYPES + DISTURBANCE_TYPES + CAN_FAULT_TYPES
    assert set(drawn) == set(get_args(Fault))
    assert set(LEGS) <= set(get_args(Leg))


@pytest.mark.slow
def test_a_full_queue_goes_out_after_a_bus_off() -> None:
    """16 frames are three forces of three legs: older by a force than with six legs."""
    walk(4, [CanBusOff(at_s=2.0, until_s=2.5)])


@pytest.mark.slow
@settings(max_examples=6, derandomize=True, database=None, deadline=None)
@given(scripts(*ROBOT_FAULT_TYPES, *DISTURBANCE_TYPES), st.lists(commands, min_size=3, max_size=9))
def test_every_command_has_one_answer_whatever_breaks(
    script: list[Fault], asked: list[tuple[float, str, CommandKind]]
) -> None:
    """Within the scans of a tare, and the frames that CAN has to send first."""
    scene = msgspec.structs.replace(SCENE, faults=(CanTraffic(at_s=0.0, can_id=0x7FF, rate_hz=1.0), *script))
    with open_service(robot(4), scene, real_time=False) as service:
        assert service.simulated_can is not None
        consumer = Consumer(service.simulated_can, asked)
        service.observers.append(consumer)
        service.run(until_ns=4_000_000_000)
    assert consumer.waiting == {}
    assert consumer.slowest <= LONGEST_ANSWER_CYCLES


@pytest.mark.parametrize(("publish_every", "n_walks"), [(4, 6), (1, 2)])
@pytest.mark.slow
def test_the_invariants_hold_whatever_breaks(publish_every: int, n_walks: int) -> None:
    """And no error is beyond 5 sigma more often than in walks in which nothing breaks."""
    calibrated = walk(publish_every, [])
    tally: list[InvariantChecker] = []

    @settings(max_examples=n_walks, derandomize=True, database=None, deadline=None)
    @given(scripts(*ROBOT_FAULT_TYPES, *DISTURBANCE_TYPES, *CAN_FAULT_TYPES))
    def whatever_breaks(script: list[Fault]) -> None:
        tally.append(walk(publish_every, script))

    whatever_breaks()
    n_checked = sum(seen.n_checked for seen in tally)
    expected = n_checked * calibrated.n_beyond / calibrated.n_checked
    n_beyond = np.sum([seen.n_beyond for seen in tally], axis=0)
    assert (n_beyond <= expected + CHANCE * np.sqrt(AS_ONE * np.maximum(expected, 1.0))).all()
