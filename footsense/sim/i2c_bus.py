"""Simulated I2C bus: adapter, mux, and the chips of the legs behind it, in bytes and bit times.

The bus is open-drain: every connected chip at an address takes part, their answers are a wired AND, and a transaction
fails only if no chip acknowledges. The mux switches at STOP, so that a selection never acts within its own transaction.
Not simulated: clock stretching, signal quality.

Source:
    UM10204 (I2C-bus specification), section 3.1; TCA9548A data sheet SCPS207, section 8.5.4 (switching at STOP).
"""

from collections.abc import Mapping, Sequence
from functools import cache

from firmware_interface.chips import tca9548a
from firmware_interface.wire_timing import i2c_bus_time_ns, i2c_nack_bits, transaction_bits
from footsense.errors import NackError
from footsense.ports import Transaction
from footsense.sim.chips.chip import SimulatedChip, SimulatedMux
from footsense.sim.clock import VirtualClock
from footsense.sim.faults.wire_faults import WireFaults


@cache
def _transaction_time_ns(n_written: int, n_read: int, rate_hz: int) -> int:
    """Return the duration of a transaction on the wire [ns], from its numbers of written and read bytes."""
    return i2c_bus_time_ns(transaction_bits(n_written, n_read), rate_hz)


class SimulatedBus:
    """Simulated I2C adapter of an upstream bus, with the mux and the legs' chips behind it.

    Args:
        clock: Clock of the bus, moved by every transaction.
        rate_hz: Bus clock [Hz].
        host_cost_ns: Cost of a transaction on the host: interpreter, system call, interrupt [ns].
        mux: The mux on the bus; None for one leg, of channel 0, directly on it.
        legs: Chips behind each mux channel.
        faults: Faults of the wires; None for none.

    Attributes:
        clock: As given.
        mux: As given.
    """

    def __init__(
        self,
        clock: VirtualClock,
        rate_hz: int,
        host_cost_ns: int,
        mux: SimulatedMux | None,
        legs: Mapping[int, Sequence[SimulatedChip]],
        faults: WireFaults | None = None,
    ) -> None:
        self.clock = clock
        self.mux = mux
        self._rate_hz = rate_hz
        self._host_cost_ns = host_cost_ns
        self._faults = faults
        self._legs = {channel: tuple(chips) for channel, chips in legs.items()}
        # Chips by control register and address, looked up in every transaction.
        self._connected: dict[tuple[int, int], tuple[SimulatedChip, ...]] = {}

    def transfer(self, transaction: Transaction) -> bytes:
        """Do one I2C transaction, advance the virtual clock by the duration, and return the bytes read.

        Raises:
            NackError: No connected chip acknowledges the address.
            I2cError: A fault of the wires prevents it.
        """
        address, data, n_read = transaction
        if self._faults is not None and not self._faults.attempt_transaction(
            self.clock, self.mux, self._host_cost_ns, address
        ):
            self.clock.advance_ns(self._host_cost_ns + _transaction_time_ns(len(data), n_read, self._rate_hz))
            return bytes(n_read)
        t_start_ns = self.clock.now_ns() + self._host_cost_ns
        selection = 1 if self.mux is None else self.mux.control
        connected = self._connected.get((selection, address))
        if connected is None:
            connected = self._connected_chips(selection, address)
        chips = [chip for chip in connected if chip.acknowledges(t_start_ns)]
        if not chips:
            self.clock.sleep_until_ns(t_start_ns + i2c_bus_time_ns(i2c_nack_bits(), self._rate_hz))
            raise NackError(f"no acknowledge from {address:#04x}")
        t_end_ns = t_start_ns + _transaction_time_ns(len(data), n_read, self._rate_hz)
        self.clock.sleep_until_ns(t_end_ns)
        if data:
            for chip in chips:
                chip.write(data, t_end_ns)
        if n_read == 0:
            return b""
        answer = chips[0].read(n_read, t_end_ns)
        for chip in chips[1:]:
            answer = bytes(a & b for a, b in zip(answer, chip.read(n_read, t_end_ns), strict=True))
        return answer

    def _connected_chips(self, selection: int, address: int) -> tuple[SimulatedChip, ...]:
        """Return all connected chips at `address`, the mux included; cached per mux selection."""
        behind = [
            chip
            for channel in range(tca9548a.N_CHANNELS)
            if selection >> channel & 1
            for chip in self._legs.get(channel, ())
        ]
        upstream = () if self.mux is None else (self.mux,)
        connected = tuple(chip for chip in (*upstream, *behind) if chip.address == address)
        return self._connected.setdefault((selection, address), connected)
