"""Register map of the AD7147 capacitance-to-digital converter, variant AD7147-1 with I2C.

The converter measures the capacitance of its inputs CIN0..CIN12 to ground. A sequencer converts up to 12 stages in turn
and starts again, without an end; each stage has a result register and says which inputs it converts and what the others
are tied to. Register addresses and registers are 16 bits wide, sent most significant byte first; reads and writes of
several registers go on at the next address.

Source:
    Analog Devices AD7147 data sheet rev. 0: table 10 (conversion times), "Capacitance Sensor Offset Control". Addresses
    and fields are those on which public drivers agree: Linux `drivers/input/misc/ad714x.c`; flow3r badge
    `flow3r_bsp_ad7147_hw.c` (fields of PWR_CONTROL, connections and AFE offset); iCub skin `embot_hw_ad7147.cpp` (reset
    values, connections); ModularElectronics `AD7147_reg.h` (values of fields, after the data sheet); Analog Devices
    `adi_ad7147.h` (fields, last register address).
"""

from dataclasses import dataclass
from enum import IntEnum
from struct import Struct

from firmware_interface.chips.bit_field import Field

#: 7-bit bus address, by the straps ADD1 (upper bit) and ADD0: 0x2C for 00 to 0x2F for 11.
ADDRESSES = (0x2C, 0x2D, 0x2E, 0x2F)

N_INPUTS = 13
N_STAGES = 12


class Ad7147Register(IntEnum):
    """Register addresses of the AD7147 (`adi_ad7147.h`, `ad714x.c`)."""

    PWR_CONTROL = 0x000
    STAGE_CAL_EN = 0x001
    AMB_COMP_CTRL0 = 0x002
    AMB_COMP_CTRL1 = 0x003
    AMB_COMP_CTRL2 = 0x004
    STAGE_LOW_INT_ENABLE = 0x005
    STAGE_HIGH_INT_ENABLE = 0x006
    STAGE_COMPLETE_INT_ENABLE = 0x007
    STAGE_LOW_INT_STATUS = 0x008
    STAGE_HIGH_INT_STATUS = 0x009
    STAGE_COMPLETE_INT_STATUS = 0x00A  #: bit n: stage n has ended since the last read; a read clears it
    CDC_RESULT_S0 = 0x00B  #: results of stages 0..11 up to 0x016
    DEVICE_ID = 0x017
    PROXIMITY_STATUS = 0x042
    STAGE0_CONNECTION = 0x080  #: eight registers a stage up to 0x0DF


#: Registers of a stage from its first one on: CONNECTION(6:0), CONNECTION(12:7), AFE_OFFSET, SENSITIVITY, OFFSET_LOW,
#: OFFSET_HIGH, OFFSET_HIGH_CLAMP, OFFSET_LOW_CLAMP. The last five belong to thresholds of touch alone.
REGISTERS_PER_STAGE = 8

#: Last address that exists; from 0x0E0 on the chip keeps its own records of each stage (`adi_ad7147.h`).
LAST_REGISTER = 0x28F

#: DEVICE_ID without its lowest four bits, which are the revision (`ad714x.c`); iCub's chips read 0x1471.
DEVICE_ID = 0x1470
DEVICE_ID_MASK = 0xFFF0

#: Values after power-up or reset; other registers below 0x080 are zero (those of AMB_COMP_CTRL: iCub). The registers of
#: stages are RAM: no source gives a value.
RESET_VALUES: dict[int, int] = {
    Ad7147Register.AMB_COMP_CTRL0: 0x0FF0,
    Ad7147Register.AMB_COMP_CTRL1: 0x0164,
    Ad7147Register.AMB_COMP_CTRL2: 0xFFFF,
    Ad7147Register.DEVICE_ID: DEVICE_ID | 1,
}

# PWR_CONTROL (flow3r, `AD7147_reg.h`).
POWER_MODE = Field(shift=0, width=2)
LAST_STAGE = Field(shift=4, width=4)  #: SEQUENCE_STAGE_NUM: stages of a sequence minus one
DECIMATION = Field(shift=8, width=2)
SW_RESET = Field(shift=10, width=1)
INT_POLARITY = Field(shift=11, width=1)
NO_EXCITATION = Field(shift=12, width=1)  #: EXT_SOURCE: 1 turns the excitation off
CDC_BIAS = Field(shift=14, width=2)

