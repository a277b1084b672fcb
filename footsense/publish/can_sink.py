"""Forces to CAN, and commands from CAN: who sends what when.

For each leg `Force` and `Quality` with every scan, a heartbeat at 5 Hz, and a fault report when the state,
the element mask or the cause changes. The counters go on over frames that the channel did not take, and show the gap.
"""

from pathlib import Path

from firmware_interface import can_events, can_frames
from firmware_interface.can_codes import NODE_IDS, Cause, NmtState, Result, State
from firmware_interface.crc8 import FrameError, next_counter
from footsense.frames import Command, CommandKind, ForceFrame, Outcome
from footsense.ports import Clock
from footsense.publish.can_channel import CanChannel
from footsense.publish.can_stats import CanStats

__all__ = ["CanSink"]

_HEARTBEAT_PERIOD_NS = 200_000_000

#: The same command with the same counter within this time is a repetition; later, it is a restarted consumer's.
_REPEAT_NS = 1_000_000_000

#: A leg whose chips give nothing waits for them as one without a baseline waits for its tare.
_NMT_OF_STATE = {
    int(State.STOPPED): NmtState.STOPPED,
    int(State.ABSENT): NmtState.PRE_OPERATIONAL,
    int(State.STARTING): NmtState.PRE_OPERATIONAL,
    int(State.CONVERTER_FAULT): NmtState.PRE_OPERATIONAL,
    int(State.NO_BASELINE): NmtState.PRE_OPERATIONAL,
    int(State.TARING): NmtState.PRE_OPERATIONAL,
}


class _Leg:
    """One leg's frames and where their counters stand."""

    def __init__(self, channel: CanChannel, node: int, heartbeat_due_ns: int) -> None:
        self.node = node
        self.force = channel.frame(can_frames.FORCE_ID + node, 8)
        self.quality = channel.frame(can_frames.QUALITY_ID + node, 8)
        self.fault = channel.frame(can_events.FAULT_ID + node, 6)
        self.answer = channel.frame(can_events.ANSWER_ID + node, 4)
        self.heartbeat = channel.frame(can_events.HEARTBEAT_ID + node, 1)
        self.counter = 0  # of Force and Quality: the two of one scan have the same
        self.fault_counter = 0
        self.answer_counter = 0
        self.heartbeat_due_ns = heartbeat_due_ns
        # As if stopped until now: the first state is a change, and a consumer that was here before learns it.
        self.reported = (int(State.STOPPED), 0, int(Cause.NONE))
        self.last_command: tuple[CommandKind, int] | None = None  # its counter
        self.last_command_ns = 0
        # Counters of the open commands of each kind, oldest first.
        self.asked: dict[CommandKind, list[int]] = {kind: [] for kind in CommandKind}


