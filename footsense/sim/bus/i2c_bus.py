"""A simulated I2C bus: one trunk, one mux, and the legs behind it, byte by byte and bit time by bit time.

Electrically it does what an open-drain bus does: every connected chip at the address takes part, what they send is
a wired AND, and a transaction fails only if nobody acknowledges. The mux switches at STOP, so a selection can never
act within its own transaction. Not simulated: clock stretching, signal quality.
"""

from collections.abc import Mapping, Sequence
from typing import Protocol

from firmware_interface import tca9548a
from firmware_interface.i2c_timing import nack_bits, transaction_bits, wire_time_ns
from footsense.errors import NackError
from footsense.ports import Transaction
from footsense.sim.clock import VirtualClock


class SimulatedChip(Protocol):
    """What a chip does on the bus; times are those of its last clock."""

    address: int

    def acknowledges(self, t_ns: int) -> bool:
        """Tell whether the chip answers to its address at all."""
        ...

    def write(self, data: bytes, t_ns: int) -> None:
        """Take the bytes of a write."""
        ...

    def read(self, n: int, t_ns: int) -> bytes:
        """Return the next `n` bytes."""
        ...


class SimulatedMux:
    """A TCA9548A: takes one control byte, the last one wins, and connects its channels after STOP."""

    def __init__(self, address: int) -> None:
        self.address = address
        self.control = 0

    def acknowledges(self, t_ns: int) -> bool:
        """Answer always."""
        del t_ns
        return True

    def write(self, data: bytes, t_ns: int) -> None:
        """Take the selection; the bus applies it at STOP, when this returns."""
        del t_ns
        self.control = data[-1]

    def pulse(self) -> None:
        """Take a pulse at the RESET pin: nothing is connected any more."""
        self.control = 0

    def read(self, n: int, t_ns: int) -> bytes:
        """Return the control byte, however often it is read."""
        del t_ns
        return bytes((self.control,)) * n


class SimulatedBus:
    """The adapter of one simulated trunk.

    Args:
        clock: The bus's own time, moved by every transaction.
        rate_hz: Bus clock [Hz].
        host_cost_ns: What the host adds to every transaction: interpreter, system call, interrupt [ns].
        mux: The mux on the trunk.
        legs: Chips behind each mux channel.
    """

    def __init__(
        self,
        clock: VirtualClock,
        rate_hz: int,
        host_cost_ns: int,
        mux: SimulatedMux,
        legs: Mapping[int, Sequence[SimulatedChip]],
    ) -> None:
        self._clock = clock
        self._rate_hz = rate_hz
        self._host_cost_ns = host_cost_ns
        self._mux = mux
        self._legs = {channel: tuple(chips) for channel, chips in legs.items()}
        # Every transaction asks for both.
        self._connected: dict[tuple[int, int], tuple[SimulatedChip, ...]] = {}
        self._lasts_ns: dict[tuple[int, int], int] = {}

    def transfer(self, transaction: Transaction) -> bytes:
        """Do one transaction and move the clock by what it takes.

        Raises:
            NackError: No connected chip answers to the address.
        """
        address, data, n_read = transaction
        t_start_ns = self._clock.now_ns() + self._host_cost_ns
        connected = self._connected.get((self._mux.control, address))
        if connected is None:
            connected = self._connect(address)
        chips = [chip for chip in connected if chip.acknowledges(t_start_ns)]
        if not chips:
            self._clock.sleep_until_ns(t_start_ns + wire_time_ns(nack_bits(), self._rate_hz))
            raise NackError(f"no acknowledge from {address:#04x}")
        lasts_ns = self._lasts_ns.get((len(data), n_read))
        if lasts_ns is None:
            lasts_ns = self._wire_time_ns(len(data), n_read)
        t_end_ns = t_start_ns + lasts_ns
        self._clock.advance_ns(self._host_cost_ns + lasts_ns)
        if data:
            for chip in chips:
                chip.write(data, t_end_ns)
        if n_read == 0:
            return b""
        answer = chips[0].read(n_read, t_end_ns)
        if len(chips) > 1:
            for chip in chips[1:]:
                answer = bytes(a & b for a, b in zip(answer, chip.read(n_read, t_end_ns), strict=True))
        return answer

    def close(self) -> None:
        """Nothing is held."""

    def _wire_time_ns(self, n_written: int, n_read: int) -> int:
        """Return how long a transaction lasts, and keep it [ns]."""
        lasts_ns = wire_time_ns(transaction_bits(n_written, n_read), self._rate_hz)
        return self._lasts_ns.setdefault((n_written, n_read), lasts_ns)

    def _connect(self, address: int) -> tuple[SimulatedChip, ...]:
        """Return every chip at `address` that is electrically on the trunk now, and keep them."""
        behind = [
            chip
            for channel in range(tca9548a.CHANNELS)
            if self._mux.control >> channel & 1
            for chip in self._legs.get(channel, ())
        ]
        connected = tuple(chip for chip in (self._mux, *behind) if chip.address == address)
        return self._connected.setdefault((self._mux.control, address), connected)