POWER_MODE_FULL, POWER_MODE_SHUTDOWN, POWER_MODE_LOW = 0, 1, 2  #: 3 is a shutdown, too

# STAGE_CAL_EN: bit n turns the calibration engine on for stage n; the upper four bits set its rate.
STAGE_CALIBRATION = Field(shift=0, width=12)

# AMB_COMP_CTRL0 (flow3r, `AD7147_reg.h`).
FORCED_CALIBRATION = Field(shift=14, width=1)
CONV_RESET = Field(shift=15, width=1)  #: starts the sequence at stage 0; clears itself

# CONNECTION(12:7) of a stage, above the connections of CIN7 to CIN12.
SINGLE_ENDED_SETUP = Field(shift=12, width=2)
NEGATIVE_OFFSET_DISABLE = Field(shift=14, width=1)
POSITIVE_OFFSET_DISABLE = Field(shift=15, width=1)

#: Values of `SINGLE_ENDED_SETUP` (`AD7147_reg.h`); 0 is not to be used.
SETUP_POSITIVE, SETUP_NEGATIVE, SETUP_DIFFERENTIAL = 1, 2, 3

# AFE_OFFSET of a stage: capacitance that two DACs take away, in steps. The positive DAC acts at the positive input of
# the converter, the negative one at its negative input; a swap bit moves a DAC to the other input. What acts at the
# positive input lowers the code (flow3r, iCub).
NEGATIVE_OFFSET = Field(shift=0, width=6)
NEGATIVE_OFFSET_SWAP = Field(shift=7, width=1)
POSITIVE_OFFSET = Field(shift=8, width=6)
POSITIVE_OFFSET_SWAP = Field(shift=15, width=1)


class InputConnection(IntEnum):
    """What a stage ties an input to: two bits of its connection registers (flow3r, `AD7147_reg.h`).

    BIAS carries the excitation, as ACSHIELD does: the data sheet's way for inputs that are not converted. flow3r floats
    them, against crosstalk.
    """

    FLOATING = 0
    CDC_NEGATIVE = 1
    CDC_POSITIVE = 2
    BIAS = 3


@dataclass(frozen=True, slots=True)
class Ad7147Decimation:
    """One of the three lengths of a conversion.

    Attributes:
        code: Value of the DECIMATION field.
        stage_ns: Nominal time of a stage [ns].
    """

    code: int
    stage_ns: int


#: Lengths of a conversion by their decimation (table 10; 36.864 ms for 12 stages at 256 in iCub's documentation).
DECIMATIONS = {
    64: Ad7147Decimation(code=2, stage_ns=768_000),
    128: Ad7147Decimation(code=1, stage_ns=1_536_000),
    256: Ad7147Decimation(code=0, stage_ns=3_072_000),
}

#: Planning value of the deviation of a chip's oscillator [1]. Not confirmed: verify on hardware.
CLOCK_TOLERANCE_REL = 0.04

#: Nominal code of no capacitance, and of the ends of the range (Analog Devices, EngineerZone 120875).
CODE_MID, CODE_MAX = 0x8000, 0xFFFF

#: Nominal capacitance of a code [fF]: 16 pF over 2^16. It is common to all inputs of a chip, and off by up to 25 %
#: (EngineerZone 120875); 0.32 to 0.33 fF follows from what users saw of a step of the offset (24533, flow3r).
FF_PER_CODE = 16_000 / 65536
GAIN_TOLERANCE_REL = 0.25

#: White noise of a conversion at a decimation of 64 [codes rms]. Not confirmed by a source.
NOISE_CODES = 1.1

#: Nominal step of an offset DAC [pF], and its largest setting, 20 pF ("Capacitance Sensor Offset Control"). A step was
#: seen to be 970 (flow3r) to 1000 codes (EngineerZone 24533) instead of 1311: measure it, or leave the setting alone.
OFFSET_STEP_PF = 0.32
MAX_OFFSET = 63

