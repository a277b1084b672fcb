"""Forces of a running service, received from CAN: `footsense.connect`."""

import math
import threading
from collections import deque
from collections.abc import AsyncIterator, Callable, Collection, Iterator, Sequence
from contextlib import closing
from itertools import product
from typing import TYPE_CHECKING, Self

from firmware_interface.can.codes import NODE_IDS, CommandKind, Flag, Result, StepPhase
from firmware_interface.can.socketcan import pack_frame
from footsense.client.commander import Commander, open_command_wire
from footsense.client.events import FootEvent
from footsense.client.gait_events import LegEvent
from footsense.client.link import LegForce, LinkLimits, LinkStatus
from footsense.client.listener import LegSnapshot, Listener, open_listener
from footsense.client.motions import Motions
from footsense.clock import MonotonicClock
from footsense.errors import CanError, FootsenseError
from footsense.wires.address import CanAddress, Heard, address_of, silence_text
from footsense.wires.opening import open_wire

if TYPE_CHECKING:
    from footsense.ports import CanWire

#: Period of reading the channel [s]: an age is too high by up to so much.
_POLL_PERIOD_S = 0.002
#: Silence after which no force is usable, as `LinkLimits` has it, and after which the legs are given once more [s].
_SILENCE_S = 0.1
#: Most events that wait for the next mapping, the newest.
_MAX_EVENTS = 1000
#: Statuses of a leg whose forces can be read.
_READABLE = {LinkStatus.OK, LinkStatus.LOST, LinkStatus.REPEATED}
_LEG_OF_NODE = {node: leg for leg, node in NODE_IDS.items()}


def connect(
    channel: str | None = None,
    *,
    interface: Heard | None = None,
    timeout_s: float = 2.0,
) -> "Feet":
    """Connect to a running service over CAN, and wait until its forces can be read: about a second.

    It only listens, but for `Feet.tare`, `Feet.stop`, `Feet.start` and `Feet.send_motion`.

    Args:
        channel: Network interface such as `can0` or `vcan0`, or a multicast address for a simulated robot on this
            computer, without CAN. None for `can0`, or with `udp_multicast` 239.74.163.2, the address in
            `deploy/simulated.yaml`.
        interface: `socketcan` for CAN, `udp_multicast` for a multicast address; None for what the channel is.
        timeout_s: Longest wait for the first forces, and silence after which the iteration ends [s].

    Returns:
        The feet; close them, or use them in a `with` block.

    Raises:
        CanError: The channel is missing or down, nothing sends forces on it, or none that can be used; or they are of
            another version. As any of these errors it is a `footsense.FootsenseError`, which is the one to catch.
        ValueError: The timeout is not above 0.

    Example::

        with footsense.connect("can0") as feet:
            for forces in feet:
                left = forces["lf"]
                print(left.force_n, left.sigma_n, left.age_s, left.usable, left.holds)
    """
    if not 0.0 < (timeout_s := float(timeout_s)) <= threading.TIMEOUT_MAX:
        raise ValueError(f"timeout_s: a time above 0 s, got {timeout_s}")
    address = address_of(channel, interface)
    return Feet(
        open_listener(address, MonotonicClock(), LinkLimits(accept_degraded=True)), address, timeout_s
    )


class _Forces(dict[str, LegForce]):
    """Force of each leg by its name; a leg that is not heard is named, with those that are."""

    def __missing__(self, leg: str) -> LegForce:
        raise KeyError(f"{leg}: no such leg is heard; there are {', '.join(self)}")


