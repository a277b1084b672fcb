"""The cost of a bus's transactions, measured at start.

A Linux adapter does not report its clock, and often does not keep the configured one: on a Raspberry Pi it follows the
processor's. So two reads of one chip, a short and a long one, are timed: their difference gives the clock, the rest is
the time that interpreter, system call and interrupts add to every transaction.
"""

from collections.abc import Iterable
from statistics import median
from typing import NamedTuple

from firmware_interface.wire_timing import BUS_FREE_NS, transaction_bits
from footsense.errors import NackError
from footsense.ports import Clock, I2cBus, Transaction

_SHORT, _LONG = 1, 33  # bytes read
_TRIES = 9


class BusCosts(NamedTuple):
    """The cost of a transaction on one bus.

    Attributes:
        rate_hz: Clock of the bus [Hz].
        host_cost_ns: Time that the host adds to each transaction [ns].
    """

    rate_hz: float
    host_cost_ns: float

    def transaction_ns(self, n_write: int, n_read: int = 0) -> float:
        """Return the time of a transaction that writes and reads so many bytes [ns]."""
        return transaction_bits(n_write, n_read) * 1e9 / self.rate_hz + BUS_FREE_NS + self.host_cost_ns

    def total_ns(self, transactions: Iterable[Transaction]) -> float:
        """Return the time of several transactions [ns]."""
        return sum(self.transaction_ns(len(each.write), each.n_read) for each in transactions)


def measure(bus: I2cBus, clock: Clock, address: int) -> BusCosts:
    """Return a bus's clock and host cost, measured by short and long reads of a chip that repeats one byte.

    Args:
        bus: The adapter.
        clock: The time that it lives in.
        address: Address of a TCA9548A or an ADG715.

    Raises:
        BusError: The chip does not answer.
    """

    def transaction_ns(n_read: int) -> float:
        transaction = Transaction(address, b"", n_read)
        durations_ns = []
        lost = None
        for _ in range(_TRIES):
            start_ns = clock.now_ns()
            try:
                bus.transfer(transaction)
            except NackError as error:  # one acknowledge that is lost changes no median
                lost = error
            else:
                durations_ns.append(clock.now_ns() - start_ns)
        if lost is not None and not durations_ns:
            raise lost
        return median(durations_ns)

    short_ns, long_ns = transaction_ns(_SHORT), transaction_ns(_LONG)
    bits = transaction_bits(0, _LONG) - transaction_bits(0, _SHORT)
    bit_ns = max(long_ns - short_ns, 1.0) / bits
    host_cost_ns = short_ns - BUS_FREE_NS - transaction_bits(0, _SHORT) * bit_ns
    return BusCosts(1e9 / bit_ns, max(host_cost_ns, 0.0))