#: Capacitances of an element that are converted [pF]. The offset is chosen so that they begin below the 4 pF of an
#: unloaded one; they end there or beyond, whatever a code of the chip is worth.
RANGE_START_PF = 2.6
#: Least capacitance of an element over the start of its range [1]: gaps are made up to a quarter wider than designed.
LEAST_OVER_RANGE_START = 1.25
RANGE_END_PF = RANGE_START_PF + 2 * CODE_MID * FF_PER_CODE * 1e-3 * (1 - GAIN_TOLERANCE_REL)


def power_control(n_stages: int, decimation: int) -> int:
    """Return PWR_CONTROL for a free-running sequence of `n_stages` (1..12) at full power.

    Args:
        n_stages: Stages of the sequence.
        decimation: 64, 128 or 256.

    Example:
        >>> hex(power_control(12, 256)), hex(power_control(9, 64))
        ('0xb0', '0x280')
    """
    return LAST_STAGE.encode(n_stages - 1) | DECIMATION.encode(DECIMATIONS[decimation].code)


def connection_words(cin: int, idle: InputConnection) -> tuple[int, int]:
    """Return the connection registers (6:0) and (12:7) of a stage that converts one input, single-ended.

    Args:
        cin: The input, 0..12, at the positive input of the converter.
        idle: What the other inputs are tied to.

    Example:
        >>> [hex(word) for word in connection_words(6, InputConnection.BIAS)]
        ['0x2fff', '0x1fff']
        >>> [hex(word) for word in connection_words(12, InputConnection.FLOATING)]
        ['0x0', '0x1800']
    """
    connections = [InputConnection.CDC_POSITIVE if each == cin else idle for each in range(N_INPUTS)]
    low = sum(connection << 2 * k for k, connection in enumerate(connections[:7]))
    high = sum(connection << 2 * k for k, connection in enumerate(connections[7:]))
    return low, high | SINGLE_ENDED_SETUP.encode(SETUP_POSITIVE)


def offset_word(offset: int) -> int:
    """Return AFE_OFFSET of a stage that takes `offset` (0..63) steps away at the positive input.

    Example:
        >>> hex(offset_word(32))
        '0x2000'
    """
    return POSITIVE_OFFSET.encode(offset)


def stage_register(stage: int) -> int:
    """Return the first register of a stage (0..11).

    Example:
        >>> hex(stage_register(11))
        '0xd8'
    """
    return Ad7147Register.STAGE0_CONNECTION + REGISTERS_PER_STAGE * stage


def result_register(stage: int) -> int:
    """Return the result register of a stage (0..11)."""
    return Ad7147Register.CDC_RESULT_S0 + stage


def address_bytes(register: int) -> bytes:
    """Return the bytes written before a read from `register` on.

    Example:
        >>> address_bytes(0x00A).hex()
        '000a'
    """
    return register.to_bytes(2, "big")


def write_bytes(register: int, *words: int) -> bytes:
    """Return the bytes of a transaction that writes registers from `register` on.

    Example:
        >>> write_bytes(0x080, 0x2FFF, 0x1FFF).hex()
        '00802fff1fff'
    """
    return b"".join(word.to_bytes(2, "big") for word in (register, *words))


#: Words of a read of so many registers; the longest is of all registers of the stages.
_WORDS = tuple(Struct(f">{n}H") for n in range(1 + REGISTERS_PER_STAGE * N_STAGES))


def words_of(data: bytes) -> tuple[int, ...]:
    """Return the registers of a read.

    Example:
        >>> words_of(bytes.fromhex("01ff8000"))
        (511, 32768)
    """
    return _WORDS[len(data) // 2].unpack(data)


def capacitance_pf(code: int) -> float:
    """Return the nominal capacitance of a code, what the offset takes away not included [pF].

    Example:
        >>> capacitance_pf(0xC000), capacitance_pf(0x8000)
        (4.0, 0.0)
    """
    return (code - CODE_MID) * FF_PER_CODE * 1e-3
