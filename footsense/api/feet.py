"""Forces of a running service, received from CAN: `footsense.connect`."""

import math
import threading
from collections.abc import Iterator
from types import TracebackType
from typing import Literal, Self

from firmware_interface.can.codes import NODE_IDS
from footsense.api.events import FootEvent
from footsense.can.interface import DEFAULT_CHANNELS
from footsense.client import LegEvent, LegForce, LinkLimits, LinkStatus
from footsense.clock import MonotonicClock
from footsense.config.contradictions import is_multicast
from footsense.daemon.can_listener import LegSnapshot, Listener, open_listener
from footsense.errors import CanError
from footsense.ports import Clock

#: Period of reading the channel [s]: an age is too high by up to so much.
_POLL_PERIOD_S = 0.002
#: Silence after which no force is usable, as `LinkLimits` has it, and after which the legs are given once more [s].
_SILENCE_S = 0.1
#: Statuses of a leg whose forces can be read.
_READABLE = {LinkStatus.OK, LinkStatus.LOST, LinkStatus.REPEATED}
_LEG_OF_NODE = {node: leg for leg, node in NODE_IDS.items()}


def connect(
    channel: str | None = None,
    *,
    interface: Literal["socketcan", "udp_multicast"] = "socketcan",
    timeout_s: float = 2.0,
) -> "Feet":
    """Connect to a running service over CAN, and wait until its forces can be read: about a second.

    It only listens.

    Args:
        channel: Network interface such as `can0` or `vcan0`; with `udp_multicast` a multicast address. None for `can0`,
            or 239.74.163.2, the address in `deploy/simulated.yaml`.
        interface: `socketcan` for CAN; `udp_multicast` for a simulated robot on this computer, without CAN.
        timeout_s: Longest wait for the first forces, and silence after which the iteration ends [s].

    Returns:
        The feet; close them, or use them in a `with` block.

    Raises:
        CanError: The channel is missing or down, nothing sends forces on it, or they are of another version.

    Example::

        with footsense.connect("can0") as feet:
            for forces in feet:
                left = forces["lf"]
                print(left.force_n, left.sigma_n, left.age_s, left.usable, left.contact)
    """
    if interface not in DEFAULT_CHANNELS:
        raise CanError(f"interface {interface!r}: use one of {', '.join(DEFAULT_CHANNELS)}")
    name = channel or DEFAULT_CHANNELS[interface]
    if interface == "udp_multicast" and not is_multicast(name):
        raise CanError(f"channel {name!r}: no IPv4 multicast address; try {DEFAULT_CHANNELS[interface]}")
    clock = MonotonicClock()
    return Feet(
        open_listener(interface, name, clock, LinkLimits(accept_degraded=True)), clock, name, timeout_s
    )


class Feet:
    """Feet of a robot whose service is heard on CAN; made by `connect`.

    Iterating gives one mapping a cycle, leg name to `LegForce`, with the forces just received. The newest one is given:
    a slow loop skips cycles and never works through a backlog. In a silence it gives the legs every 100 ms, none of
    them usable, and ends after `timeout_s`.

    A thread receives; what it does not hear in time is not usable.

    Attributes:
        legs: Names of the legs that are heard, in the order of their CAN node ids.
        events: Gait events that arrived with the last mapping, oldest first.
    """

    def __init__(self, listener: Listener, clock: Clock, name: str, timeout_s: float) -> None:
        self.events: tuple[FootEvent, ...] = ()
        self._listener, self._clock, self._timeout_s = listener, clock, timeout_s
        self._news = threading.Condition()
        self._stop = threading.Event()
        self._error: CanError | None = None
        self._pending_events: list[LegEvent] = []
        self._given: dict[str, int] = {}  # forces of each leg when a cycle was last given
        self._thread = threading.Thread(target=self._receive, name="footsense", daemon=True)
        self._thread.start()
        try:
            self.legs = self._wait_until_readable(name)
        except BaseException:
            self.close()
            raise

    def latest(self) -> dict[str, LegForce]:
        """Return the force of each leg as of now, without waiting.

        Raises:
            CanError: The channel has gone down.
        """
        with self._news:
            return self._forces()

    def __iter__(self) -> Iterator[dict[str, LegForce]]:
        """Iterate over the cycles as they arrive.

        Yields:
            The force of each leg by its name.

        Raises:
            CanError: The channel has gone down.
        """
        silent_s = 0.0
        while silent_s < self._timeout_s:
            with self._news:
                arrived = self._news.wait_for(
                    self._has_new_cycle, min(_SILENCE_S, self._timeout_s - silent_s)
                )
                forces = self._forces()
                self._given = self._counts()
            silent_s = 0.0 if arrived else silent_s + _SILENCE_S
            yield forces

    def close(self) -> None:
        """Stop receiving, and close the channel."""
        self._stop.set()
        self._thread.join()
        self._listener.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _receive(self) -> None:
        while not self._stop.wait(_POLL_PERIOD_S):
            with self._news:
                try:
                    self._pending_events += self._listener.poll()
                except CanError as error:
                    self._error = error
                self._news.notify_all()
            if self._error is not None:
                return

    def _heard(self) -> list[LegSnapshot]:
        if self._error is not None:
            raise self._error
        return [leg for leg in self._listener.snapshot() if leg.n_force_frames]

    def _counts(self) -> dict[str, int]:
        return {leg.leg: leg.n_force_frames for leg in self._heard()}

    def _has_new_cycle(self) -> bool:
        """Return whether every leg has a new force, or one has two: a frame of another was lost."""
        new = [n - self._given.get(leg, 0) for leg, n in self._counts().items()]
        return bool(new) and (min(new) > 0 or max(new) > 1)

    def _forces(self) -> dict[str, LegForce]:
        forces = {leg.leg: leg.force for leg in self._heard()}
        self.events = tuple(map(_foot_event, self._pending_events))
        self._pending_events.clear()
        return forces

    def _wait_until_readable(self, name: str) -> tuple[str, ...]:
        def are_readable() -> bool:
            heard = self._heard()
            return bool(heard) and all(leg.force.status in _READABLE for leg in heard)

        with self._news:
            if not self._news.wait_for(are_readable, self._timeout_s) and not any(
                leg.force.status in _READABLE for leg in self._heard()
            ):
                raise CanError(f"no forces on {name} in {self._timeout_s:g} s; is the service running there?")
            self._given = self._counts()
            self._pending_events.clear()
        return tuple(self._given)


def _foot_event(event: LegEvent) -> FootEvent:
    t_s = math.nan if event.t_ns is None else event.t_ns * 1e-9
    return FootEvent.of(t_s, _LEG_OF_NODE[event.node], event.kind, event.sigma_s)
