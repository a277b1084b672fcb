"""Command `footsense tare`: command the service over CAN to take the present readings of legs as unloaded."""

import sys
from collections.abc import Collection, Iterator
from contextlib import closing
from typing import NamedTuple

import click

from firmware_interface.can.codes import NODE_IDS, CommandKind, Result
from firmware_interface.can.commands import ANSWER_ID
from firmware_interface.can.crc8 import COUNTER_PERIOD
from firmware_interface.can.reports import HEARTBEAT_ID
from firmware_interface.can.socketcan import pack_frame, unpack_frame
from footsense.can.interface import Can, Interface
from footsense.cli.can.can_options import can_options
from footsense.client import PendingCommands
from footsense.clock import MonotonicClock
from footsense.daemon.can_output import open_wire
from footsense.errors import CanError, FootsenseError
from footsense.ports import CanWire, Clock

#: Time in which a running service sends five heartbeats of each leg, and one that lags at least one [ns].
_HEARTBEAT_TIMEOUT_NS = 1_000_000_000
#: Time in which a tare ends, also of slow converters [ns].
_ANSWER_TIMEOUT_NS = 20_000_000_000
_POLL_PERIOD_NS = 5_000_000
_NS_PER_S = 1_000_000_000
#: Unit in which the time of the start chooses the first counter [ns]: not that of a command of a moment ago.
_COUNTER_STEP_NS = 100_000_000

_REFUSALS = {
    Result.NOT_QUIET: "its readings move more than noise does; let the foot hang still",
    Result.LOADED: "the foot is in contact, or its readings are not those of an unloaded foot",
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


@click.command()
@click.argument("legs", nargs=-1, required=True, metavar="LEG...", type=click.Choice([*NODE_IDS, "all"]))
@can_options
def tare(legs: tuple[str, ...], interface: Interface, channel: str) -> None:
    """Take the present readings of each LEG as those of the unloaded foot; `all`: of every leg on CAN.

    Sends the command that a gait controller sends, and prints the answers. The service refuses the tare of a foot that
    is loaded or moves; then, and without an answer in 20 s, the command ends with exit code 1.
    """  # noqa: DOC501 - click shows this text
    accept = [base + node for base in (HEARTBEAT_ID, ANSWER_ID) for node in NODE_IDS.values()]
    is_done = True
    with closing(open_wire(Can(interface=interface, channel=channel), accept)) as wire:
        try:
            for answer in tare_legs(wire, MonotonicClock(), legs):
                if answer.result is Result.DONE:
                    click.echo(f"{answer.leg}: tared in {answer.response_s:.2f} s")
                else:
                    is_done = False
                    click.echo(f"footsense: {answer.leg}: not tared: {_reason(answer, channel)}", err=True)
        except OSError as error:
            raise CanError(f"the CAN channel is gone: {error.strerror or error}") from error
    sys.exit(0 if is_done else FootsenseError.exit_code)


def _reason(answer: LegTare, channel: str) -> str:
    if answer.result is not None:
        return _REFUSALS[answer.result]
    if not answer.is_heard:
        which = "no leg is" if answer.leg == "all" else "it is not"
        return f"{which} heard on {channel}; is the service running, and is this its channel?"
    return "it is heard, but does not answer; if its channel is udp_multicast, `can.commands: true` has to be set"


def tare_legs(wire: CanWire, clock: Clock, legs: Collection[str]) -> Iterator[LegTare]:
    """Tare legs by commands on CAN.

    Args:
        wire: The open channel.
        clock: The time.
        legs: Names of legs; `all` stands for every leg that is heard.

    Yields:
        Each leg, as its answer arrives; without an answer those that are not heard, and those that take too long.

    Raises:
        CanError: The channel takes no frame.
        OSError: It is down or gone.
    """
    start_ns = clock.now_ns()
    heard = {can_id - HEARTBEAT_ID for can_id, _ in _received(wire, clock, start_ns + _HEARTBEAT_TIMEOUT_NS)}
    named = [leg for leg, node in NODE_IDS.items() if leg in legs or ("all" in legs and node in heard)]
    yield from (LegTare(leg, is_heard=False) for leg in named or ["all"] if NODE_IDS.get(leg) not in heard)
    waiting = {NODE_IDS[leg]: leg for leg in named if NODE_IDS[leg] in heard}
    commands = PendingCommands(start_ns // _COUNTER_STEP_NS % COUNTER_PERIOD)
    for node in waiting:
        now_ns = clock.now_ns()
        if not wire.send([pack_frame(*commands.encode(node, CommandKind.TARE, now_ns))], now_ns):
            raise CanError("CAN takes no frame; is another node on the bus?")
    if waiting:
        for can_id, data in _received(wire, clock, clock.now_ns() + _ANSWER_TIMEOUT_NS):
            answer = commands.feed(can_id, data, clock.now_ns())
            if answer is not None:
                response_s = answer.response_time_ns / _NS_PER_S
                yield LegTare(waiting.pop(answer.node), result=answer.result, response_s=response_s)
            if not waiting:
                return
        yield from map(LegTare, waiting.values())


def _received(wire: CanWire, clock: Clock, until_ns: int) -> Iterator[tuple[int, bytes]]:
    """Yield id and data of each frame that arrives until a time [ns]."""
    while (now_ns := clock.now_ns()) < until_ns:
        yield from map(unpack_frame, wire.receive())
        clock.sleep_until_ns(min(until_ns, now_ns + _POLL_PERIOD_NS))
