"""The time of an I2C transaction on the wire.

A byte is nine clocks (eight bits and the acknowledge); START, repeated START and STOP are counted as one clock
each; between two transactions the bus rests for tBUF. `README.md` in this folder derives the scan period from it.
"""

#: Bus free time between STOP and START in fast mode [ns]. I2C-bus specification UM10204 rev. 7, table 11.
BUS_FREE_NS = 1300


def transaction_bits(n_write: int, n_read: int = 0) -> int:
    """Return the clocks of one transaction: `n_write` bytes written, then `n_read` bytes read.

    Example:
        >>> transaction_bits(1)      # a control byte: TCA9548A, ADG715
        20
        >>> transaction_bits(3)      # a 16-bit register written: FDC1004
        38
        >>> transaction_bits(1, 2)   # a 16-bit register read
        48
        >>> transaction_bits(0, 1)   # a control byte read back
        20
    """
    if n_read == 0 or n_write == 0:
        return 2 + 9 * (1 + n_write + n_read)
    return 3 + 9 * (2 + n_write + n_read)


def nack_bits() -> int:
    """Return the clocks of a transaction whose address no chip acknowledges: START, one byte, STOP.

    Example:
        >>> nack_bits()
        11
    """
    return 2 + 9


def wire_time_ns(bits: int, rate_hz: int) -> int:
    """Return the time of `bits` clocks and of the bus free time after them [ns].

    Example:
        >>> wire_time_ns(transaction_bits(1), 400_000)
        51300
    """
    return bits * 1_000_000_000 // rate_hz + BUS_FREE_NS