class Feet:
    """Feet of a robot whose service is heard on CAN; made by `connect`.

    Iterating gives one mapping a cycle, from the leg's name to its `LegForce`. It is always the newest: a slow loop
    skips cycles, and never works through a backlog. In a silence the mapping comes every 100 ms, with no usable leg,
    and after the timeout of `connect` the loop ends; it may be entered again. Ctrl-C raises `KeyboardInterrupt` in it.
    `async for` does the same while other tasks run. A thread of its own receives meanwhile.

    Attributes:
        legs: Names of the legs that are heard, in the order of their CAN node ids.
        events: Gait events that arrived with the last mapping, oldest first, each a `FootEvent`.
    """

    def __init__(self, listener: Listener, address: CanAddress, timeout_s: float) -> None:
        self.events: tuple[FootEvent, ...] = ()
        self._listener, self._address, self._timeout_s = listener, address, timeout_s
        self._clock = MonotonicClock()
        self._commander = Commander(self._clock)
        self._motions = Motions()
        self._motion_wire: CanWire | None = None
        self._news = threading.Condition()
        self._stop = threading.Event()
        self._error: Exception | None = None
        self._callbacks: list[Callable[[FootEvent], object]] = []
        self._pending_events: deque[FootEvent] = deque(maxlen=_MAX_EVENTS)
        self._given: dict[str, int] = {}  # forces of each leg when a cycle was last given
        self._thread = threading.Thread(target=self._receive, name="footsense", daemon=True)
        self._thread.start()
        try:
            self.legs = self._wait_until_readable()
        except BaseException:
            self.close()
            raise

    def latest(self) -> dict[str, LegForce]:
        """Return the force of each leg as of now, without waiting; `events` then has those since the last call.

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
            silent_s = self._wait_for_cycle(silent_s)
            yield self._cycle()

    async def __aiter__(self) -> AsyncIterator[dict[str, LegForce]]:
        """Iterate likewise with `async for`; what is cancelled takes no cycle and no event with it.

        Yields:
            The force of each leg by its name.

        Raises:
            CanError: The channel has gone down.
        """
        from asyncio import to_thread  # takes longer to import than all of this

        silent_s = 0.0
        while silent_s < self._timeout_s:
            silent_s = await to_thread(self._wait_for_cycle, silent_s)
            yield self._cycle()

    def on_event(self, callback: Callable[[FootEvent], object]) -> None:
        """Call a function with each gait event from now on, at once: within some 2 ms of its frame.

        The thread that receives calls it, so it has to be short; `events` has the event too. Of a program of asyncio,
        hand its loop over: `feet.on_event(lambda event: loop.call_soon_threadsafe(queue.put_nowait, event))`.

        Args:
            callback: The function. Its exception ends the receiving; `latest` and the loops over the feet raise it.
        """
        self._callbacks.append(callback)

    def tare(self, *legs: str) -> None:
        """Take the present readings of legs as those of the unloaded foot; wait until it is done: 0.2 s, at most 20.

        The service refuses the tare of a foot that is loaded or moves. A command within 0.15 s of the last one waits:
        the service answers ten a second. A service on `udp_multicast` executes no command without
        `can.commands: true` in its file, as `deploy/simulated.yaml` has it.

        Args:
            legs: Names of the legs; none for all that are heard, as with the command `footsense tare`.

        Raises:
            FootsenseError: A leg was not tared, or does not answer in 20 s; the message says which, and why.
        """
        self._command(CommandKind.TARE, legs or self.legs)

    def stop(self, leg: str) -> None:
        """Publish no force of a leg until `start`: its state becomes `STOPPED`, also for all other programs.

        The service refuses it for a foot in contact.

        Args:
            leg: Name of the leg.

        Raises:
            FootsenseError: It was not stopped; the message says why.
        """
        self._command(CommandKind.STOP, [leg])

    def start(self, leg: str) -> None:
        """Publish the forces of a leg again after `stop`.

        Args:
            leg: Name of the leg.

        Raises:
            FootsenseError: It was not started; the message says why.
        """
        self._command(CommandKind.START, [leg])

    def send_motion(
        self,
        leg: str,
        *,
        acceleration_m_per_s2: float = math.nan,
        sigma_m_per_s2: float = math.nan,
        up: Sequence[float] = (math.nan, math.nan, math.nan),
        phase: StepPhase = StepPhase.UNKNOWN,
    ) -> None:
        """Tell the service what the robot's controller knows of the motion of a leg; NaN for what it does not know.

        The load that the acceleration of a swinging foot explains is then no contact; a wrong one harms little.
        It holds for 50 ms: call it for each leg in every step of the controller's loop, 50 times a second or so. The
        frame of the foot is that of the force: x forward, y left, z along the leg towards the body.

        It is not answered, and a service that executes no commands takes no motion, as `tare` says. What was taken is
        seen on the robot alone: `footsense_can_received_motions_total` of its metrics counts all that came,
        `footsense_can_rejected_motions_total` those that were not taken, and a recording has those that were, with
        their phases, which the estimate does not use.

        Args:
            leg: Name of the leg.
            acceleration_m_per_s2: Second derivative of the foot's path against the ground along its z, gravity not
                included [m/s2], to +-327.67; with its sigma.
            sigma_m_per_s2: Standard deviation of it [m/s2].
            up: Unit vector against gravity in the frame of the foot, its z not negative.
            phase: Planned phase of the step.

        Raises:
            ValueError: The acceleration is too large or has no sigma, or `up` or the phase is none.
            FootsenseError: There is no such leg.
            CanError: The channel is down or gone, or takes no frame.
        """
        if leg not in NODE_IDS:
            raise FootsenseError(f"no leg is named {leg}; there are {', '.join(self.legs)}")
        frame = self._motions.encode(
            NODE_IDS[leg],
            acceleration_m_per_s2=acceleration_m_per_s2,
            sigma_m_per_s2=sigma_m_per_s2,
            up=up,
            phase=phase,
        )
        if self._error is not None:
            raise self._error
        if self._motion_wire is None:
            self._motion_wire = open_wire(self._address)
        try:
            n_sent = self._motion_wire.send([pack_frame(*frame)], self._clock.now_ns())
        except OSError as error:
            raise CanError(f"the CAN channel is gone: {error.strerror or error}") from error
        if not n_sent:
            raise CanError("CAN takes no frame; is another node on the bus?")

    def _command(self, kind: CommandKind, legs: Collection[str]) -> None:
        if unknown := set(legs) - NODE_IDS.keys():
            raise FootsenseError(
                f"no leg is named {', '.join(sorted(unknown))}; there are {', '.join(self.legs)}"
            )
        refused: dict[str, list[str]] = {}
        with closing(open_command_wire(self._address)) as wire:
            for answer in self._commander.command(wire, kind, legs, self._heard_nodes()):
                if answer.result is not Result.DONE:
                    # A service may have ended while the answer was waited for.
                    is_heard = answer.is_heard and NODE_IDS[answer.leg] in self._heard_nodes()
                    why = answer._replace(is_heard=is_heard).refusal(self._address.channel)
                    refused.setdefault(why, []).append(answer.leg)
        if refused:
            raise FootsenseError(" | ".join(f"{', '.join(which)}: {why}" for why, which in refused.items()))

    def close(self) -> None:
        """Stop receiving, and close the channel; what is called afterwards raises a `FootsenseError`."""
        self._stop.set()
        self._thread.join()
        with self._news:
            self._error = self._error or FootsenseError("closed: connect again")
            self._news.notify_all()
        self._listener.close()
        if self._motion_wire is not None:
            self._motion_wire.close()
            self._motion_wire = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _receive(self) -> None:
        while self._error is None and not self._stop.wait(_POLL_PERIOD_S):
            n_before = self._listener.n_forces
            try:
                with self._news:
                    events = [_foot_event(event) for event in self._listener.poll()]
                    self._pending_events += events
                    if self._listener.n_forces > n_before:
                        self._news.notify_all()
                for callback, event in product(self._callbacks, events):
                    callback(event)
            except Exception as error:  # noqa: BLE001 - whoever reads the feet gets it
                with self._news:
                    self._error = error
                    self._news.notify_all()

    def _heard(self) -> list[LegSnapshot]:
        if self._error is not None:
            raise self._error
        return [leg for leg in self._listener.snapshot() if leg.n_force_frames]

    def _heard_nodes(self) -> list[int]:
        with self._news:
            return [NODE_IDS[leg.leg] for leg in self._heard() if leg.is_current]

    def _counts(self) -> dict[str, int]:
        return {leg.leg: leg.n_force_frames for leg in self._heard()}

    def _wait_for_cycle(self, silent_s: float) -> float:
        """Wait for a new cycle, or in a silence for a moment of it; return how long that lasts now [s]."""
        with self._news:
            moment_s = min(_SILENCE_S, self._timeout_s - silent_s)
            return 0.0 if self._news.wait_for(self._has_new_cycle, moment_s) else silent_s + _SILENCE_S

    def _cycle(self) -> dict[str, LegForce]:
        with self._news:
            self._given = self._counts()
            return self._forces()

    def _has_new_cycle(self) -> bool:
        """Return whether every leg that is not silent has a new force, or one has two: another's was lost."""
        current = [leg for leg in self._heard() if leg.force.status is not LinkStatus.STALE]
        new = [leg.n_force_frames - self._given.get(leg.leg, 0) for leg in current]
        return bool(new) and (min(new) > 0 or max(new) > 1)

    def _forces(self) -> dict[str, LegForce]:
        forces = _Forces({leg.leg: leg.force for leg in self._heard()})
        self.events = tuple(self._pending_events)
        self._pending_events.clear()
        return forces

    def _wait_until_readable(self) -> tuple[str, ...]:
        """Wait until the forces of every leg that is heard can be read; return the legs.

        Raises:
            CanError: Those of none can be read in time.
        """

        def readable() -> list[bool]:
            return [leg.force.status in _READABLE for leg in self._heard()]

        with self._news:
            self._news.wait_for(lambda: readable() and all(readable()), self._timeout_s)
            if not any(readable()):
                channel, within = self._address.channel, f"within {self._timeout_s:g} s"
                if not (heard := self._heard()):
                    raise CanError(silence_text(f"no forces {within}", channel))
                links = ", ".join(f"{leg.leg} {leg.force.status.name}" for leg in heard)
                timing = any(Flag.DEGRADED_TIMING in leg.force.flags for leg in heard)
                raise CanError(
                    f"frames come, but no force that can be used on {channel} {within}: {links}"
                    f"{' (DEGRADED_TIMING)' * timing}; is the service starting, too slow, or not the only one?"
                )
            self._given = self._counts()
            self._pending_events.clear()
        return tuple(self._given)


def _foot_event(event: LegEvent) -> FootEvent:
    t_s = math.nan if event.t_ns is None else event.t_ns * 1e-9
    return FootEvent.of(t_s, _LEG_OF_NODE[event.node], event.kind, event.sigma_s)
