"""A sink on a virtual channel, and a consumer that listens to it."""

import errno
import math
import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import can

from firmware_interface.can.codes import NODE_IDS, USABLE, State
from firmware_interface.can.reports import CalibrationFrame
from firmware_interface.can.socketcan import unpack_frame
from footsense.can.interface import Can
from footsense.can.sink import CanSink
from footsense.errors import CanError
from footsense.sim.can.frame_log import CanFrameLog
from footsense.wires.opening import open_wire
from tests.support.frames import contact_frame

MS = 1_000_000


class FakeClock:
    """A clock that stands until it is set."""

    def __init__(self) -> None:
        self.t_ns = 0

    def now_ns(self) -> int:
        return self.t_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        self.t_ns = max(self.t_ns, t_ns)


class NarrowWire:
    """A CAN interface that takes as many frames of each call as it is told to, and may be gone.

    Attributes:
        error: What is wrong with it; 0 for nothing.
        opened_ns: When it was tried to open it.
    """

    def __init__(self) -> None:
        self.room = 100
        self.error = 0
        self.gone = False
        self.taken: list[tuple[int, bytes]] = []
        self.opened_ns: list[int] = []

    def open(self, t_ns: int) -> "NarrowWire":
        self.opened_ns.append(t_ns)
        if self.gone:
            raise CanError("it is not there")
        return self

    def send(self, frames: Sequence[bytes], t_ns: int) -> int:
        del t_ns
        error = errno.ENODEV if self.gone else self.error
        if error:
            raise OSError(error, os.strerror(error))
        taken = frames[: self.room]
        self.taken += map(unpack_frame, taken)
        return len(taken)

    def receive(self) -> list[bytes]:
        return []

    def close(self) -> None: ...


class Robot:
    """A sink on a channel of its own, and a consumer that listens to it.

    Attributes:
        boot: Frames that were sent before the first cycle.
    """

    def __init__(
        self,
        channel: str,
        legs: tuple[str, ...] = ("lf",),
        log_file: Path | None = None,
        wire: NarrowWire | None = None,
        every: int = 1,
        *,
        step_mn: int = 1,
        calibrations: Sequence[CalibrationFrame] = (),
    ) -> None:
        self.clock = FakeClock()
        self.consumer = can.Bus(interface="virtual", channel=channel, preserve_timestamps=True)
        settings = Can(interface="virtual", channel=channel)
        connect = partial(open_wire, settings.address) if wire is None else lambda: wire.open(self.clock.t_ns)
        self.log = None if log_file is None else CanFrameLog(log_file, channel, connect)
        self.sink = CanSink(
            settings,
            legs,
            self.clock,
            cycles_per_force=every,
            force_step_mn=step_mn,
            foot_type="aoyagi-3x3",
            calibrations=calibrations,
            connect=connect if self.log is None else self.log.connect,
        )
        self.legs = legs
        self.boot = self.heard()

    def publish(self, t_ns: int, state: State = State.VALID, age_ns: int = 0, **changed: Any) -> None:
        """Publish one frame at a time at which its measurement is `age_ns` old; `changed` as in `contact_frame`."""
        self.clock.t_ns = t_ns
        force_n = 0.5 if state in USABLE else math.nan
        given = {"state": state, "t_ns": t_ns - age_ns, "force_n": force_n, "sigma_n": force_n / 50}
        self.sink.publish(contact_frame(t_ns, len(self.legs), **(given | changed)))

    def heard(self, base: int | None = None) -> list[can.Message]:
        """Return what has arrived at the consumer, of one kind of frame or of all."""
        messages = list(iter(lambda: self.consumer.recv(timeout=0), None))
        return [m for m in messages if base is None or m.arbitration_id - base in NODE_IDS.values()]

    def ask(self, data: bytes, can_id: int = 0x111) -> None:
        """Send a command frame."""
        self.consumer.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))

    def close(self) -> None:
        self.sink.close()
        if self.log is not None:
            self.log.close()
        self.consumer.shutdown()
