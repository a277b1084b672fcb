"""Tare of legs by commands on CAN, as a gait controller sends them: for `Feet.tare` and `footsense tare`."""

from collections.abc import Callable, Collection, Iterator
from contextlib import closing
from typing import NamedTuple

from firmware_interface.can.codes import NODE_IDS, CommandKind, Result
from firmware_interface.can.commands import ANSWER_ID
from firmware_interface.can.crc8 import COUNTER_PERIOD
from firmware_interface.can.reports import HEARTBEAT_ID
from firmware_interface.can.socketcan import pack_frame, unpack_frame
from footsense.can.interface import Can
from footsense.client import PendingCommands
from footsense.clock import MonotonicClock
from footsense.daemon.can_output import open_wire
from footsense.errors import CanError
from footsense.ports import CanWire, Clock

#: Time in which a running service sends five heartbeats of each leg, and one that lags at least one [ns].
_HEARTBEAT_TIMEOUT_NS = 1_000_000_000
#: Time in which a tare ends, also of slow converters, and in which it usually does [ns].
_ANSWER_TIMEOUT_NS, _USUAL_ANSWER_NS = 20_000_000_000, 1_000_000_000
_POLL_PERIOD_NS = 5_000_000
_NS_PER_S = 1_000_000_000
#: Unit in which the time of the start chooses the first counter [ns]: not that of a command of a moment ago.
_COUNTER_STEP_NS = 100_000_000

_REFUSALS = {
    Result.NOT_QUIET: "its readings move more than noise does; let the foot hang still",
    Result.LOADED: (
        "the foot is in contact, or reads otherwise than a free one; lift it so that nothing presses it, and tare it "
        "again (simulated: footsense run --scene hanging)"
    ),
    Result.ELEMENT_FAULT: "an element gives no usable reading; `footsense probe` names it",
    Result.ABSENT: "its chips do not answer",
    Result.UNKNOWN: "the service knows no such command",
}


class LegTare(NamedTuple):
    """Answer of the service to the tare of one leg.

    Attributes:
        leg: Name of the leg.
        is_heard: Whether its heartbeat was heard.
        result: DONE, or why it was refused; None without an answer.
        response_s: From the command to the answer [s].
    """

    leg: str
    is_heard: bool = True
    result: Result | None = None
    response_s: float = 0.0

    def refusal(self, channel: str) -> str:
        """Return why the leg on a channel was not tared, in words."""
        if self.result is not None:
            return _REFUSALS[self.result]
        if not self.is_heard:
            which = "no leg is" if self.leg == "all" else "it is not"
            return f"{which} heard on {channel}; is the service running, and is this its channel?"
        return "it is heard, but does not answer; if its channel is udp_multicast, `can.commands: true` has to be set"


#: Called with the legs whose answer takes longer than usual, and the time after which they are given up [s].
OnWait = Callable[[Collection[str], float], None]


def tare_on(
    can: Can, legs: Collection[str], heard: Collection[int] = (), on_wait: OnWait | None = None
) -> Iterator[LegTare]:
    """Tare legs on a channel; arguments as of `tare_legs`.

    Yields:
        Each leg, as its answer arrives.

    Raises:
        CanError: The channel is missing, down or gone, or takes no frame.
    """
    accept = [base + node for base in (HEARTBEAT_ID, ANSWER_ID) for node in NODE_IDS.values()]
    with closing(open_wire(can, accept)) as wire:
        try:
            yield from tare_legs(wire, MonotonicClock(), legs, heard, on_wait)
        except OSError as error:
            raise CanError(f"the CAN channel is gone: {error.strerror or error}") from error


def tare_legs(
    wire: CanWire,
    clock: Clock,
    legs: Collection[str],
    heard: Collection[int] = (),
    on_wait: OnWait | None = None,
) -> Iterator[LegTare]:
    """Tare legs by commands on CAN.

    Args:
        wire: The open channel.
        clock: The time.
        legs: Names of legs; `all` stands for every leg that is heard.
        heard: CAN node ids of the legs that are heard; none to listen for their heartbeats first, a second.
        on_wait: Called once if answers take longer than usual; None for nobody to tell.

    Yields:
        Each leg, as its answer arrives; without an answer those that are not heard, and those that take too long.

    Raises:
        CanError: The channel takes no frame.
        OSError: It is down or gone.
    """
    start_ns = clock.now_ns()
    heard = heard or {
        can_id - HEARTBEAT_ID for can_id, _ in _received(wire, clock, start_ns + _HEARTBEAT_TIMEOUT_NS)
    }
    named = [leg for leg, node in NODE_IDS.items() if leg in legs or ("all" in legs and node in heard)]
    yield from (LegTare(leg, is_heard=False) for leg in named or ["all"] if NODE_IDS.get(leg) not in heard)
    waiting = {NODE_IDS[leg]: leg for leg in named if NODE_IDS[leg] in heard}
    commands = PendingCommands(start_ns // _COUNTER_STEP_NS % COUNTER_PERIOD)
    for node in waiting:
        now_ns = clock.now_ns()
        if not wire.send([pack_frame(*commands.encode(node, CommandKind.TARE, now_ns))], now_ns):
            raise CanError("CAN takes no frame; is another node on the bus?")
    if waiting:
        sent_ns = clock.now_ns()
        for can_id, data in _received(wire, clock, sent_ns + _ANSWER_TIMEOUT_NS):
            now_ns = clock.now_ns()
            answer = commands.feed(can_id, data, now_ns)
            if answer is not None:
                response_s = answer.response_time_ns / _NS_PER_S
                yield LegTare(waiting.pop(answer.node), result=answer.result, response_s=response_s)
            if not waiting:
                return
            if on_wait is not None and now_ns > sent_ns + _USUAL_ANSWER_NS:
                on_wait(waiting.values(), _ANSWER_TIMEOUT_NS / _NS_PER_S)
                on_wait = None
        yield from map(LegTare, waiting.values())


def _received(wire: CanWire, clock: Clock, until_ns: int) -> Iterator[tuple[int, bytes]]:
    """Yield id and data of each frame that arrives until a time [ns]."""
    while (now_ns := clock.now_ns()) < until_ns:
        yield from map(unpack_frame, wire.receive())
        clock.sleep_until_ns(min(until_ns, now_ns + _POLL_PERIOD_NS))
