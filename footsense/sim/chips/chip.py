"""Interface of a simulated I2C chip, base class of the chips behind a leg's mux channel, and the mux."""

from abc import ABC, abstractmethod
from typing import Protocol

from footsense.sim.faults.schedule import Span, in_any_span


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
    """

    def __init__(self, address: int) -> None:
        self.address = address
        self.control = 0

    def acknowledges(self, t_ns: int) -> bool:
        """Return True: the mux always acknowledges."""
        del t_ns
        return True

    def write(self, data: bytes, t_ns: int) -> None:
        """Store the control byte (one bit per connected channel); called at STOP, when it takes effect."""
        del t_ns
        self.control = data[-1]

    def pulse(self) -> None:
        """Disconnect all channels, as a pulse on the RESET pin does."""
        self.control = 0

    def read(self, n: int, t_ns: int) -> bytes:
        """Return the mux's control byte, `n` times."""
        del t_ns
        return bytes((self.control,)) * n
