"""What the service makes of the motions of the legs: taken, rejected, over."""

import math
from collections.abc import Iterator

import can
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_interface.can.codes import StepPhase
from firmware_interface.can.gait import LEG_MOTION, LEG_MOTION_ID, LegMotionFrame
from footsense.can.interface import Can
from footsense.can.motions import TIMEOUT_NS, CanMotions
from footsense.can.sink import CanSink
from footsense.client import Motions
from footsense.frames import CanStatistics, LegMotion
from footsense.wires.opening import open_wire
from tests.support.can_robot import MS, FakeClock, Robot

NODES = (1, 6)
UP = (0.0, 0.6, 0.8)


def frame(node: int, counter: int, acceleration: float = 2.5, sigma: float = 0.32) -> tuple[int, bytes]:
    """Return id and data of a motion."""
    content = LegMotionFrame(node, counter, StepPhase.SWING, acceleration, sigma, UP)
    return LEG_MOTION_ID + node, LEG_MOTION.encode(content)


class Receiver:
    """The motions of two legs, on a clock that stands until it is set."""

    def __init__(self) -> None:
        self.clock, self.stats = FakeClock(), CanStatistics()
        self.motions = CanMotions(NODES, self.clock, self.stats)

    def at(self, t_ms: int, *frames: tuple[int, bytes]) -> LegMotion | None:
        """Return what is new at a time, after some frames."""
        self.clock.t_ns = t_ms * MS
        self.motions.take(frames)
        return self.motions.pop_new()


@pytest.fixture
def receiver() -> Receiver:
    return Receiver()


def test_the_newest_of_each_leg_counts_and_is_told_once(receiver: Receiver) -> None:
    """Whatever was lost between; of a leg that tells nothing all is unknown."""
    assert receiver.at(0) is None
    motion = receiver.at(7, frame(6, 3, 1.0), frame(6, 9, -2.5))
    assert motion is not None
    assert motion.t_ns.tolist() == [0, 7 * MS]
    assert motion.acceleration_m_per_s2.tolist() == pytest.approx([math.nan, -2.5], nan_ok=True)
    assert motion.sigma_m_per_s2.tolist() == pytest.approx([math.nan, 0.32], nan_ok=True)
    assert motion.up[1].tolist() == pytest.approx(UP)
    assert np.isnan(motion.up[0]).all()
    assert motion.phase.tolist() == [StepPhase.UNKNOWN, StepPhase.SWING]
    assert receiver.at(8) is None
    assert (receiver.stats.received_motions, receiver.stats.rejected_motions) == (2, 0)


def test_a_motion_that_no_other_follows_is_unknown_after_50_ms(receiver: Receiver) -> None:
    """Each leg's by itself, and told once; one that comes again starts anew, whatever its counter."""
    receiver.at(0, frame(1, 4), frame(6, 4))
    receiver.at(30, frame(6, 5))
    assert receiver.at(50) is None
    over = receiver.at(51)
    assert over is not None
    assert over.t_ns.tolist() == [0, 30 * MS]
    assert math.isnan(over.acceleration_m_per_s2[0])
    assert over.phase[0] == StepPhase.UNKNOWN
    assert receiver.at(52) is None
    again = receiver.at(60, frame(1, 4))
    assert again is not None
    assert again.t_ns[0] == 60 * MS


def test_what_is_damaged_or_repeated_is_rejected_and_does_not_renew(receiver: Receiver) -> None:
    """A wrong crc, another leg's frame under this id, too few bytes, a sender that hangs, no unit vector."""
    can_id, data = frame(1, 4)
    receiver.at(0, (can_id, data))
    level = LegMotionFrame(1, 5, StepPhase.SWING, 0.0, 1.0, (0.9, 0.9, math.nan))
    bad = [
        (can_id, bytes([data[0] ^ 1]) + data[1:]),
        (can_id, frame(6, 5)[1]),
        (can_id, data[:7]),
        (can_id, data),
        (can_id, LEG_MOTION.encode(level)),
    ]
    assert receiver.at(40, *bad) is None
    assert (receiver.stats.received_motions, receiver.stats.rejected_motions) == (6, 5)
    assert receiver.at(51) is not None


