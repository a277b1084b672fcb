"""A service as viewers see it: cycles of six standing feet, whose loads and faults a test sets."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Self

import msgspec
import numpy as np

from footsense.daemon.recording_header import ClosureConversion
from footsense.frames import (
    BaselineDrift,
    BaselineStatus,
    CanStatistics,
    CapFrame,
    Cause,
    Cycle,
    Flag,
    GaitFrame,
    Reading,
    Slip,
    State,
    Vector,
)
from footsense.ring.cycle_ring import CycleRing
from footsense.ring.records import ServiceStatus
from footsense.view.live import LiveSource
from footsense.view.server import ViewServer
from tests.support.frames import contact_frame, gait_frame

LEGS = ("lf", "lm", "lr", "rf", "rm", "rr")
PERIOD_NS = 2_700_000
#: Readings of the unloaded foot, and plate distance over the gap times capacitance [pF].
UNLOADED_PF, DISTANCE_PF = 5.387, 7.083


_SHAPE = 6, 9
HEADER = {
    "scene": '{"description": "six feet under a thumb"}',
    "elements": msgspec.json.encode(
        ClosureConversion(np.zeros(_SHAPE).tolist(), np.full(_SHAPE, DISTANCE_PF).tolist())
    ).decode(),
}


def closed_pf(closure_rel: Vector) -> Vector:
    """Return the capacitance [pF] at a closure over the gap [1], of any shape."""
    return 1.0 / (1.0 / UNLOADED_PF - closure_rel / DISTANCE_PF)


class ViewedService:
    """Writes cycles as the loop does.

    Attributes:
        force_n: Force on each foot [N], shape (6, 3); its closures follow fz.
        state: State of each leg, shape (6,).
        cause: Cause of each, shape (6,).
        fault_mask: Elements out of each, shape (6,).
        flags: Flags of each beside contact and simulation, shape (6,).
        n: Cycles so far.
    """

    def __init__(self, path: Path, header: dict[str, str] = HEADER) -> None:
        status = ServiceStatus(CanStatistics(), np.full(_SHAPE, UNLOADED_PF).tobytes())
        self._ring = CycleRing(path, LEGS, header, 370.0, lambda: status)
        self.n = 0
        self.force_n = np.zeros((6, 3))
        self.state = np.full(6, State.VALID, np.uint8)
        self.cause = np.full(6, Cause.NONE, np.uint8)
        self.fault_mask = np.zeros(6, np.uint16)
        self.flags = np.zeros(6, np.uint8)

    def publish(self, n: int = 1) -> None:
        """Publish some cycles with the present values."""
        for _ in range(n):
            self.n += 1
            self._ring.observe(self.cycle(self.n))

    def cycle(self, number: int) -> Cycle:
        """Return a cycle with the present values."""
        t_ns = 1_000_000_000 + number * PERIOD_NS
        force_n = np.where(np.isin(self.state, [State.VALID, State.DEGRADED])[:, None], self.force_n, np.nan)
        load_n = np.nan_to_num(force_n[:, 2])
        closure_rel = np.clip(load_n[:, None] * np.linspace(0.2, 0.7, 9), 0.0, 0.95)
        capacitance_pf = closed_pf(closure_rel)
        capacitance_pf[self.state == State.ABSENT] = np.nan
        stamps = np.full(_SHAPE, t_ns - 3_000_000)
        scan = CapFrame(number, stamps, capacitance_pf, np.full(_SHAPE, Reading.OK, np.uint8))
        contact = load_n > 0.03
        baseline = BaselineDrift(
            np.where(contact, BaselineStatus.HELD, BaselineStatus.TRACKING).astype(np.uint8),
            *(np.zeros(6), np.zeros(6)),
            np.full(6, 1, np.int64),
        )
        flags = np.where(contact, Flag.CONTACT | Flag.SIMULATED, Flag.SIMULATED)
        forces = contact_frame(
            t_ns,
            6,
            sequence=number,
            t_ns=t_ns - 3_100_000,
            force_n=force_n,
            sigma_n=np.where(np.isnan(force_n), np.nan, 0.02),
            contact_probability=np.where(np.isnan(force_n[:, 2]), np.nan, contact),
            holds=np.where(np.isnan(force_n[:, 2]), np.nan, contact),
            state=self.state,
            fault_mask=self.fault_mask,
            flags=flags | self.flags,
            cause=self.cause,
            baseline=baseline,
            gait=self._gait(t_ns, force_n, contact) if number % 36 == 1 else None,
        )
        return Cycle(scan, (), forces, ())

    def _gait(
        self, t_ns: int, force_n: Vector, contact: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
    ) -> GaitFrame:
        load_n = np.where(contact, force_n[:, 2], np.nan)
        return gait_frame(
            t_ns,
            6,
            contact=contact,
            contact_raw=contact,
            touchdown_ns=np.zeros(6, np.int64),
            touchdown_sigma_s=np.full(6, np.nan),
            load_share=load_n / max(np.nansum(load_n), 1e-9),
            normal=np.tile([0.0, 0.0, 1.0], (6, 1)),
            tangential_over_normal=np.hypot(force_n[:, 0], force_n[:, 1]) / load_n,
            slip=np.where(contact, Slip.NONE, Slip.UNKNOWN).astype(np.uint8),
            friction=0.4,
            all_in_air=not contact.any(),
        )

    def __enter__(self) -> Self:
        """Return the running service."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the service."""
        self.close()

    def close(self) -> None:
        """End the service: its file goes."""
        self._ring.close()


#: How long a conversation with a viewer may take [s].
TIMEOUT_S = 20


@asynccontextmanager
async def served(path: Path) -> AsyncIterator[str]:
    """Serve the service of a path, with the recordings of faults beside it; yield host and port."""
    live = LiveSource(path)
    async with ViewServer(live, path.parent / "faults").serving("127.0.0.1", 0) as url:
        yield url.removeprefix("http://")
    live.close()


def run(test: Callable[[], Awaitable[None]]) -> None:
    """Run a conversation to its end."""
    asyncio.run(asyncio.wait_for(test(), TIMEOUT_S))
