"""Control byte of the TCA9548A eight-channel I2C mux.

Source: Texas Instruments TCA9548A data sheet SCPS207. One control byte, bit n connects channel n, several at once
are allowed; readable; 0 after power-up. A new selection takes effect at the STOP of the write, never at a repeated
START (section 8.5.4), so selecting a leg and reading it are two transactions.

With several channels connected a write reaches every chip at that address. The acknowledge is then the wired AND of
all chips: one that is missing cannot be seen in a broadcast, only by reading it alone.
"""

#: 7-bit bus address with A2 A1 A0 = 001. Not 0x70: PCA9685 servo boards answer there (ALLCALL).
ADDRESS = 0x71

N_CHANNELS = 8


def channel_control_byte(channel: int) -> int:
    """Return the control byte that connects one channel; combine several channels by bitwise OR.

    Raises:
        ValueError: There is no such channel.

    Example:
        >>> hex(channel_control_byte(0) | channel_control_byte(5))
        '0x21'
    """
    if not 0 <= channel < N_CHANNELS:
        raise ValueError(f"a TCA9548A has channels 0..{N_CHANNELS - 1}, got {channel}")
    return 1 << channel
