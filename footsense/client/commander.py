"""Commands to legs on CAN, as a gait controller sends them: for `Feet.tare`, `start`, `stop`, and `footsense tare`."""

from collections.abc import Callable, Collection, Iterator
from typing import NamedTuple

from firmware_interface.can.codes import NODE_IDS, CommandKind, Result
from firmware_interface.can.commands import ANSWER_ID
from firmware_interface.can.crc8 import COUNTER_PERIOD
from firmware_interface.can.reports import HEARTBEAT_ID
from firmware_interface.can.socketcan import pack_frame, unpack_frame
from footsense.client.commands import PendingCommands
from footsense.errors import CanError
from footsense.ports import CanWire, Clock
from footsense.wires.address import CanAddress, silence_text
from footsense.wires.opening import POLL_PERIOD_NS, open_client_wire

#: Time in which a running service sends five heartbeats of each leg, and one that lags at least one [ns].
_HEARTBEAT_TIMEOUT_NS = 1_000_000_000
#: Time in which a tare ends, also of slow converters, and in which it usually does [ns].
_ANSWER_TIMEOUT_NS, _USUAL_ANSWER_NS = 20_000_000_000, 1_000_000_000
_NS_PER_S = 1_000_000_000
#: Unit in which the time of the start chooses the first counter [ns]: not that of a command of a moment ago.
_COUNTER_STEP_NS = 100_000_000
#: Shortest time between two commands [ns]: another counter each, and fewer than ten a second.
_COMMAND_PERIOD_NS = 150_000_000

#: What a command has done once it is executed.
DONE_WORDS = {CommandKind.TARE: "tared", CommandKind.START: "started", CommandKind.STOP: "stopped"}

_LOADED = {
    CommandKind.TARE: (
        "the foot is in contact, or reads otherwise than a free one; lift it so that nothing presses it, and tare it "
        "again (simulated: start the service again with --scene hanging)"
    ),
    CommandKind.STOP: "the foot is in contact, and a leg that stands keeps its force; lift it first",
}
_REFUSALS = {
    Result.NOT_QUIET: "its readings move more than noise does; let the foot hang still",
    Result.ELEMENT_FAULT: "an element gives no usable reading; `footsense probe` names it",
    Result.ABSENT: "its chips do not answer",
    Result.UNKNOWN: "the service knows no such command",
}


class LegAnswer(NamedTuple):
    """Answer of the service to a command to one leg.

    Attributes:
        leg: Name of the leg.
        kind: The command.
        is_heard: Whether the leg's heartbeat was heard.
        result: DONE, or why it was refused; None without an answer.
        response_s: From the command to the answer [s].
    """

    leg: str
    kind: CommandKind
    is_heard: bool = True
    result: Result | None = None
    response_s: float = 0.0

    def refusal(self, channel: str) -> str:
        """Return what was not done with the leg on a channel, and why, in words."""
        return f"not {DONE_WORDS[self.kind]}: {self._reason(channel)}"

    def _reason(self, channel: str) -> str:
        if self.result is Result.LOADED:
            return _LOADED[self.kind]
        if self.result is not None:
            return _REFUSALS[self.result]
        if not self.is_heard:
            which = "no leg is" if self.leg == "all" else "it is not"
            return silence_text(f"{which} heard", channel)
        return (
            "it is heard, but does not answer: `can.commands` is false in the service's file, as it is by default with "
            "udp_multicast, or another program sends more than ten commands a second"
        )


def open_command_wire(address: CanAddress) -> CanWire:
    """Open a channel for commands, and for heartbeats and answers alone; close it.

    Raises:
        CanError: The channel is missing or down.
    """
    return open_client_wire(
        address, [base + node for base in (HEARTBEAT_ID, ANSWER_ID) for node in NODE_IDS.values()]
    )


#: Called with the legs whose answer takes longer than usual, and the time after which they are given up [s].
OnWait = Callable[[Collection[str], float], None]


class Commander:
    """Sends commands to legs on CAN, and waits for their answers.

    The service answers ten commands a second to a leg, and takes the same counter within a second for a repetition. So
    a command that comes too soon after the last one waits.

    Args:
        clock: The time.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._free_ns = 0

    def command(
        self,
        wire: CanWire,
        kind: CommandKind,
        legs: Collection[str] = (),
        heard: Collection[int] = (),
        on_wait: OnWait | None = None,
    ) -> Iterator[LegAnswer]:
        """Command legs on an open channel.

        Args:
            wire: The channel.
            kind: The command.
            legs: Names of legs; none for every leg that is heard.
            heard: CAN node ids of the legs that are heard; none to listen for their heartbeats first, a second.
            on_wait: Called once if answers take longer than usual; None for no notice.

        Yields:
            Each leg, as its answer arrives; without an answer those that are not heard, and those that take too long.

        Raises:
            CanError: The channel is down or gone, or takes no frame.
        """
        try:
            clock = self._clock
            if (start_ns := clock.now_ns()) < self._free_ns:
                clock.sleep_until_ns(self._free_ns)
                start_ns = clock.now_ns()
            heard = heard or {
                can_id - HEARTBEAT_ID for can_id, _ in self._received(wire, _HEARTBEAT_TIMEOUT_NS)
            }
            named = [leg for leg, node in NODE_IDS.items() if (leg in legs if legs else node in heard)]
            yield from (
                LegAnswer(leg, kind, is_heard=False)
                for leg in named or ["all"]
                if NODE_IDS.get(leg) not in heard
            )
            waiting = {NODE_IDS[leg]: leg for leg in named if NODE_IDS[leg] in heard}
            commands = PendingCommands(start_ns // _COUNTER_STEP_NS % COUNTER_PERIOD)
            for node in waiting:
                now_ns = clock.now_ns()
                if not wire.send([pack_frame(*commands.encode(node, kind, now_ns))], now_ns):
                    raise CanError("CAN takes no frame; is another node on the bus?")
                self._free_ns = now_ns + _COMMAND_PERIOD_NS
            sent_ns = clock.now_ns()
            for can_id, data in self._received(wire, _ANSWER_TIMEOUT_NS if waiting else 0):
                now_ns = clock.now_ns()
                answer = commands.feed(can_id, data, now_ns)
                if answer is not None:
                    leg, response_s = waiting.pop(answer.node), answer.response_time_ns / _NS_PER_S
                    yield LegAnswer(leg, kind, result=answer.result, response_s=response_s)
                if not waiting:
                    return
                if on_wait is not None and now_ns > sent_ns + _USUAL_ANSWER_NS:
                    on_wait(waiting.values(), _ANSWER_TIMEOUT_NS / _NS_PER_S)
                    on_wait = None
            yield from (LegAnswer(leg, kind) for leg in waiting.values())
        except OSError as error:
            raise CanError(f"the CAN channel is gone: {error.strerror or error}") from error

    def _received(self, wire: CanWire, duration_ns: int) -> Iterator[tuple[int, bytes]]:
        """Yield id and data of each frame that arrives within a time [ns]."""
        until_ns = self._clock.now_ns() + duration_ns
        while (now_ns := self._clock.now_ns()) < until_ns:
            yield from map(unpack_frame, wire.receive())
            self._clock.sleep_until_ns(min(until_ns, now_ns + POLL_PERIOD_NS))
