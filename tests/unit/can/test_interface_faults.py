"""What consumers get while CAN breaks: never an old force, and all again soon after."""

import gc
import itertools
import tracemalloc
from collections.abc import Sequence
from typing import Any, NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_interface.can.codes import NODE_IDS
from firmware_interface.can.crc8 import kind_and_node
from firmware_interface.can.force import FORCE_ID, QUALITY_ID
from firmware_interface.can.socketcan import unpack_frame
from footsense.can.interface import Can
from footsense.can.sink import CanSink
from footsense.frames import LEGS
from footsense.sim.can.controller import CanSettings
from footsense.sim.can.interface import AS_DEPLOYED, SimulatedCan
from footsense.sim.faults.scene_faults import CanBusOff, CanDown, CanFault, CanNoAck, CanQueueFull, CanTraffic
from tests.support.can_robot import MS, FakeClock
from tests.support.frames import contact_frame

#: Four scans, the service's own age limit.
MAX_AGE_NS = 98 * MS


class Heard(NamedTuple):
    """A frame that a consumer got.

    Attributes:
        t_ns: When [ns].
        wait_ns: How long before it had been handed over [ns].
        can_id: Its id.
        data: Its data.
    """

    t_ns: int
    wait_ns: int
    can_id: int
    data: bytes


