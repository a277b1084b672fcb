"""Board `ad7147`: one AD7147 in a foot, which converts its nine elements in turn by itself.

Each element has an input, CIN0 to CIN8, against one electrode at ground that all elements share; CIN12 has a reference
capacitor. Without a trigger the chip converts the stages of its sequence one after the other. A leg that is found first
converts the reference: a code of the chip is off by up to a quarter, and a step of its offset by as much, each alike
for all inputs. Then it converts the elements.
Register layout: `firmware_interface/chips/ad7147.py`, with its sources.
"""

import math
from statistics import mean
from struct import Struct
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_interface.chips import ad7147 as chip
from firmware_interface.chips.ad7147 import Ad7147Register, InputConnection
from firmware_interface.conversion_order import CONVERSION_ORDERS
from footsense.acquisition.boards.board import ReadBackCheck, require_identity
from footsense.errors import HardwareError, NackError
from footsense.frames import ELEMENTS, Codes, Reading, Vector
from footsense.ports import I2cBus, Transaction

#: Element of each stage.
ORDER = CONVERSION_ORDERS["lo_shu"]
#: Input of the reference capacitor, and its capacitance [pF]: C0G, 1 %.
REFERENCE_INPUT, REFERENCE_PF = 12, 4.7
#: What inputs are tied to that are not converted: the excitation, as the shield is, so that no charge flows to them.
IDLE = InputConnection.BIAS
#: Offset that is tried first, with which the range of a nominal chip begins at `chip.RANGE_START_PF` [steps].
FIRST_OFFSET = 33
#: Stages of the sequence that converts it.
N_REFERENCE_STAGES = chip.N_STAGES
#: Sequences after a new configuration whose results are not used: the first may be junk (flow3r badge, captouch).
N_UNUSED_SEQUENCES = 2
#: Largest spread of the codes of the reference, of one sequence [1]: eight times the noise of the worst chip.
_MAX_REFERENCE_SPREAD = 100
#: Largest deviation of the reference from its capacitance, by the chip's nominal codes [1].
MAX_REFERENCE_ERROR_REL = 0.3

#: Bits from the start of a read to its first word, and of the nine results behind the status (`wire_timing`).
STATUS_AFTER_BITS, RESULTS_AFTER_STATUS_BITS = 39, 162
#: Shortest time of a bit [ns]: 444 kHz, a tenth more than the chip's limit.
SHORTEST_BIT_NS = 2250
#: Bit of a status word that is no stage's. Those above it are zero, unless a burst begins with a result: a whole burst
#: that is late by a register was seen of the AD7142 (EngineerZone 576116), and no result is so small.
_NO_STAGE = 1 << chip.N_STAGES

#: The other bits, and the words of a burst of all elements with the status behind it.
_STAGES_OR_RESULT, _BURST_AND_STATUS = 0xFFFF ^ _NO_STAGE, Struct(f">{1 + ELEMENTS + 1}H")

#: `Reading` of each code, and its nominal capacitance without what the offset takes away [pF], NaN unless it is OK.
_READINGS: Codes = np.full(chip.CODE_MAX + 1, Reading.OK, np.uint8)
_READINGS[0], _READINGS[chip.CODE_MAX] = Reading.UNDER_RANGE, Reading.OVER_RANGE
_CAPACITANCES_PF: Vector = (np.arange(chip.CODE_MAX + 1.0) - chip.CODE_MID) * chip.FF_PER_CODE * 1e-3
_CAPACITANCES_PF[_READINGS != Reading.OK] = np.nan


def _write(address: int, register: int, *words: int) -> Transaction:
    return Transaction(address, chip.write_bytes(register, *words))


class Ad7147Rate(NamedTuple):
    """The rate: the fastest, at a decimation of 64; slower ones were worse in motion and no better at rest.

    Attributes:
        conversion_ns: Nominal time of a stage [ns].
        noise_ff: White noise of a conversion [fF rms].
    """

    conversion_ns: int = chip.DECIMATIONS[64].stage_ns
    noise_ff: float = chip.NOISE_CODES * chip.FF_PER_CODE


RATE = Ad7147Rate()


