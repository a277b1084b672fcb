"""Feet that are heard on CAN: what a real sink sends on a channel of the process, as a program gets it."""

import asyncio
import contextlib
import errno
import math
import os
import queue
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing

import pytest

import footsense
from footsense.client import LinkLimits
from footsense.client.commander import Commander
from footsense.client.feet import Feet
from footsense.client.listener import Listener
from footsense.errors import CanError, FootsenseError
from footsense.frames import Flag, GaitEvent, GaitEventKind, State
from footsense.wires.address import CanAddress
from footsense.wires.opening import open_wire
from tests.support.can_robot import MS, Robot
from tests.support.frames import gait_frame

#: Time from one cycle to the next [ns].
CYCLE_NS = 11 * MS


class Heard:
    """A robot that is heard, whose time advances from cycle to cycle alone.

    Attributes:
        robot: The robot.
        t_ns: Time of its last cycle.
    """

    def __init__(self, channel: str) -> None:
        self.robot = Robot(channel, legs=("lf", "rf"))
        self.t_ns = self.robot.clock.t_ns = 1000 * MS  # all identities are due then
        self._address = CanAddress("virtual", channel)
        limits = LinkLimits(accept_degraded=True)
        self._listener = Listener(open_wire(self._address), self.robot.clock, limits)

    def cycle(self, **changed: object) -> None:
        """Publish the forces of one cycle; `changed` as in `contact_frame`."""
        self.t_ns += CYCLE_NS
        self.robot.publish(self.t_ns, age_ns=3 * MS, **changed)  # type: ignore[arg-type]

    def connect(self, timeout_s: float = 0.05) -> Feet:
        return Feet(self._listener, self._address, timeout_s)


@pytest.fixture
def heard(request: pytest.FixtureRequest) -> Iterator[Heard]:
    heard = Heard(request.node.nodeid)
    yield heard
    heard.robot.close()


def connected(heard: Heard, timeout_s: float = 0.05) -> Feet:
    for _ in range(6):
        heard.cycle()
    return heard.connect(timeout_s)


def test_a_cycle_is_the_force_of_each_leg_by_its_name(heard: Heard) -> None:
    with connected(heard) as feet:
        assert feet.legs == ("lf", "rf")
        heard.cycle(flags=Flag.CONTACT)
        forces = next(iter(feet))
        assert list(forces) == ["lf", "rf"]
        left = forces["lf"]
        assert left.force_n == pytest.approx((0.5, 0.5, 0.5))
        assert left.sigma_n == pytest.approx((0.010375,) * 3)
        assert (left.usable, left.contact, left.state) == (True, True, footsense.State.VALID)
        # The age when sent, and at most the time since the last look at the channel.
        assert 0.003 <= left.age_s <= 0.003 + CYCLE_NS * 1e-9
        with pytest.raises(KeyError, match="lm: no such leg is heard; there are lf, rf"):
            forces["lm"]
        assert left._replace(age_ns=5_854_839).age_s == 0.005855


@pytest.mark.parametrize(
    ("state", "usable"), [(State.DEGRADED, True), (State.ABSENT, False), (State.NO_BASELINE, False)]
)
def test_what_must_not_be_used_is_no_number(heard: Heard, state: State, *, usable: bool) -> None:
    with connected(heard) as feet:
        heard.cycle(state=state)
        left = next(iter(feet))["lf"]
        assert (left.state, left.usable) == (state, usable)
        assert (
            math.isnan(left.force_n[2]) is math.isnan(left.sigma_n[2]) is math.isnan(left.age_s) is not usable
        )
        assert left.contact is (False if usable else None)


def test_an_event_comes_once_with_its_leg_and_time(heard: Heard) -> None:
    with connected(heard) as feet:
        cycles = iter(feet)
        touchdown = GaitEvent(GaitEventKind.TOUCHDOWN, 1, heard.t_ns - 20 * MS, 0.002)
        heard.cycle(gait=gait_frame(heard.t_ns, 2, events=(touchdown,)))
        next(cycles)
        (event,) = feet.events
        assert (event.leg, event.kind) == ("rf", "touchdown")
        assert event.t_s == pytest.approx(touchdown.t_ns * 1e-9, abs=0.012)
        heard.cycle()
        next(cycles)
        assert feet.events == ()


def published(heard: Heard, kind: GaitEventKind) -> None:
    """Publish a cycle with an event of rf."""
    event = GaitEvent(kind, 1, heard.t_ns - 20 * MS, 0.002)
    heard.cycle(gait=gait_frame(heard.t_ns, 2, events=(event,)))