@pytest.mark.parametrize(("acceleration", "sigma"), [(math.nan, 0.3), (2.0, math.nan)])
def test_an_acceleration_and_its_sigma_are_known_together(
    receiver: Receiver, acceleration: float, sigma: float
) -> None:
    motion = receiver.at(0, frame(1, 0, acceleration, sigma))
    assert motion is not None
    assert np.isnan([motion.acceleration_m_per_s2[0], motion.sigma_m_per_s2[0]]).all()
    assert motion.up[0].tolist() == pytest.approx(UP)


@given(
    st.lists(
        st.tuples(st.integers(0, 80), st.sampled_from(NODES), st.integers(0, 14), st.booleans()), max_size=30
    )
)
def test_no_motion_is_older_than_its_time(traffic: list[tuple[int, int, int, bool]]) -> None:
    """Whatever comes and is lost, damaged or repeated: the last told is that of accepted frames of the last 50 ms."""
    receiver, t_ms = Receiver(), 1
    nan = np.full(2, math.nan)
    told = LegMotion(np.zeros(2, np.int64), nan, nan, np.full((2, 3), math.nan), np.zeros(2, np.uint8))
    newest: dict[int, tuple[int, int]] = {}
    for step_ms, node, counter, is_whole in traffic:
        t_ms += step_ms
        can_id, data = frame(node, counter)
        told = receiver.at(t_ms, (can_id, data if is_whole else data[:-1])) or told
        newest = {n: last for n, last in newest.items() if t_ms - last[1] <= TIMEOUT_NS // MS}
        if is_whole and newest.get(node, (-1, 0))[0] != counter:
            newest[node] = counter, t_ms
        assert told.t_ns.tolist() == [newest.get(n, (0, 0))[1] * MS for n in NODES]
        assert (np.isnan(told.acceleration_m_per_s2) == (told.t_ns == 0)).all()


def test_motions_go_to_the_loop_beside_the_commands(robot: Robot) -> None:
    """Only those of legs that the robot has."""
    motions = Motions()
    for node in (1, 6):
        can_id, data = motions.encode(node, acceleration_m_per_s2=1.0, sigma_m_per_s2=0.1, up=UP)
        robot.ask(data, can_id)
    assert robot.sink.commands() == []
    motion = robot.sink.new_motion()
    assert motion is not None
    assert motion.acceleration_m_per_s2.tolist() == [1.0]
    assert robot.sink.new_motion() is None
    stats = robot.sink.stats
    assert (stats.received_motions, stats.rejected_motions, stats.received_commands) == (1, 0, 0)


@pytest.fixture
def deaf(request: pytest.FixtureRequest) -> Iterator[tuple[CanSink, can.BusABC]]:
    """Yield the sink of a robot that executes no commands, and another program's bus."""
    settings = Can(interface="virtual", channel=request.node.nodeid, commands=False)
    with can.Bus(interface="virtual", channel=request.node.nodeid) as other:
        sink = CanSink(settings, ("lf",), FakeClock(), connect=lambda: open_wire(settings.address))
        yield sink, other
        sink.close()


def test_who_executes_no_commands_takes_no_motions(deaf: tuple[CanSink, can.BusABC]) -> None:
    """Every program on this computer can send them, and what they say changes what a foot is said to do."""
    sink, other = deaf
    can_id, data = frame(1, 0)
    other.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))
    assert sink.commands() == []
    assert sink.new_motion() is None
    assert (sink.stats.received_motions, sink.stats.rejected_motions) == (1, 1)


@pytest.mark.parametrize("up", [(0.0, 0.6, 0.7), (0.0, 0.6, -0.8), (1.2, 0.0, 0.0)])
def test_a_client_sends_no_direction_that_is_none(up: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="up: a unit vector"):
        Motions().encode(1, up=up)
