"""The real sink on a simulated CAN interface, and a consumer that notes when each frame came."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from firmware_interface.can.codes import NODE_IDS
from firmware_interface.can.socketcan import unpack_frame
from footsense.can.interface import Can
from footsense.can.sink import CanSink
from footsense.frames import LEGS
from footsense.sim.can.controller import CanSettings
from footsense.sim.can.interface import AS_DEPLOYED, SimulatedCan
from footsense.sim.faults.scene_faults import CanFault
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
        legs: tuple[str, ...] = LEGS,
    ) -> None:
        self.clock = FakeClock()
        self.can = SimulatedCan(self.clock, bitrate, faults, settings)
        self.can.controller.on_delivered = self._hear
        self.period_ns = period_ns
        self.heard: list[Heard] = []
        self.n_scans = 0
        self.sink = CanSink(Can(interface="socketcan"), legs, self.clock, connect=self.can.connect)
        self._n = len(legs)

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
            self.sink.publish(contact_frame(t_ns, self._n, sequence=self.n_scans, **given))
        self.clock.t_ns = max(self.clock.t_ns, round(until_s * 1e9))
        self.can.process_events_until_now()

    def forces(self, node: int | None = None) -> list[Heard]:
        """Return the Force frames that were heard, of one node or of all."""
        ids = {0x180 + n for n in ([node] if node else NODE_IDS.values())}
        return [frame for frame in self.heard if frame.can_id in ids]

    @property
    def worst_wait_ms(self) -> float:
        """Longest that a Force or Quality was under way [ms]."""
        return max(
            (h.wait_ns / MS for h in self.heard if h.can_id >> 7 in {0x180 >> 7, 0x280 >> 7}), default=0.0
        )