class StageSequence(NamedTuple):
    """A sequence of stages.

    Attributes:
        inputs: Input of each stage.
        offsets: Offset of each stage [steps].
    """

    inputs: tuple[int, ...]
    offsets: tuple[int, ...]

    def start(self, address: int) -> tuple[Transaction, ...]:
        """Return the writes that configure the chip at an address, the last of which starts the sequence."""
        stages = (word for stage in range(len(self.inputs)) for word in self._stage(stage))
        return (
            _write(address, chip.stage_register(0), *stages),
            # The calibration engine is off; status bits are asked for, as some chips may need that.
            _write(address, Ad7147Register.PWR_CONTROL, *self._control()),
            _write(address, Ad7147Register.STAGE_COMPLETE_INT_ENABLE, (1 << len(self.inputs)) - 1),
            _write(address, Ad7147Register.AMB_COMP_CTRL0, chip.CONV_RESET.encode(1)),
        )

    def checks(self, address: int) -> tuple[ReadBackCheck, ...]:
        """Return the checks of all settings that a result depends on."""
        settings: dict[int, tuple[int, ...]] = {Ad7147Register.PWR_CONTROL: self._control()}
        settings |= {chip.stage_register(k): self._stage(k)[:3] for k in range(len(self.inputs))}
        return tuple(
            ReadBackCheck(
                Transaction(address, chip.address_bytes(register), 2 * len(words)),
                b"".join(word.to_bytes(2, "big") for word in words),
            )
            for register, words in settings.items()
        )

    def _control(self) -> tuple[int, int]:
        """Return PWR_CONTROL and STAGE_CAL_EN."""
        return chip.power_control(len(self.inputs), 64), 0

    def _stage(self, stage: int) -> tuple[int, ...]:
        """Return the registers of a stage; the last ones are limits of the calibration engine."""
        used = (*chip.connection_words(self.inputs[stage], IDLE), chip.offset_word(self.offsets[stage]))
        return (*used, *[0] * (chip.REGISTERS_PER_STAGE - len(used)))


def element_sequence(offsets: tuple[int, ...]) -> StageSequence:
    """Return the sequence of the elements with the offset of each stage [steps]."""
    return StageSequence(tuple(ORDER), offsets)


def reference_sequence(offset: int) -> StageSequence:
    """Return the sequence of the reference, half of it without offset and half with one [steps]."""
    half = N_REFERENCE_STAGES // 2
    return StageSequence((REFERENCE_INPUT,) * N_REFERENCE_STAGES, (0,) * half + (offset,) * half)


#: Resets all registers.
_RESET = chip.SW_RESET.encode(1)


def reset(address: int) -> Transaction:
    """Return the write that resets a chip."""
    return _write(address, Ad7147Register.PWR_CONTROL, _RESET)


class Calibration(NamedTuple):
    """What a chip's codes are worth.

    Attributes:
        gain_rel: Capacitance of a code over the nominal one [1].
        step_pf: What a step of the offset takes away [pF].
    """

    gain_rel: float
    step_pf: float

    def start_pf(self, offset: int) -> float:
        """Return the capacitance at which the range of a stage with an offset [steps] begins [pF]."""
        return self.step_pf * offset - self._half_range_pf

    def offset(self, start_pf: float) -> float:
        """Return the offset with which the range begins at a capacitance [pF]; no whole number [steps]."""
        return (start_pf + self._half_range_pf) / self.step_pf

    @property
    def _half_range_pf(self) -> float:
        return self.gain_rel * chip.CODE_MID * chip.FF_PER_CODE * 1e-3


def reference_calibration(answer: bytes, offset: int) -> Calibration | Reading:
    """Return what codes are worth, by a burst of `reference_sequence`.

    NOT_READY if not every stage has ended since its status was last read; CORRUPT if the codes do not agree.

    Args:
        answer: Answer to `read_results` of its stages.
        offset: Offset of half of them [steps].
    """
    status, *codes = chip.words_of(answer)
    if status & ~_NO_STAGE != (1 << N_REFERENCE_STAGES) - 1:
        return Reading.NOT_READY
    half = N_REFERENCE_STAGES // 2
    halves = codes[:half], codes[half:]
    if any(max(each) - min(each) > _MAX_REFERENCE_SPREAD for each in halves):
        return Reading.CORRUPT
    without_pf, with_pf = (1e-3 * chip.FF_PER_CODE * (mean(each) - chip.CODE_MID) for each in halves)
    without_pf = max(without_pf, 1e-3 * chip.FF_PER_CODE)  # none, if there is no capacitor
    gain_rel = REFERENCE_PF / without_pf
    return Calibration(gain_rel, gain_rel * (without_pf - with_pf) / offset)


