"""Access to the legs' chips behind a mux: switched by footsense itself, or by the kernel.

Both have the same methods. A *selection* is a bit mask of channels, bit n for channel n, as in the control byte of a
TCA9548A.
"""

import contextlib
import logging
from collections.abc import Sequence

from firmware_interface.chips import adg715
from footsense.acquisition.bus_timing import BusCosts, measure_bus_costs
from footsense.acquisition.leg_connection import STUCK_BUS_PAUSE_FACTOR, STUCK_LEG_PAUSE_FACTOR, LegConnection
from footsense.errors import HardwareError, I2cError, I2cTimeoutError, NackError
from footsense.frames import Reading
from footsense.ports import Clock, I2cBus, MuxResetLine, Transaction

_log = logging.getLogger(__name__)

#: Nine clocks with SDA released: address 0x7F and the bit to read are eight ones, and no chip may acknowledge them.
#: Source: UM10204, section 3.1.16 (bus clear) and table 4 (reserved addresses).
NINE_CLOCKS = Transaction(0x7F, b"", 1)


def release_sda(bus: I2cBus) -> None:
    """Clock out the byte in which a chip was interrupted; until then it holds SDA low.

    An adapter that compares SDA with what it sends times out instead; its driver clears the bus, or nothing does. One
    that does not, as that of a Raspberry Pi 0 to 4, reads a line that stays low as an acknowledge of any address.

    Raises:
        I2cTimeoutError: SDA stays low.
        I2cError: The transaction failed otherwise.
    """
    for _ in range(2):
        try:
            bus.transfer(NINE_CLOCKS)
        except NackError:
            return
    raise I2cTimeoutError("SDA is held low: an address that no chip has is acknowledged")


class UpstreamBus:
    """I2C adapter with a TCA9548A mux that footsense switches; an unchanged selection is not written again.

    Args:
        bus: The adapter.
        mux_address: Address of the mux.
        reset_line: The mux's RESET pin; None if nothing drives it. Without it, a leg that holds a line low stops all
            legs of its bus for as long as it does.
        reads_back: Whether the selection is read back after every leg; None: where that takes no time from the scan.

    Attributes:
        broadcasts: Whether one write reaches all legs; else each leg is addressed alone.
        reads_back: As given.
        read_back: Read of the present selection; None if the kernel keeps it.
    """

    broadcasts = True

    def __init__(
        self,
        bus: I2cBus,
        mux_address: int,
        reset_line: MuxResetLine | None = None,
        *,
        reads_back: bool | None = None,
    ) -> None:
        self.bus = bus
        self.reads_back = reads_back
        self.mux_address = mux_address
        self._reset_line = reset_line
        self._selection: int | None = None
        self.read_back: Transaction | None = Transaction(mux_address, b"", n_read=1)
        self._writes = tuple(Transaction(mux_address, bytes((selection,))) for selection in range(256))

    def measure_bus_costs(self, clock: Clock) -> BusCosts:
        """Measure the duration of transactions by reads of the mux.

        Raises:
            HardwareError: The mux does not answer, or a line is stuck: no leg can be reached.
        """
        mux = f"the mux (TCA9548A) at {self.mux_address:#04x}"
        try:
            if not self.free_bus():
                self.connect(0)
            return measure_bus_costs(self.bus, clock, self.mux_address)
        except NackError as error:
            raise HardwareError(
                f"no answer from {mux}: check its power, its wires and its address straps A0..A2"
            ) from error
        except I2cError as error:
            raise HardwareError(f"{mux} cannot be reached: {error}") from error

    def connect(self, selection: int) -> I2cBus:
        """Connect exactly these mux channels; return the bus on which their chips answer.

        Raises:
            I2cError: The mux did not take it; which channels are connected is then unknown.
        """
        if selection != self._selection:
            self._selection = None
            self.bus.transfer(self._writes[selection])
            self._selection = selection
        return self.bus

    def forget_selection(self) -> None:
        """Discard the stored mux selection, so that the next one is written even if unchanged."""
        self._selection = None

    def free_bus(self) -> bool:
        """Disconnect all legs from a possibly stuck bus; return whether the mux answers again.

        A leg that holds SDA low blocks the write that would disconnect it, so that only the RESET pin helps. Without
        one, nine clocks and that write are tried all the same: the line may be released.
        """
        self._selection = None
        with contextlib.suppress(I2cError):
            if self._reset_line is not None:
                self._reset_line.pulse()
            else:
                release_sda(self.bus)
            self.connect(0)
        return self._selection is not None

    def leave_out_stuck(self, legs: Sequence[LegConnection], read: Transaction, clock: Clock) -> None:
        """After a timeout, leave out the legs that hold SDA or SCL low; all legs if the bus stays stuck.

        No answer shows which of the connected legs holds the line: the whole bus is blocked. So all are disconnected
        and asked one by one; the leg whose question times out is left out. Each costs one more adapter timeout.

        Args:
            legs: Legs in the scan.
            read: A read of a leg that changes nothing.
            clock: The time that the bus lives in.
        """
        free = self.free_bus()
        for leg in legs:
            if not free:
                why = "the bus is held low and does not get free"
                leg.leave_scan(Reading.BUS_STUCK, clock.now_ns(), why, STUCK_BUS_PAUSE_FACTOR)
                continue
            try:
                self.connect(leg.selection).transfer(read)
            except I2cTimeoutError:
                free = self.free_bus()
                leg.leave_scan(Reading.BUS_STUCK, clock.now_ns(), pause_factor=STUCK_LEG_PAUSE_FACTOR)
            except I2cError as error:  # of this leg alone, and met by the scan too
                _log.debug("leg %s: %s", leg.name, error)

    def disconnect_legs(self) -> None:
        """Disconnect all mux channels."""
        try:
            self.connect(0)
        except I2cError as error:
            _log.info("the mux at %#04x was not released: %s", self.mux_address, error)


class KernelMux:
    """Mux that the kernel switches (i2c-mux-pca954x): each leg has its own I2C adapter.

    Args:
        adapters: Adapter of each leg, by channel.
    """

    broadcasts = False
    reads_back = False

    def __init__(self, adapters: Sequence[I2cBus]) -> None:
        self.adapters = adapters
        self.read_back: Transaction | None = None
        self._adapter_of = {1 << channel: adapter for channel, adapter in enumerate(adapters)}

    def measure_bus_costs(self, clock: Clock) -> BusCosts | None:
        """Measure the duration of transactions by reads of the first line switch that answers; None if none does."""
        for adapter in self.adapters:
            with contextlib.suppress(I2cError):
                return measure_bus_costs(adapter, clock, adg715.ADDRESS)
        return None

    def connect(self, selection: int) -> I2cBus:
        """Return the I2C adapter of the selected leg; the kernel switches the mux at each transaction."""
        return self._adapter_of[selection]

    def forget_selection(self) -> None:
        """Do nothing: the kernel stores the mux selection."""

    def free_bus(self) -> bool:
        """Return True without doing anything: the kernel disconnects and recovers the bus."""
        return True

    def leave_out_stuck(self, legs: Sequence[LegConnection], read: Transaction, clock: Clock) -> None:
        """Leave out the leg whose adapter had the timeout, as no other leg was connected."""
        del read
        for leg in legs:
            leg.leave_scan(Reading.BUS_STUCK, clock.now_ns())

    def disconnect_legs(self) -> None:
        """Do nothing: the kernel switches the mux."""


Transport = UpstreamBus | KernelMux
