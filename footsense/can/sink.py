"""Forces to CAN: who sends what when.

For each leg `Force` and `Quality` with every scan, a heartbeat at 5 Hz, `Zero` at 1 Hz, and a fault report when
the state, the element mask or the cause changes. All that one scan gives goes out with one call. The counters
go on over frames that the channel did not take, and show the gap.

Where the channel takes only a part, the rest of the scan is dropped; each scan begins with another leg, so that a
full queue costs all legs the same. A leg's Force and Quality go out behind each other. A fault report that was not
taken is sent again with the next scan, as the fault then is.

The loop drives all of this, the heartbeats too. It turns even if no leg answers; if it stands, its heartbeats
stop, and that is what they are for.
"""

from collections.abc import Callable
from pathlib import Path

from firmware_interface import can_events, can_frames
from firmware_interface.can_codes import NODE_IDS, Flag, NmtState
from firmware_interface.crc8 import next_counter
from firmware_interface.socketcan import FRAME_BYTES
from footsense.can.channel import CanChannel
from footsense.can.commands import CanCommands
from footsense.can.leg_frames import CanLeg
from footsense.frames import CanStatistics, Command, CommandResult, ContactFrame
from footsense.ports import CanWire, Clock

__all__ = ["CanSink"]

#: Most frames beside Force and Quality that go out with one scan; the others wait for the next. The interface's
#: queue has room for so many (`deploy/80-can0.network`).
_MOST_EVENTS = 4

#: A plain number: an enumeration's arithmetic costs a microsecond each time.
_DEGRADED_TIMING = int(Flag.DEGRADED_TIMING)

#: Bytes of a leg's Force and Quality.
_PAIR_BYTES = 2 * FRAME_BYTES