def test_a_callback_hears_of_an_event_at_once_and_its_exception_is_raised_where_feet_are_read(
    heard: Heard,
) -> None:
    with connected(heard) as feet:
        told = queue.SimpleQueue[footsense.FootEvent]()
        feet.on_event(told.put)
        published(heard, GaitEventKind.TOUCHDOWN)
        event = told.get(timeout=10.0)
        assert (event.leg, event.kind) == ("rf", "touchdown")
        next(iter(feet))
        assert feet.events == (event,)
        feet.on_event(lambda event: event.sigma_s / 0)
        published(heard, GaitEventKind.LIFT_OFF)
        with pytest.raises(ZeroDivisionError):
            list(feet)


def test_async_for_has_the_same_cycles_and_what_is_cancelled_takes_none_away(heard: Heard) -> None:
    async def program() -> None:
        with connected(heard, timeout_s=10.0) as feet:

            async def cycle() -> dict[str, footsense.LegForce]:
                return await anext(aiter(feet))

            waiting = asyncio.create_task(cycle())
            await asyncio.sleep(0)  # it waits, and holds up nothing
            waiting.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await waiting
            published(heard, GaitEventKind.TOUCHDOWN)
            assert (await cycle())["lf"].usable
            assert [event.leg for event in feet.events] == ["rf"]
            waiting = asyncio.create_task(cycle())
            await asyncio.sleep(0)
            assert not waiting.done()
            heard.cycle(force_n=0.3)
            assert (await waiting)["lf"].force_n[2] == pytest.approx(0.3)

    asyncio.run(program())


def test_contact_and_hold_come_with_each_force(heard: Heard) -> None:
    with connected(heard) as feet:
        heard.cycle(contact_probability=0.98, holds=0.25)
        left = next(iter(feet))["lf"]
        assert (left.contact_probability, left.holds) == (0.98, 0.25)
        heard.cycle(contact_probability=0.98, holds=math.nan)
        left = next(iter(feet))["lf"]
        assert (left.contact_probability, math.isnan(left.holds)) == (0.98, True)


def test_a_motion_reaches_the_service(heard: Heard) -> None:
    with connected(heard) as feet:
        feet.send_motion("rf", acceleration_m_per_s2=-1.5, sigma_m_per_s2=0.5, up=(0.0, 0.6, 0.8))
        feet.send_motion("rf", phase=footsense.StepPhase.SWING)
        with pytest.raises(FootsenseError, match="no leg is named xx; there are lf, rf"):
            feet.send_motion("xx")
        with pytest.raises(ValueError, match=r"^phase: a StepPhase, such as StepPhase.SWING; got 'swing'$"):
            feet.send_motion("rf", phase="swing")  # type: ignore[arg-type]
    sink = heard.robot.sink
    assert sink.commands() == []
    motion = sink.new_motion()
    assert motion is not None
    assert motion.phase.tolist() == [0, 1]
    assert (sink.stats.received_motions, sink.stats.rejected_motions) == (2, 0)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"acceleration_m_per_s2": 500.0, "sigma_m_per_s2": 1.0},
            r"^acceleration_m_per_s2: to \+-327.67, got 500$",
        ),
        ({"acceleration_m_per_s2": 1.0}, "^acceleration_m_per_s2 and sigma_m_per_s2: both or neither$"),
        ({"sigma_m_per_s2": 1.0}, "both or neither$"),
    ],
)
def test_a_motion_that_would_be_cut_or_dropped_is_refused(
    heard: Heard, given: dict[str, float], message: str
) -> None:
    with connected(heard) as feet, pytest.raises(ValueError, match=message):
        feet.send_motion("rf", **given)  # type: ignore[arg-type]
    assert heard.robot.sink.commands() == []
    assert heard.robot.sink.stats.received_motions == 0


@pytest.mark.parametrize(
    "call",
    [
        lambda feet: feet.latest(),
        lambda feet: next(iter(feet)),
        lambda feet: feet.tare("lf"),
        lambda feet: feet.send_motion("lf"),
    ],
)
def test_closed_feet_say_so(heard: Heard, call: Callable[[Feet], object]) -> None:
    feet = connected(heard)
    feet.close()
    feet.close()
    with pytest.raises(FootsenseError, match=r"^closed: connect again$"):
        call(feet)


@pytest.mark.parametrize("timeout_s", [-1.0, 0.0, math.nan, math.inf])
def test_a_timeout_that_is_none_is_refused(timeout_s: float) -> None:
    with pytest.raises(ValueError, match=rf"^timeout_s: a time above 0 s, got {timeout_s}$"):
        footsense.connect("239.74.163.77", timeout_s=timeout_s)