class CanSink:
    """A CAN channel as the place where forces go and commands come from.

    Args:
        interface: Kind of channel, as python-can calls it: `virtual` or `socketcan`.
        channel: Its name, such as `can0`.
        legs: Name of the leg in each row of the frames.
        clock: Times the heartbeats.
        log_file: File for every frame sent: candump `.log`, `.asc` or `.blf`; None for none.
        bitrate: Bit rate of the bus [bit/s]; Linux sets it when the interface comes up, so it is only told.
        stats: Where to count; None to begin a new count.

    Attributes:
        stats: What the channel has done so far.

    Raises:
        ConfigError: The log's suffix is unknown.
        RecordingError: The log cannot be opened.
        CanError: The channel is missing or down.

    Timing:
        Never waits. Six legs: 12 frames a scan and 30 heartbeats a second.
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
        stats: CanStats | None = None,
    ) -> None:
        self.stats = stats or CanStats()
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
        )
        self._clock = clock
        now_ns = clock.now_ns()
        self._stamp_s = now_ns / 1e9
        # Spread over the period, so that the heartbeats do not all come on top of one scan's burst.
        self._legs = [
            _Leg(self._channel, node, now_ns + row * _HEARTBEAT_PERIOD_NS // len(nodes))
            for row, node in enumerate(nodes)
        ]
        self._row_of_node = {node: row for row, node in enumerate(nodes)}
        self._closed = False

    @property
    def log_error(self) -> str:
        """Why the log ended early, such as a full disk; empty while it is whole."""
        return self._channel.log_error

    def publish(self, frame: ForceFrame) -> None:
        """Send each leg's force and quality, and the fault reports and heartbeats that are due."""
        self._stamp_s = frame.t_sent_ns / 1e9
        states: list[int] = frame.state.tolist()
        masks: list[int] = frame.fault_mask.tolist()
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
        for leg, state, mask, force_n, sigma_n, flags, t_ns in values:
            counter = leg.counter
            leg.counter = next_counter(counter)
            force = can_frames.encode_force(leg.node, counter, state, force_n)
            self._channel.send(leg.force, force, self._stamp_s)
            age_ns = frame.t_sent_ns - t_ns if t_ns else None
            quality = can_frames.encode_quality(leg.node, counter, flags, age_ns, mask, sigma_n)
            self._channel.send(leg.quality, quality, self._stamp_s)
        now_ns = self._clock.now_ns()
        causes: list[int] = frame.cause.tolist()
        for leg, state, mask, cause in zip(self._legs, states, masks, causes, strict=True):
            if leg.reported != (state, mask, cause):
                self._report(leg, state, mask, cause)
            if now_ns >= leg.heartbeat_due_ns:
                n_due = 1 + (now_ns - leg.heartbeat_due_ns) // _HEARTBEAT_PERIOD_NS
                leg.heartbeat_due_ns += n_due * _HEARTBEAT_PERIOD_NS  # those missed are not made up for
                self._beat(leg, _NMT_OF_STATE.get(state, NmtState.OPERATIONAL))

    def commands(self) -> list[Command]:
        """Return the good commands among the frames that have arrived; the others are counted.

        One that asks for nothing known is answered at once. One with a wrong crc or a repeated counter is
        not: it is not certain who sent it, and whether.
        """
        commands = []
        for can_id, data in self._channel.receive():
            try:
                _, counter, kind = can_events.decode_command(can_id, data)
            except can_events.UnknownCommandError as error:
                leg = self._legs[self._row_of_node[can_id - can_events.COMMAND_ID]]
                self.stats.rejected += 1
                self._answer(leg, Result.UNKNOWN, error.kind, error.counter)
                continue
            except FrameError:
                self.stats.rejected += 1
                continue
            row = self._row_of_node[can_id - can_events.COMMAND_ID]
            leg = self._legs[row]
            now_ns = self._clock.now_ns()
            if (kind, counter) == leg.last_command and now_ns - leg.last_command_ns < _REPEAT_NS:
                self.stats.rejected += 1
                continue
            leg.last_command, leg.last_command_ns = (kind, counter), now_ns
            if counter not in leg.asked[kind]:  # so the list cannot outgrow the counter's range
                leg.asked[kind].append(counter)
            commands.append(Command(kind, row))
        return commands

    def answer(self, outcome: Outcome) -> None:
        """Send a command's result on its leg's answer id, with the counter of the command.

        A tare that is asked for while one runs begins that one anew: both have one end, and each its answer.
        """
        kind, row = outcome.command
        leg = self._legs[row]
        asked = leg.asked[kind]
        n_ended = len(asked) if kind is CommandKind.TARE else 1
        for counter in asked[:n_ended] or [can_events.UNASKED]:
            self._answer(leg, outcome.result, kind, counter)
        del asked[:n_ended]

    def close(self) -> None:
        """Send each leg's last heartbeat, `stopped`, and release the channel; a second call does nothing.

        Raises:
            RecordingError: The log is not whole; the channel is released all the same.
        """
        if self._closed:
            return
        self._closed = True
        for leg in self._legs:
            self._beat(leg, NmtState.STOPPED)
        self._channel.close()

    def _report(self, leg: _Leg, state: int, mask: int, cause: int) -> None:
        previous = leg.reported[0]
        data = can_events.encode_fault(leg.node, leg.fault_counter, state, previous, mask, cause)
        leg.fault_counter = next_counter(leg.fault_counter)
        leg.reported = (state, mask, cause)
        self._channel.send(leg.fault, data, self._stamp_s)

    def _answer(self, leg: _Leg, result: int, kind: int, asked: int) -> None:
        data = can_events.encode_answer(leg.node, leg.answer_counter, result, kind, asked)
        leg.answer_counter = next_counter(leg.answer_counter)
        self._channel.send(leg.answer, data, self._stamp_s)

    def _beat(self, leg: _Leg, state: NmtState) -> None:
        self._channel.send(leg.heartbeat, can_events.encode_heartbeat(state), self._stamp_s)