class CanSink:
    """A CAN channel as the place where forces go and commands come from.

    Args:
        interface: Kind of channel, as python-can calls it: `virtual` or `socketcan`.
        channel: Its name, such as `can0`.
        legs: Name of the leg in each row of the frames.
        clock: The time that the frames are in.
        log_file: File for every frame sent: candump `.log`, `.asc` or `.blf`; None for none.
        bitrate: Bit rate of the bus [bit/s]; Linux sets it when the interface comes up, so it is only told.
        stats: Where to count; None to begin a new count.
        log_waits: Whether the log may make the loop wait, as in virtual time.
        connect: Opens another interface than that of this name, such as a simulated one.

    Attributes:
        stats: What the channel has done so far.

    Raises:
        ConfigError: The log's suffix is unknown.
        RecordingError: The log cannot be opened.
        CanError: The channel is missing or down.

    Timing:
        Never waits. Six legs: 12 frames a scan, 30 heartbeats and 6 zeros a second; one system call a scan.
    """

    def __init__(
        self,
        *,
        interface: str,
        channel: str,
        legs: tuple[str, ...],
        clock: Clock,
        log_file: Path | None = None,
        bitrate: int = 500_000,
        stats: CanStatistics | None = None,
        log_waits: bool = False,
        connect: Callable[[], CanWire] | None = None,
    ) -> None:
        self.stats = stats or CanStatistics()
        nodes = [NODE_IDS[leg] for leg in legs]
        boot = can_events.encode_heartbeat(NmtState.BOOT)
        self._channel = CanChannel(
            interface=interface,
            channel=channel,
            bitrate=bitrate,
            accept=[can_events.COMMAND_ID + node for node in nodes],
            greeting={can_events.HEARTBEAT_ID + node: boot for node in nodes},
            log_file=log_file,
            stats=self.stats,
            log_waits=log_waits,
            connect=connect,
        )
        self._clock = clock
        now_ns = clock.now_ns()
        self._legs = [CanLeg(row, node, now_ns, row / len(nodes)) for row, node in enumerate(nodes)]
        self._commands = CanCommands(self._channel, nodes, clock, self.stats)
        self._counter = 0  # of every Force and Quality of a scan
        self._first = 0  # where the frames begin that go out first [bytes]
        self._told: list[list[int]] = []  # states, masks and causes of which nothing is left to report
        self._due_ns = now_ns  # of the next heartbeat or zero
        self._closed = False

    def publish(self, frame: ContactFrame) -> None:
        """Send each leg's force and quality, and the fault reports, heartbeats and zeros that are due."""
        t_ns = frame.t_sent_ns
        states: list[int] = frame.state.tolist()
        masks: list[int] = frame.fault_mask.tolist()
        forces = self._encode(frame, states, masks)
        # A full queue drops frames at its front or refuses them at its end: not always those of the same leg.
        self._first = (self._first + _PAIR_BYTES) % len(forces)
        forces = forces[self._first :] + forces[: self._first]
        told = [states, masks, frame.cause.tolist()]
        owed = [] if told == self._told else self._changes(told)
        reports = owed[:_MOST_EVENTS]
        events = [leg.report(*now) for leg, now in reports]
        if t_ns >= self._due_ns:
            events += self._periodic(frame, states, _MOST_EVENTS - len(events))
        events += self._commands.unasked(_MOST_EVENTS - len(events))
        taken = self._channel.send(forces + b"".join(events), t_ns)

        n_reported = min(len(reports), max(0, taken - 2 * len(self._legs)))
        for leg, now in reports[:n_reported]:
            leg.has_reported(now)
        if n_reported == len(owed):
            self._told = told

    def commands(self) -> list[Command]:
        """Return the good commands among the frames that have arrived; the others are counted."""
        return self._commands.take()

    def answer(self, outcome: CommandResult) -> None:
        """Send a command's result on its leg's answer id, with the counter of the command."""
        self._commands.answer(outcome)

    def close(self) -> None:
        """Send each leg's last heartbeat, `stopped`, and release the channel; a second call does nothing.

        Raises:
            RecordingError: The log is not whole; the channel is released all the same.
        """
        if self._closed:
            return
        self._closed = True
        last = b"".join(leg.heartbeat(NmtState.STOPPED) for leg in self._legs)
        self._channel.send(last, self._clock.now_ns())
        self._channel.close()

    def _encode(self, frame: ContactFrame, states: list[int], masks: list[int]) -> bytes:
        """Return Force and Quality of every leg.

        Leg by leg: for six legs, numpy's calls take as long as the arithmetic that they would save.
        """
        counter = self._counter
        self._counter = next_counter(counter)
        t_sent_ns = frame.t_sent_ns
        values = zip(
            self._legs,
            states,
            masks,
            frame.force_n.tolist(),
            frame.sigma_n.tolist(),
            frame.flags.tolist(),
            frame.t_ns.tolist(),
            strict=True,
        )
        parts: list[bytes] = []
        for leg, state, mask, force_n, sigma_n, flags, t_ns in values:
            age_ns = t_sent_ns - t_ns if t_ns else None
            parts += (
                leg.force_head,
                can_frames.encode_force(leg.node, counter, state, force_n),
                leg.quality_head,
                can_frames.encode_quality(leg.node, counter, flags, age_ns, mask, sigma_n),
            )
        return b"".join(parts)

    def _changes(self, told: list[list[int]]) -> list[tuple[CanLeg, tuple[int, int, int]]]:
        """Return the legs of which a fault report is owed, with state, mask and cause."""
        of_legs = zip(*told, strict=True)
        return [
            (leg, (state, mask, cause))
            for leg, (state, mask, cause) in zip(self._legs, of_legs, strict=True)
            if leg.reported != (state, mask, cause)
        ]

    def _periodic(self, frame: ContactFrame, states: list[int], room: int) -> list[bytes]:
        """Return the heartbeats and zeros that are due, as many as there is room for.

        Those that were missed are not made up for.
        """
        now_ns = frame.t_sent_ns
        due: list[bytes] = []
        for row, leg in enumerate(self._legs):
            if now_ns < leg.due_ns:
                continue
            if now_ns >= leg.heartbeat_due_ns and len(due) < room:
                leg.degraded_timing = bool(int(frame.flags[row]) & _DEGRADED_TIMING)
                due.append(leg.next_heartbeat(states[row], now_ns))
            if now_ns >= leg.zero_due_ns and len(due) < room:
                due.append(leg.next_zero(frame))
        self._due_ns = min(leg.due_ns for leg in self._legs)
        return due