def reference_fault(measured: Calibration) -> str:
    """Return what is wrong with a reference in words, and what to check; empty if it is as it has to be."""
    reads_pf = REFERENCE_PF / measured.gain_rel
    if abs(reads_pf / REFERENCE_PF - 1) <= MAX_REFERENCE_ERROR_REL:
        return "" if measured.step_pf > 0.0 else "its offset takes nothing away: replace the converter"
    return (
        f"its reference capacitor reads {reads_pf:.1f} pF, and has {REFERENCE_PF:g} pF; a chip is off by "
        f"{chip.GAIN_TOLERANCE_REL:.0%} at most: check the capacitor at CIN{REFERENCE_INPUT} and its joints"
    )


def best_offset(measured: Calibration) -> int:
    """Return the offset of a chip with which its range begins below elements as designed [steps]."""
    return min(round(measured.offset(chip.RANGE_START_PF)), chip.MAX_OFFSET)


def lower_offset(measured: Calibration, offset: int, reading_pf: float) -> int:
    """Return the offset of a stage whose range has to begin well below what its element reads [steps].

    Args:
        measured: What the codes of the chip are worth.
        offset: Its present offset [steps].
        reading_pf: The reading [pF]; NaN for none.
    """
    if math.isnan(reading_pf):
        return offset
    start_pf = reading_pf / chip.LEAST_OVER_RANGE_START**2
    return min(offset, max(math.floor(measured.offset(start_pf)), 0))


def read_words(results: bytes, status: bytes) -> tuple[int, list[int], int]:
    """Return the status read before results, these, and the status read behind them.

    Args:
        results: Answer to `read_results`.
        status: Answer to `read_status`.
    """
    before, *codes, behind = _BURST_AND_STATUS.unpack(results + status)
    return before & _STAGES_OR_RESULT, codes, behind & _STAGES_OR_RESULT


def decode(codes: NDArray[np.uint16], gain_rel: Vector, offset_pf: Vector) -> tuple[Codes, Vector]:
    """Return `Reading` and capacitance of codes [pF], NaN unless it is OK, same shape.

    Args:
        codes: The codes, shape (legs, elements).
        gain_rel: Gain of each leg's `Calibration`, shape (legs, 1).
        offset_pf: Capacitance of the middle code of each element [pF], shape (legs, elements).
    """
    return _READINGS.take(codes), gain_rel * _CAPACITANCES_PF.take(codes) + offset_pf


def read_status(address: int) -> Transaction:
    """Return the read of the stages that have ended since it was last read."""
    return Transaction(address, chip.address_bytes(Ad7147Register.STAGE_COMPLETE_INT_STATUS), 2)


def read_results(address: int, n_stages: int) -> Transaction:
    """Return the read of that status and of the results of the first stages, in one burst."""
    return Transaction(
        address, chip.address_bytes(Ad7147Register.STAGE_COMPLETE_INT_STATUS), 2 * (1 + n_stages)
    )


def check_identity(bus: I2cBus, address: int) -> None:
    """Raise an error unless an AD7147 answers at an address.

    Raises:
        HardwareError: No chip answers.
        WrongChipError: Another chip answers; the text names the usual cause.
        I2cError: The transaction failed otherwise.
    """
    try:
        answer = bus.transfer(Transaction(address, chip.address_bytes(Ad7147Register.DEVICE_ID), 2))
    except NackError as error:
        raise HardwareError(
            f"no answer at {address:#04x}: broken wire, no supply, or other straps ADD0, ADD1"
        ) from error
    (word,) = chip.words_of(answer)
    if word & chip.DEVICE_ID_MASK != chip.DEVICE_ID:
        require_identity(answer, "an AD7147", chip.DEVICE_ID.to_bytes(2, "big"), address, "a potentiometer")
