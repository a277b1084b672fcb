"""Simulated I2C bus: upstream bus, mux, and the chips of the legs behind it, in bytes and bit times.

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
from footsense.ports import I2cBus, Transaction
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
        mux: The mux on the bus.
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
        mux: SimulatedMux,
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
        connected = self._connected.get((self.mux.control, address))
        if connected is None:
            connected = self._connected_chips(address)
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

    def _connected_chips(self, address: int) -> tuple[SimulatedChip, ...]:
        """Return all connected chips at `address`, the mux included; cached per mux selection."""
        behind = [
            chip
            for channel in range(tca9548a.N_CHANNELS)
            if self.mux.control >> channel & 1
            for chip in self._legs.get(channel, ())
        ]
        connected = tuple(chip for chip in (self.mux, *behind) if chip.address == address)
        return self._connected.setdefault((self.mux.control, address), connected)


class SimulatedKernelMuxChannel:
    """One mux channel of an upstream bus as an I2C adapter of its own, as the kernel's mux driver presents it.

    A selection costs bits on the wire and no system call: the upstream bus has no host cost here, and each transaction
    adds its own.

    Args:
        upstream: The upstream bus, made without a host cost.
        clock: Clock of the upstream bus.
        mux: The mux on the upstream bus.
        channel: Channel of the leg.
        host_cost_ns: Cost of a transaction on the host [ns].
    """

    def __init__(
        self, upstream: I2cBus, clock: VirtualClock, mux: SimulatedMux, channel: int, host_cost_ns: int
    ) -> None:
        self._upstream = upstream
        self._clock = clock
        self._mux = mux
        self._selection = tca9548a.channel_control_byte(channel)
        self._host_cost_ns = host_cost_ns

    def transfer(self, transaction: Transaction) -> bytes:
        """Switch the mux to the channel if needed, do one I2C transaction, and return the bytes read.

        Raises:
            I2cError: As the upstream bus.
        """
        self._clock.advance_ns(self._host_cost_ns)
        if self._mux.control != self._selection:
            self._upstream.transfer(Transaction(self._mux.address, bytes((self._selection,))))
        return self._upstream.transfer(transaction)