def test_a_slow_loop_gets_the_newest_forces_and_no_backlog(heard: Heard) -> None:
    with connected(heard) as feet:
        cycles = iter(feet)
        for force_n in (0.1, 0.2, 0.3):
            heard.cycle(force_n=force_n)
        while feet.latest()["rf"].force_n[2] != pytest.approx(0.3):
            pass
        assert next(cycles)["lf"].force_n[2] == pytest.approx(0.3)
        heard.cycle(force_n=0.4)
        assert next(cycles)["lf"].force_n[2] == pytest.approx(0.4)


def test_in_a_silence_no_leg_is_usable_and_then_the_loop_ends(heard: Heard) -> None:
    with connected(heard) as feet:
        assert feet.latest()["lf"].usable
        heard.robot.clock.t_ns += 200 * MS
        assert [forces["lf"].usable for forces in feet] == [False]


def test_a_leg_that_falls_silent_holds_up_no_other(heard: Heard) -> None:
    """Of two services on a bus one ends: its leg stays, without a force; that of the other is used after 3 s alone."""
    with connected(heard) as feet, closing(Robot(feet._address.channel, legs=("lf",))) as alone:
        cycles = iter(feet)
        n_before = feet._counts()["lf"]
        for k in range(1, 3100 * MS // CYCLE_NS):
            heard.robot.clock.t_ns = heard.t_ns + k * CYCLE_NS
            alone.publish(heard.robot.clock.t_ns)
            while feet._counts()["lf"] < n_before + k:
                pass
        next(cycles)
        alone.publish(heard.robot.clock.t_ns + CYCLE_NS)
        forces = next(cycles)
        assert (forces["lf"].usable, forces["rf"].usable) == (True, False)


def test_a_tare_of_a_leg_that_no_robot_has_says_which_there_are(heard: Heard) -> None:
    with (
        connected(heard) as feet,
        pytest.raises(footsense.FootsenseError, match="named left; there are lf, rf"),
    ):
        feet.tare("lf", "left")


def test_a_tare_of_a_service_that_has_ended_says_so(heard: Heard) -> None:
    with connected(heard) as feet:
        feet._commander = Commander(heard.robot.clock)
        heard.robot.clock.t_ns += 3000 * MS
        with pytest.raises(
            footsense.FootsenseError, match=r"lf: not tared: it is not heard on .*; is the service running"
        ):
            feet.tare("lf")


class Gone:
    """A channel that is gone."""

    def send(self, frames: Sequence[bytes], t_ns: int) -> int:
        return len(frames)

    def receive(self) -> list[bytes]:
        raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))

    def close(self) -> None: ...


def test_what_is_wrong_with_a_channel_is_said(heard: Heard) -> None:
    with pytest.raises(CanError, match=r"^no forces within 0.05 s on .*; is the service running"):
        heard.connect()
    gone = Listener(Gone(), heard.robot.clock, LinkLimits())
    with pytest.raises(CanError, match="the CAN channel is gone: No such device"):
        Feet(gone, CanAddress("virtual", ""), 1.0)


def test_frames_without_a_force_that_can_be_used_are_told_apart_from_silence(heard: Heard) -> None:
    heard.cycle(flags=Flag.DEGRADED_TIMING)  # one in sequence, of three that a link needs
    told = r"^frames come, but no force that can be used on .* within 0.05 s: lf STALE, rf STALE \(DEGRADED"
    with pytest.raises(CanError, match=told):
        heard.connect()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"interface": "slcan"}, "interface 'slcan': use one of socketcan, udp_multicast"),
        ({"channel": "udp_multicast"}, "is an interface: give it as one, without a channel$"),
        ({"channel": "can0", "interface": "udp_multicast"}, "no IPv4 multicast address; try 239.74.163.2"),
        ({"channel": "239.74.163"}, "^channel '239.74.163' is no IPv4 multicast address; try 239.74.163.2$"),
        ({"channel": "10.0.0.1"}, "no IPv4 multicast address"),
        ({"channel": "ff15::1"}, "no IPv4 multicast address"),
        (
            {"channel": "no-such-can"},
            r"CAN channel no-such-can .*; of a simulation: 239\.74\.163\.2$",
        ),
    ],
)
def test_a_wrong_channel_is_refused_in_one_line(given: dict[str, str], message: str) -> None:
    with pytest.raises(footsense.FootsenseError, match=message) as caught:
        footsense.connect(**given)  # type: ignore[arg-type]
    assert caught.value.__cause__ is None
