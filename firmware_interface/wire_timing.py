"""Duration of an I2C transaction and length of a CAN frame on the wire.

On I2C a byte is nine clocks (eight bits and the acknowledge); START, repeated START and STOP are counted as one clock
each; between two transactions the bus rests for tBUF. `README.md` in this folder derives the scan period from it.
"""

#: Bus free time between STOP and START in fast mode [ns]. I2C-bus specification UM10204 rev. 7, table 11.
BUS_FREE_NS = 1300


def transaction_bits(n_write: int, n_read: int = 0) -> int:
    """Return the clock cycles of one I2C transaction: `n_write` bytes written, then `n_read` bytes read.

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


def i2c_nack_bits() -> int:
    """Return the clock cycles of an I2C transaction whose address is not acknowledged: START, one byte, STOP.

    Example:
        >>> i2c_nack_bits()
        11
    """
    return 2 + 9


def i2c_bus_time_ns(bits: int, rate_hz: int) -> int:
    """Return the duration of `bits` I2C clock cycles and of the bus free time after them [ns].

    Example:
        >>> i2c_bus_time_ns(transaction_bits(1), 400_000)
        51300
    """
    return bits * 1_000_000_000 // rate_hz + BUS_FREE_NS


#: Frames of a leg in a cycle: `Force` and `Quality`.
FRAMES_PER_LEG = 2


def max_can_frame_bits(n_data: int) -> int:
    """Return the maximum length of a frame with an 11-bit id, stuff bits and interframe space included [bits].

    Args:
        n_data: Bytes of data.

    Example:
        >>> max_can_frame_bits(8)
        135
    """
    return 8 * n_data + 47 + (34 + 8 * n_data - 1) // 4


#: Bits of a frame with eight bytes of data.
LONGEST_FRAME_BITS = max_can_frame_bits(8)

#: Frames of a leg beside Force and Quality in a second, by their bytes of data: heartbeats (1), `Fault`, `Calibration`
#: and gait events of two steps with a slip each (6), `Ground`, `Baseline` and `Identity` (8).
_OTHER_FRAMES_HZ_BY_DATA_BYTES = {1: 5, 6: 10, 8: 12}


def can_bits_per_s(n_legs: int, forces_hz: float) -> float:
    """Return the CAN bus load by all frames of a robot [bit/s].

    Args:
        n_legs: Legs of the robot.
        forces_hz: Forces of each leg in a second [Hz].

    Example:
        >>> round(can_bits_per_s(6, 92.0))
        167610
    """
    others = sum(
        per_s * max_can_frame_bits(n_data) for n_data, per_s in _OTHER_FRAMES_HZ_BY_DATA_BYTES.items()
    )
    return n_legs * (forces_hz * FRAMES_PER_LEG * LONGEST_FRAME_BITS + others)