class CanWalk:
    """Six legs that publish scans of which each element is half a scan old."""

    def __init__(
        self,
        faults: Sequence[CanFault] = (),
        settings: CanSettings = AS_DEPLOYED,
        *,
        bitrate: int = 500_000,
        period_ns: int = 24 * MS,
    ) -> None:
        self.clock = FakeClock()
        self.can = SimulatedCan(self.clock, 1e9 / bitrate, faults, settings)
        self.can.controller.on_delivered = self._hear
        self.period_ns = period_ns
        self.heard: list[Heard] = []
        self.n_scans = 0
        self.sink = CanSink(Can(interface="socketcan"), LEGS, self.clock, connect=self.can.connect)

    def _hear(self, t_ns: int, queued_ns: int, frame: bytes) -> None:
        can_id, data = unpack_frame(frame)
        self.heard.append(Heard(t_ns, t_ns - queued_ns, can_id, data))

    def walk(self, until_s: float) -> None:
        """Publish scan after scan up to a time."""
        while (t_ns := (self.n_scans + 1) * self.period_ns) < until_s * 1e9:
            self.clock.t_ns = t_ns
            self.n_scans += 1
            self.sink.commands()
            given: dict[str, Any] = {"t_ns": t_ns - self.period_ns // 2, "force_n": 0.5, "sigma_n": 0.01}
            self.sink.publish(contact_frame(t_ns, len(LEGS), sequence=self.n_scans, **given))
        self.clock.t_ns = max(self.clock.t_ns, round(until_s * 1e9))
        self.can.process_events_until_now()

    def forces(self, node: int | None = None) -> list[Heard]:
        """Return the Force frames that were heard, of one node or of all."""
        ids = {FORCE_ID + n for n in ([node] if node else NODE_IDS.values())}
        return [frame for frame in self.heard if frame.can_id in ids]

    @property
    def worst_wait_ms(self) -> float:
        """Longest that a Force or Quality was under way [ms]."""
        return max(
            (h.wait_ns / MS for h in self.heard if kind_and_node(h.can_id)[0] in {FORCE_ID, QUALITY_ID}),
            default=0.0,
        )


#: Time of a queue and three mailboxes full of frames that each lose to another node's, at 500 kbit/s [ms].
DRAIN_MS = 2 * 19 * 0.27

times = st.floats(0.01, 1.0).map(lambda t: round(t, 4))
lengths = st.floats(0.001, 0.7).map(lambda t: round(t, 4))


@st.composite
def faults(draw: st.DrawFn) -> CanFault:
    """One fault within the first 1.7 s."""
    at_s = draw(times)
    span = {"at_s": at_s, "until_s": at_s + draw(lengths)}
    kind = draw(st.sampled_from([CanNoAck, CanBusOff, CanDown, CanQueueFull, CanTraffic]))
    if kind is CanTraffic:
        can_id = draw(st.sampled_from([0x000, 0x10B, 0x7FF]))
        return CanTraffic(can_id=can_id, rate_hz=draw(st.floats(1.0, 1800.0)), **span)
    if kind is CanDown:
        return CanDown(unplugged=draw(st.booleans()), **span)
    plain: CanFault = kind(**span)
    return plain


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(st.lists(faults(), max_size=6), st.sampled_from([(24 * MS, 500_000), (2_700_000, 1_000_000)]))
def test_whatever_breaks_no_old_force_arrives_and_all_come_back(
    script: list[CanFault], mode: tuple[int, int]
) -> None:
    """With the deployed settings, for every script of faults, for whole scans and after every conversion.

    A force is on its way for two scans at most, so that with its own age it stays below the age limit; it comes
    after those that are older; and two seconds after the last fault, nothing is missing.
    """
    period_ns, bitrate = mode
    walk = CanWalk(script, period_ns=period_ns, bitrate=bitrate)
    walk.walk(3.7)
    assert walk.worst_wait_ms <= 2 * period_ns / MS + DRAIN_MS * 500_000 / bitrate
    assert walk.worst_wait_ms + 12 < MAX_AGE_NS / MS
    queued_ns = [h.t_ns - h.wait_ns for h in walk.heard]
    assert queued_ns == sorted(queued_ns)
    for node in range(1, 7):
        counters = [h.data[1] & 0xF for h in walk.forces(node) if h.t_ns > 3.7e9 - 10 * period_ns]
        assert len(counters) >= 9
        assert {(after - before) % 15 for before, after in itertools.pairwise(counters)} == {1}


WITHOUT_ONE_SHOT = AS_DEPLOYED._replace(one_shot=False)
TAIL_DROP = CanSettings(queue_frames=32, head_drop=False, one_shot=False, restart_ns=100 * MS)
NO_ACK = (CanNoAck(at_s=0.5, until_s=1.5),)
TWO_SHORTS = tuple(CanBusOff(at_s=at_s, until_s=at_s + 0.07) for at_s in (0.5, 0.8))


@pytest.mark.parametrize(
    ("script", "interface", "n_late"),
    [
        (NO_ACK, AS_DEPLOYED, 0),
        (NO_ACK, WITHOUT_ONE_SHOT, 3),  # what the controller held
        (NO_ACK, TAIL_DROP, 35),  # and the whole queue
        (TWO_SHORTS, AS_DEPLOYED, 0),
        (TWO_SHORTS, WITHOUT_ONE_SHOT, 0),
        (TWO_SHORTS, TAIL_DROP, 10),
    ],
)
def test_the_deployed_settings_are_what_keeps_old_frames_away(
    script: tuple[CanFault, ...], interface: CanSettings, n_late: int
) -> None:
    """What comes late with other settings: the reason for each of ours."""
    walk = CanWalk(script, interface)
    walk.walk(3.0)
    assert sum(h.wait_ns > MAX_AGE_NS for h in walk.heard) == n_late


def test_a_full_queue_costs_all_legs_the_same() -> None:
    """A scan that is cut somewhere lets the next begin with the leg that came off badly."""
    interface = CanSettings(queue_frames=5, head_drop=False, one_shot=False, restart_ns=0)
    walk = CanWalk(settings=interface)
    walk.walk(3.0)
    heard = [len(walk.forces(node)) for node in range(1, 7)]
    assert walk.sink.stats.dropped > 0
    assert max(heard) - min(heard) <= 2
    qualities = {
        (node, h.data[1] & 0xF, h.t_ns // walk.period_ns)
        for h in walk.heard
        for kind, node in [kind_and_node(h.can_id)]
        if kind == QUALITY_ID
    }
    forces = {(h.can_id - FORCE_ID, h.data[1] & 0xF, h.t_ns // walk.period_ns) for h in walk.forces()}
    assert len(forces - qualities) == 0


def test_more_than_the_bus_takes_thins_the_scans_and_ages_none() -> None:
    """Forces after every conversion on 500 kbit/s: half of them go out, none late."""
    walk = CanWalk(period_ns=2_600_000)
    walk.walk(2.0)
    heard = [len(walk.forces(node)) for node in range(1, 7)]
    assert 0.5 * walk.n_scans < min(heard) <= max(heard) < walk.n_scans
    assert walk.worst_wait_ms < 6.0


@pytest.mark.slow
def test_six_legs_leave_no_trace_of_a_day_in_memory() -> None:
    """Nothing that the interface and its sink keep grows with time, also while nothing gets through."""
    walk = CanWalk([CanNoAck(at_s=0.1)], WITHOUT_ONE_SHOT)
    walk.walk(5.0)
    assert len(walk.can.queue.frames) == AS_DEPLOYED.queue_frames
    tracemalloc.start()
    try:
        held = []
        for until_s in (20.0, 60.0):
            walk.walk(until_s)
            gc.collect()
            held.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    assert held[1] - held[0] < 30_000, "in 1667 scans of 12 frames, a number a scan would take twice that"
    assert [h for h in walk.heard if h.t_ns > 100 * MS] == []
