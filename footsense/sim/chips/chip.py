"""Interface of a simulated I2C chip, base class of the chips of a leg, the mux, and the switch of a foot's rows.

Source:
    Analog Devices ADG714/ADG715 data sheet rev. B: one data byte, bit n closes switch n + 1; all open at power-up.
"""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterator
from itertools import repeat
from typing import NamedTuple, Protocol

import numpy as np

from firmware_interface.chips import adg715
from footsense.sim.faults.disturbances import CommonNoise
from footsense.sim.faults.scene_faults import Span, in_any_span

#: Random numbers are drawn so many at a time, which is the same sequence as one by one.
_NOISE_BATCH_SIZE = 64


class SimulatedChip(Protocol):
    """Interface of a simulated I2C chip; every `t_ns` is the end of the transaction's last clock [ns]."""

    address: int

    def acknowledges(self, t_ns: int) -> bool:
        """Return whether the chip acknowledges its address at a time [ns]."""
        ...

    def write(self, data: bytes, t_ns: int) -> None:
        """Process the bytes of an I2C write."""
        ...

    def read(self, n: int, t_ns: int) -> bytes:
        """Return the next `n` bytes of an I2C read."""
        ...


class LegChip(ABC):
    """Base class of a leg's chips: answers only while the leg is connected and has its supply.

    Args:
        address: Address on the bus.

    Attributes:
        address: As given.
        absent_ns: Spans in which it does not answer [ns].
        brown_outs_ns: Times of supply dips, each of which resets it [ns].
    """

    def __init__(self, address: int) -> None:
        self.address = address
        self.absent_ns: list[Span] = []
        self.brown_outs_ns: list[float] = []

    def acknowledges(self, t_ns: int) -> bool:
        """Return whether the chip acknowledges at a time [ns], after resets by the supply dips up to then."""
        if not (self.brown_outs_ns or self.absent_ns):
            return True
        while self.brown_outs_ns and (dip_ns := min(self.brown_outs_ns)) <= t_ns:
            self.brown_outs_ns.remove(dip_ns)
            self.power_up(round(dip_ns))
        return not in_any_span(self.absent_ns, t_ns)

    @abstractmethod
    def power_up(self, t_ns: int) -> None:
        """Reset the chip to its power-up state at `t_ns` [ns]."""


class SimulatedConverter(LegChip):
    """Base class of the capacitance converters: when conversions end, and their noise.

    Args:
        address: Address on the bus.
        noise: Source of its noise; None for none.
        clock_error_rel: Relative excess of its conversion times [1].

    Attributes:
        stuck_ns: Spans in which its conversions do not finish [ns].
        hangs_ns: Times from which on it converts nothing until it is reset [ns].
        clock_factor: Its conversion times over the nominal ones [1].
    """

    def __init__(self, address: int, noise: np.random.Generator | None, clock_error_rel: float) -> None:
        super().__init__(address)
        self.stuck_ns: list[Span] = []
        self.hangs_ns: list[float] = []
        self.clock_factor = 1.0 + clock_error_rel
        self._common_noise: tuple[float, CommonNoise] | None = None
        self._white_noise = repeat(0.0) if noise is None else _unit_noise(noise)
        self._reset_ns = 0

    def power_up(self, t_ns: int) -> None:
        """Reset the chip to its power-up state at `t_ns` [ns]; it hangs no more."""
        self._reset_ns = t_ns

    def finishes(self, end_ns: int) -> bool:
        """Return whether a conversion that is to end at a time [ns] does."""
        hangs = any(self._reset_ns <= hang_ns <= end_ns for hang_ns in self.hangs_ns)
        return not (hangs or in_any_span(self.stuck_ns, end_ns))

    def share_noise(self, share_rel: float, random: np.random.Generator) -> None:
        """Make a share [1] of the variance of its noise change slowly, which all channels then have in common."""
        self._common_noise = share_rel, CommonNoise(random)

    def unit_noise(self, t_ns: int) -> float:
        """Return the noise of a conversion that ends at a time [ns], of unit variance."""
        white = next(self._white_noise)
        if self._common_noise is None:
            return white
        share_rel, common = self._common_noise
        return common.mixed_with(white, share_rel, t_ns)


def _unit_noise(noise: np.random.Generator) -> Iterator[float]:
    """Yield normal noise of standard deviation 1, drawn in batches."""
    while True:
        yield from noise.standard_normal(_NOISE_BATCH_SIZE).tolist()


class SimulatedMux:
    """Simulated TCA9548A I2C mux between an upstream bus and the legs.

    The last byte written selects its channels, effective at STOP.

    Source:
        TCA9548A data sheet SCPS207, sections 8.4.1 (RESET input) and 8.5.4 (selection at STOP).

    Args:
        address: Address on the bus.

    Attributes:
        address: As given.
        control: Control register: bit k connects channel k.
        keeps_channels_ns: Spans in which it acknowledges a control byte and keeps its channels [ns].
    """

    def __init__(self, address: int) -> None:
        self.address = address
        self.control = 0
        self.keeps_channels_ns: list[Span] = []

    def acknowledges(self, t_ns: int) -> bool:
        """Return True: the mux always acknowledges."""
        del t_ns
        return True

    def write(self, data: bytes, t_ns: int) -> None:
        """Store the control byte (one bit per connected channel); called at STOP, when it takes effect."""
        if not in_any_span(self.keeps_channels_ns, t_ns):
            self.control = data[-1]

    def pulse(self) -> None:
        """Disconnect all channels, as a pulse on the RESET pin does."""
        self.control = 0

    def read(self, n: int, t_ns: int) -> bytes:
        """Return the mux's control byte, `n` times."""
        del t_ns
        return bytes((self.control,)) * n


#: Capacitance to ground of a floating row line [pF]: the electrode and a few millimetres of trace.
FLOATING_ROW_PF = 1.0


class LineStates(NamedTuple):
    """Rows that a switch selects, and those that it ties to the shield as unselected, from `since_ns` on.

    One bit for each row line; those in neither mask float.
    """

    since_ns: int
    selected_mask: int
    unselected_mask: int


class SimulatedLineSwitch(LegChip):
    """Simulated ADG715 behind a leg's mux channel: one readable data byte, all switches open at power-up.

    Attributes:
        ignores_writes_ns: Spans in which it acknowledges its settings and ignores them [ns].
        stuck_closed: Bits that are set whatever is written.
    """

    def __init__(self) -> None:
        super().__init__(adg715.ADDRESS)
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
