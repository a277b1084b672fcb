"""Register map of the FDC1004 capacitance-to-digital converter.

Source: Texas Instruments FDC1004 data sheet SNOSCY5; the sections named below are that document's.
The converter measures the capacitance of one CIN pin to ground, wires included. All registers are 16 bits wide, sent
most significant byte first.
"""

from dataclasses import dataclass
from enum import IntEnum

from firmware_interface.chips.bit_field import Field

#: 7-bit bus address, not changeable. 24Cxx EEPROMs answer to it too.
ADDRESS = 0x50


class Fdc1004Register(IntEnum):
    """Register addresses of the FDC1004 (section 8.6)."""

    MEAS1_MSB = 0x00
    MEAS1_LSB = 0x01
    MEAS2_MSB = 0x02
    MEAS2_LSB = 0x03
    MEAS3_MSB = 0x04
    MEAS3_LSB = 0x05
    MEAS4_MSB = 0x06
    MEAS4_LSB = 0x07
    CONF_MEAS1 = 0x08
    CONF_MEAS2 = 0x09
    CONF_MEAS3 = 0x0A
    CONF_MEAS4 = 0x0B
    FDC_CONF = 0x0C
    OFFSET_CAL_CIN1 = 0x0D
    OFFSET_CAL_CIN4 = 0x10
    GAIN_CAL_CIN1 = 0x11
    GAIN_CAL_CIN4 = 0x14
    MANUFACTURER_ID = 0xFE
    DEVICE_ID = 0xFF


MANUFACTURER_ID = 0x5449
DEVICE_ID = 0x1004

#: Values after power-up or reset; registers that are not named here are zero.
RESET_VALUES = {
    **dict.fromkeys(range(Fdc1004Register.CONF_MEAS1, Fdc1004Register.CONF_MEAS4 + 1), 0x1C00),
    **dict.fromkeys(range(Fdc1004Register.GAIN_CAL_CIN1, Fdc1004Register.GAIN_CAL_CIN4 + 1), 0x4000),
    Fdc1004Register.MANUFACTURER_ID: MANUFACTURER_ID,
    Fdc1004Register.DEVICE_ID: DEVICE_ID,
}


# CONF_MEASn (section 8.6.1.2): what measurement n measures.
MEAS_CHA = Field(shift=13, width=3)  #: positive input, 0..3 = CIN1..CIN4
MEAS_CHB = Field(shift=10, width=3)  #: negative input, 4 = CAPDAC, 7 = disabled
MEAS_CAPDAC = Field(shift=5, width=5)
CHB_CAPDAC = 4
CHB_DISABLED = 7

# FDC_CONF (section 8.6.1.3): rate, triggers and completion.
CONF_RESET = Field(shift=15, width=1)
CONF_RATE = Field(shift=10, width=2)
CONF_REPEAT = Field(shift=8, width=1)
CONF_TRIGGERS = Field(shift=4, width=4)  #: MEAS_1 is the highest of the four bits
CONF_DONE = Field(shift=0, width=4)  #: DONE_1 is the highest of the four bits


@dataclass(frozen=True, slots=True)
class Fdc1004Rate:
    """One of the three conversion rates, with its conversion time and noise.

    Attributes:
        code: Value of the RATE field.
        conversion_ns: Nominal time of one conversion [ns].
        noise_ff: White noise of one conversion [fF rms]: at 100 S/s 30 pF / 2^16, the effective resolution of 16 bits,
            and its root with the rate.
    """

    code: int
    conversion_ns: int
    noise_ff: float


#: Conversion rates by samples per second (section 8.6.1.3). Of the two figures of noise in the electrical
#: characteristics the effective resolution is the larger: 33.2 aF/sqrt(Hz) is half of it. TI names that one (TI E2E
#: 773450), and five readings of a capacitor of 10 pF at 100 S/s vary by 0.56 fF (E2E 793359).
RATES = {
    100: Fdc1004Rate(code=1, conversion_ns=10_000_000, noise_ff=0.458),
    200: Fdc1004Rate(code=2, conversion_ns=5_000_000, noise_ff=0.648),
    400: Fdc1004Rate(code=3, conversion_ns=2_500_000, noise_ff=0.916),
}

#: Planning value of the deviation of a chip's clock [1]. Not specified: verify on hardware.
CLOCK_TOLERANCE_REL = 0.02

#: One pF in codes: the 24-bit two's complement result has 19 fractional bits (section 8.6.1.1).
CODES_PER_PF = 1 << 19
CODE_MAX = 0x7FFFFF
CODE_MIN = -0x800000
#: Least capacitance over the range [pF].
RANGE_END_PF = CODE_MAX / CODES_PER_PF

#: One nominal step of the CAPDAC [pF]. Real steps do not match well enough to be changed between tare and measurement:
#: one capacitor of 18.9 pF read 18.85 to 19.01 pF at codes 1 to 7, and 17.63 pF at code 8 (TI E2E, thread 1178477).
CAPDAC_STEP_PF = 3.125

N_SLOTS = 4


def measurement_config(cin: int) -> int:
    """Return CONF_MEASn (section 8.6.1.2) for CIN `cin` (0..3) to ground, CAPDAC off: range -16..+16 pF.

    Example:
        >>> [hex(measurement_config(cin)) for cin in range(3)]
        ['0x1c00', '0x3c00', '0x5c00']
    """
    return MEAS_CHA.encode(cin) | MEAS_CHB.encode(CHB_DISABLED)


def slot_bit(slot: int) -> int:
    """Return the bit of measurement `slot` (0..3) in the TRIGGERS and DONE fields.

    Example:
        >>> [slot_bit(s) for s in range(4)]
        [8, 4, 2, 1]
    """
    return 1 << (N_SLOTS - 1 - slot)


def trigger_config(rate: Fdc1004Rate, slot: int) -> int:
    """Return the FDC_CONF register value that starts one conversion of measurement `slot` (0..3).

    Without REPEAT only one measurement may be enabled at a time (section 8.5.3.1).

    Example:
        >>> [hex(trigger_config(RATES[400], slot)) for slot in range(3)]
        ['0xc80', '0xc40', '0xc20']
    """
    return CONF_RATE.encode(rate.code) | CONF_TRIGGERS.encode(slot_bit(slot))


def result_register(slot: int) -> Fdc1004Register:
    """Return the register with the upper 16 bits of measurement `slot`'s result."""
    return Fdc1004Register(Fdc1004Register.MEAS1_MSB + 2 * slot)


def capacitance_pf(code: int) -> float:
    """Return the capacitance of a 24-bit result code [pF], exact in float64.

    Example:
        >>> capacitance_pf(0x2B0000)
        5.375
    """
    return code / CODES_PER_PF
