"""Register map of the AD7746 capacitance-to-digital converter.

Source: Analog Devices AD7745/AD7746 data sheet rev. 0; the tables named below are that document's. The converter
excites one electrode of a capacitor through EXCA and measures what arrives at CIN1: capacitance from either to ground
drops out, up to 60 pF. All registers are 8 bits wide, behind a pointer that moves on by itself; numbers of several
bytes are sent most significant byte first.
"""

from enum import IntEnum
from math import hypot, sqrt
from typing import NamedTuple

#: 7-bit bus address, not changeable.
ADDRESS = 0x48


class Ad7746Register(IntEnum):
    """Register addresses of the AD7746 (table 7)."""

    STATUS = 0x00
    CAP_DATA = 0x01  #: 3 bytes
    VT_DATA = 0x04  #: 3 bytes
    CAP_SETUP = 0x07
    VT_SETUP = 0x08
    EXC_SETUP = 0x09
    CONFIGURATION = 0x0A
    CAPDAC_A = 0x0B
    CAPDAC_B = 0x0C
    CAP_OFFSET = 0x0D  #: 2 bytes
    CAP_GAIN = 0x0F  #: 2 bytes, of the factory
    VOLT_GAIN = 0x11  #: 2 bytes, of the factory


N_REGISTERS = 0x13

#: Written instead of a register address, it resets the chip, which then does not answer for `RESET_NS`.
RESET_COMMAND = 0xBF
RESET_NS = 200_000

#: Registers CAP_SETUP to CAP_OFFSET after power-up or reset (table 7); they identify a chip that has no id.
RESET_VALUES = bytes((0x00, 0x00, 0x03, 0xA0, 0x00, 0x00, 0x80, 0x00))

# STATUS (table 8). The three ready bits are 0 when there is new data; they are 1 again once it is read.
EXCERR = 0x08  #: the excitation output cannot drive its load
NOT_RDY = 0x04  #: a conversion that was started is not done
NOT_RDYVT = 0x02
NOT_RDYCAP = 0x01
STATUS_NEVER_SET = 0xF0

CAP_ENABLE = 0x80  #: CAP_SETUP: CIN1, single-ended, no chopping
CAP_CIN2 = 0x40
#: VT_SETUP: the chip's own temperature sensor; with chopping, as specified.
TEMPERATURE_ENABLE = 0x81
VT_ENABLE = 0x80
#: EXC_SETUP: EXCA on, at half the supply, where the signal is largest against the noise.
EXCITE_A = 0x0B
EXC_A = 0x08
CAPDAC_ENABLE = 0x80  #: CAPDAC_A and CAPDAC_B

MODE_IDLE, MODE_SINGLE = 0, 2


class Ad7746Rate(NamedTuple):
    """One of the eight conversion rates, with its conversion time and noise.

    Attributes:
        code: Value of the CAPFS field.
        conversion_ns: Nominal time of one conversion [ns].
        bandwidth_hz: Its -3 dB bandwidth [Hz].
        chip_noise_ff: Noise of one conversion by the data sheet [fF rms].
    """

    code: int
    conversion_ns: int
    bandwidth_hz: float
    chip_noise_ff: float

    @property
    def noise_ff(self) -> float:
        """Expected rms noise [fF], of the chip and of the wires to a foot.

        Example:
            >>> [round(RATES[sps].noise_ff, 2) for sps in (91, 50, 9)]
            [0.93, 0.66, 0.28]
        """
        return hypot(self.chip_noise_ff, WIRE_NOISE_FF_PER_RTHZ * sqrt(self.bandwidth_hz))


#: Noise with a ribbon cable to the sensor, instead of 1.5 to 4 aF/sqrt(Hz) [fF/sqrt(Hz)] (EngineerZone, thread 88349).
WIRE_NOISE_FF_PER_RTHZ = 0.1

#: Conversion times by conversions per second, as the Linux driver names them (tables 5 and 13).
RATES = {
    91: Ad7746Rate(0, 11_000_000, 87.2, 0.0400),
    84: Ad7746Rate(1, 11_900_000, 79.0, 0.0273),
    50: Ad7746Rate(2, 20_000_000, 43.6, 0.0122),
    26: Ad7746Rate(3, 38_000_000, 21.8, 0.0073),
    16: Ad7746Rate(4, 62_000_000, 13.1, 0.0054),
    13: Ad7746Rate(5, 77_000_000, 10.5, 0.0049),
    11: Ad7746Rate(6, 92_000_000, 8.9, 0.0044),
    9: Ad7746Rate(7, 109_600_000, 8.0, 0.0042),
}

#: Conversion times of temperature and voltage by the value of VTFS [ns] (table 6).
VT_CONVERSION_NS = (20_100_000, 32_100_000, 62_100_000, 122_100_000)

#: Planning value of the deviation of a chip's clock [1]. Not specified: verify on hardware.
CLOCK_TOLERANCE_REL = 0.02

ZERO_CODE = 0x800000
CODE_MAX = 0xFFFFFF
#: Capacitance at the upper end of the codes [pF]; the lower end is its negative.
FULL_SCALE_PF = 4.096

#: One nominal step of the CAPDAC [pF]: 21 pF over 127. Full scale is specified as 17 pF at least and 21 pF typically:
#: a chip's own step may be a fifth off, and is not known before it is measured.
CAPDAC_STEP_PF = 21.0 / 127
CAPDAC_MAX = 127


def configuration(mode: int, capfs: int = 0, vtfs: int = 0) -> int:
    """Return the CONFIGURATION register byte for an operating mode and conversion times.

    Args:
        mode: MODE_SINGLE starts one conversion of the enabled channel, after which the chip is idle.
        capfs: Code of the conversion time, 0..7.
        vtfs: Index into VT_CONVERSION_NS.

    Example:
        >>> hex(configuration(MODE_SINGLE, RATES[91].code)), hex(configuration(MODE_SINGLE, RATES[9].code))
        ('0x2', '0x3a')
    """
    return vtfs << 6 | capfs << 3 | mode


def capdac(code: int) -> int:
    """Return the CAPDAC register byte that subtracts `code` steps from the input capacitance.

    Raises:
        ValueError: There is no such step.

    Example:
        >>> hex(capdac(33)), round(33 * CAPDAC_STEP_PF, 2)
        ('0xa1', 5.46)
    """
    if not 0 <= code <= CAPDAC_MAX:
        raise ValueError(f"the CAPDAC has the steps 0..{CAPDAC_MAX}, got {code}")
    return CAPDAC_ENABLE | code


def capacitance_pf(code: int) -> float:
    """Return the capacitance of a 24-bit code [pF], without the CAPDAC's part, exact in float64.

    Example:
        >>> capacitance_pf(0x800000), capacitance_pf(0x000000), capacitance_pf(0xC00000)
        (0.0, -4.096, 2.048)
    """
    return (code - ZERO_CODE) * FULL_SCALE_PF / ZERO_CODE


def temperature_c(code: int) -> float:
    """Return the chip temperature of a 24-bit code [deg C], accurate to 2 deg C.

    Example:
        >>> temperature_c(0x80C800)
        25.0
    """
    return code / 2048 - 4096
