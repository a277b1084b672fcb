"""Injected faults of the wires of a simulated I2C bus: stuck lines, lost arbitration, mux resets.

A leg that holds SDA low reaches the upstream bus through its channel of the mux, which is a switch without a buffer:
from then on no transaction passes, not even the one that would disconnect the leg. Only the RESET pin of the mux frees
the bus. Each transaction costs the timeout of the adapter.

The kernel repeats a transaction that loses arbitration as often as the adapter's `retries` say.

Source:
    TCA9548A data sheet SCPS207, section 8.4.1 (RESET input); UM10204, section 3.1.8 (arbitration).
"""

from collections import deque
from collections.abc import Mapping, Sequence

import numpy as np

from footsense.errors import I2cTimeoutError
from footsense.sim.chips.chip import SimulatedMux
from footsense.sim.clock import VirtualClock
from footsense.sim.faults.scene_faults import (
    ArbitrationLost,
    MuxKeepsChannels,
    MuxReset,
    Schedule,
    StuckSda,
    StuckUpstreamBus,
    WireFault,
)

#: Retries that `footsense/acquisition/linux_i2c.py` sets.
KERNEL_RETRIES = 3
#: Address whose bits, with that to read, release SDA for nine clocks.
_ADDRESS_OF_ONES = 0x7F
#: Time in a transaction until arbitration is lost: that of the address, at 400 kHz [ns].
_ARBITRATION_LOST_AFTER_NS = 25_000


class WireFaults:
    """Active wire faults of one I2C bus, and their effect on its transactions.

    Args:
        faults: The faults.
        channels: Mux channel of each leg.
        timeout_ns: Timeout of the adapter for a held line [ns].
        rng: Source of lost arbitrations.
        adapter_compares: Whether the adapter compares SDA with what it sends, and times out where it is held. Another
            one, as that of a Raspberry Pi 0 to 4, goes on: it reads acknowledges and zeros.
    """

    def __init__(
        self,
        faults: Sequence[WireFault],
        channels: Mapping[str, int],
        timeout_ns: int,
        rng: np.random.Generator,
        *,
        adapter_compares: bool = True,
    ) -> None:
        self._adapter_compares = adapter_compares
        self._released: list[WireFault] = []
        self._channels = dict(channels)
        self._timeout_ns = timeout_ns
        self._rng = rng
        of_lines = [fault for fault in faults if not isinstance(fault, MuxReset | MuxKeepsChannels)]
        self._faults = Schedule((fault.span_ns, fault) for fault in of_lines)
        self._resets_ns = deque(sorted(fault.at_ns for fault in faults if isinstance(fault, MuxReset)))

    def attempt_transaction(
        self, clock: VirtualClock, mux: SimulatedMux | None, host_cost_ns: int, address: int
    ) -> bool:
        """Apply the active faults to the next transaction: wait for failed attempts, return whether it succeeds.

        One that does not pass is acknowledged, has no effect, and reads zeros.

        Args:
            clock: Clock of the bus, moved by the failed attempts.
            mux: Mux of the bus, which a fault may reset; None without one.
            host_cost_ns: Cost of a transaction on the host [ns].
            address: Address of the transaction.

        Raises:
            I2cTimeoutError: SDA is held low, or arbitration was lost more often than the kernel retries.
        """
        t_ns = clock.now_ns()
        while self._resets_ns and self._resets_ns[0] <= t_ns:
            self._resets_ns.popleft()
            if mux is not None:
                mux.pulse()
        acting = self._faults.at(t_ns)
        if not acting:
            return True
        lost = [fault.rate_rel for fault in acting if isinstance(fault, ArbitrationLost)]
        selection = 1 if mux is None else mux.control
        holding = [fault for fault in acting if self._holds_sda_low(fault, selection)]
        if holding and not self._adapter_compares:
            if address == _ADDRESS_OF_ONES:
                self._released += [f for f in holding if isinstance(f, StuckSda) and f.within_byte]
            return False
        if holding:
            clock.advance_ns(host_cost_ns + self._timeout_ns)
            raise I2cTimeoutError("timeout, SDA or SCL is held low")
        for _ in range(1 + KERNEL_RETRIES):
            if not any(self._rng.random() < rate_rel for rate_rel in lost):
                return True
            clock.advance_ns(host_cost_ns + _ARBITRATION_LOST_AFTER_NS)
        raise I2cTimeoutError("arbitration lost four times")

    def _holds_sda_low(self, fault: WireFault, selection: int) -> bool:
        """Return whether an active fault holds SDA of the bus low, given the selected mux channels."""
        if fault in self._released:
            return False
        if isinstance(fault, StuckSda):
            return bool(selection >> self._channels[fault.leg] & 1)
        return isinstance(fault, StuckUpstreamBus)
