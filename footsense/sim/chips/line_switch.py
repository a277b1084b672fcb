"""A simulated ADG715 with a foot's rows or columns on it."""

from collections import deque
from typing import NamedTuple

from firmware_interface import adg715
from footsense.sim.faults.scene_faults import Span, during

#: Capacitance to ground of a row line that nothing drives [pF]: the electrode and a few millimetres of trace.
FLOATING_ROW_PF = 1.0


class LineStates(NamedTuple):
    """Which lines were selected and which waited, from a time on; the others floated."""

    since_ns: int
    selected: int
    waiting: int


class SimulatedLineSwitch:
    """An ADG715 behind a leg's mux channel: one data byte, readable, all switches open at power-up.

    Args:
        address: Its address on the bus.

    Attributes:
        absent_ns: Spans in which it does not answer [ns].
        deaf_ns: Spans in which it acknowledges its settings and ignores them [ns].
        brown_outs_ns: When its supply fails for a moment [ns].
    """

    def __init__(self, address: int = adg715.ADDRESS) -> None:
        self.address = address
        self.absent_ns: list[Span] = []
        self.deaf_ns: list[Span] = []
        self.brown_outs_ns: list[float] = []
        self._switches = 0
        # A conversion looks back one conversion time at most; lines change no faster than that.
        self._history: deque[LineStates] = deque([LineStates(0, 0, 0)], maxlen=8)

    def acknowledges(self, t_ns: int) -> bool:
        """Answer as long as the leg is there."""
        while self.brown_outs_ns and min(self.brown_outs_ns) <= t_ns:
            self._set(0, round(min(self.brown_outs_ns)))
            self.brown_outs_ns.remove(min(self.brown_outs_ns))
        return not during(self.absent_ns, t_ns)

    def write(self, data: bytes, t_ns: int) -> None:
        """Set the switches; the last byte counts."""
        if not during(self.deaf_ns, t_ns):
            self._set(data[-1], t_ns)

    def _set(self, switches: int, t_ns: int) -> None:
        self._switches = switches
        self._history.append(
            LineStates(t_ns, adg715.selected_lines(switches), adg715.waiting_lines(switches))
        )

    def read(self, n: int, t_ns: int) -> bytes:
        """Return the switch byte."""
        del t_ns
        return bytes((self._switches,)) * n

    def between(self, t_from_ns: int, t_to_ns: int) -> list[tuple[float, LineStates]]:
        """Return the states of the lines in a span of time, each with its share of it; the shares sum to 1."""
        shares = []
        until_ns = t_to_ns
        for states in reversed(self._history):
            since_ns = states.since_ns
            if since_ns <= t_from_ns:
                shares.append(((until_ns - t_from_ns) / (t_to_ns - t_from_ns), states))
                break
            if since_ns < until_ns:
                shares.append(((until_ns - since_ns) / (t_to_ns - t_from_ns), states))
                until_ns = since_ns
        return shares
