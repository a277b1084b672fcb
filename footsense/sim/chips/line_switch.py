"""Simulated ADG715 switch that connects the row or column lines of a foot.

Source:
    Analog Devices ADG714/ADG715 data sheet rev. B: one data byte, bit n closes switch n + 1; all open at power-up.
"""

from collections import deque
from typing import NamedTuple

from firmware_interface.chips import adg715
from footsense.sim.chips.chip import LegChip
from footsense.sim.faults.schedule import Span, in_any_span

#: Capacitance to ground of a floating row line [pF]: the electrode and a few millimetres of trace.
FLOATING_ROW_PF = 1.0


class LineStates(NamedTuple):
    """Lines that a switch selects, and those that it ties to shield or ground as unselected, from `since_ns` on.

    One bit for each row or column line; those in neither mask float.
    """

    since_ns: int
    selected_mask: int
    unselected_mask: int


class SimulatedLineSwitch(LegChip):
    """Simulated ADG715 behind a leg's mux channel: one readable data byte, all switches open at power-up.

    Args:
        address: Its address on the bus.

    Attributes:
        ignores_writes_ns: Spans in which it acknowledges its settings and ignores them [ns].
        stuck_closed: Bits that are set whatever is written.
    """

    def __init__(self, address: int = adg715.ADDRESS) -> None:
        super().__init__(address)
        self.ignores_writes_ns: list[Span] = []
        self.stuck_closed = 0
        self._switches = 0
        # A conversion looks back one conversion time at most; lines change no faster than that.
        self._history: deque[LineStates] = deque([LineStates(0, 0, 0)], maxlen=8)

    def power_up(self, t_ns: int) -> None:
        """Open all switches, as after power-on."""
        self._set_switches(0, t_ns)

    def write(self, data: bytes, t_ns: int) -> None:
        """Set all switches to the bits of the last byte."""
        if not in_any_span(self.ignores_writes_ns, t_ns):
            self._set_switches(data[-1] | self.stuck_closed, t_ns)

    def _set_switches(self, switches: int, t_ns: int) -> None:
        self._switches = switches
        selected = adg715.selected_lines(switches)
        self._history.append(LineStates(t_ns, selected, adg715.unselected_lines(switches)))

    def read(self, n: int, t_ns: int) -> bytes:
        """Return the byte of the switch states, one bit per switch, `n` times."""
        del t_ns
        return bytes((self._switches,)) * n

    def states_between(self, t_from_ns: int, t_to_ns: int) -> list[tuple[float, LineStates]]:
        """Return the line states between two times [ns], latest first, each with its share of that time."""
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
