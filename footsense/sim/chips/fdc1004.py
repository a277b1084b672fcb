"""Simulated FDC1004 capacitance converter: registers, one-shot conversions, DONE bits, noise and range.

It shares only register addresses with the driver. Simulated (sections of the data sheet, SNOSCY5):
- one conversion at a time: a trigger with several measurements and no REPEAT starts none (8.5.3.1), and a trigger
  during a conversion aborts it;
- DONE_n is set when measurement n ends and cleared once its result has been read (8.5.3.4). Not said is whether that
  takes the upper register or both, whether another trigger clears it too, and whether a result that is being converted
  still reads as the old one or as 0x7FFFFF (seen: TI E2E 863522): all kinds of chip are simulated;
- after a reset results and FDC_CONF read as 0, CONF_MEASn as 0x1C00 (table 1; the last also TI E2E 793359);
- a measurement of CINa against CINb converts their difference, with CHA below CHB (8.6.1.2); other pairs start none;
- a chip that hangs converts nothing until its RST bit or its supply resets it (seen: TI E2E 404389, 801150);
- the CAPDAC subtracts its steps from the capacitance of a pin;
- the result clips at the ends of the 24-bit range; noise by rate, of which the channels may have a part in common.
Not verified, neither in the data sheet nor on a chip: that the address of a reserved register is not acknowledged; that
a measurement with CHA not below CHB starts nothing. Not simulated: REPEAT, offset and gain calibration, supply
dependence, noise and temperature of the CAPDAC.
"""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

from firmware_interface.chips import fdc1004 as chip
from footsense.errors import NackError
from footsense.sim.chips.chip import SimulatedConverter

_RATE_OF_CODE = {rate.code: rate for rate in chip.RATES.values()}
_FDC_CONF = int(chip.Fdc1004Register.FDC_CONF)
_MEAS1_MSB, _MEAS4_LSB = int(chip.Fdc1004Register.MEAS1_MSB), int(chip.Fdc1004Register.MEAS4_LSB)
_CONF_MEAS1, _GAIN_CAL_CIN4 = int(chip.Fdc1004Register.CONF_MEAS1), int(chip.Fdc1004Register.GAIN_CAL_CIN4)
_MANUFACTURER_ID = int(chip.Fdc1004Register.MANUFACTURER_ID)
_RESET, _DONE = chip.CONF_RESET.encode(1), chip.CONF_DONE.encode(0xF)

#: Mean capacitance [pF] that a CIN pin (0..3) saw to ground between two times [ns].
MeanCinCapacitance = Callable[[int, int, int], float]


class _Conversion(NamedTuple):
    """A one-shot conversion started by a write to FDC_CONF: measurement slot, nominal time [ns], noise [pF]."""

    slot: int
    nominal_duration_ns: int
    noise_rms_pf: float


@cache
def _conversion_of_word(word: int) -> _Conversion | None:
    """Return the conversion that a write of `word` to FDC_CONF starts; None if it starts none."""
    triggers = chip.CONF_TRIGGERS.decode(word)
    one_shot = triggers.bit_count() == 1 and not chip.CONF_REPEAT.decode(word)
    rate = _RATE_OF_CODE.get(chip.CONF_RATE.decode(word))
    if not one_shot or rate is None:
        return None
    return _Conversion(chip.N_SLOTS - triggers.bit_length(), rate.conversion_ns, rate.noise_ff * 1e-3)


class _Measurement(NamedTuple):
    """What a CONF_MEASn value measures: pins (0..3), the negative one None for ground, and CAPDAC steps to subtract."""

    cin: int
    negative_cin: int | None
    capdac: int


@cache
def _measurement_of_config(config: int) -> _Measurement | None:
    """Return what a CONF_MEASn value measures; None for a pair of inputs that cannot be measured."""
    positive, negative = chip.MEAS_CHA.decode(config), chip.MEAS_CHB.decode(config)
    if negative == chip.CHB_CAPDAC:
        measured = _Measurement(positive, None, chip.MEAS_CAPDAC.decode(config))
    elif negative == chip.CHB_DISABLED:
        measured = _Measurement(positive, None, 0)
    else:
        measured = _Measurement(positive, negative, 0)
    differs = measured.negative_cin is None or positive < measured.negative_cin < chip.N_SLOTS
    return measured if positive < chip.N_SLOTS and differs else None


class SimulatedFdc1004(SimulatedConverter):
    """Simulated FDC1004 capacitance converter at register level, with conversions and noise.

    Args:
        cin_capacitance_pf: Capacitance at the pins.
        noise: Source of its noise; None for none.
        clock_error_rel: Relative excess of its conversion times [1].

    Attributes:
        trigger_clears_done: Whether the trigger of a measurement clears the DONE bits of the others.
        done_needs_both_reads: Whether DONE_n stays until the lower register of a result has been read after the upper.
        keeps_old_result: Whether a result that is being converted still reads as the old one.
    """

    def __init__(
        self,
        cin_capacitance_pf: MeanCinCapacitance,
        noise: np.random.Generator | None,
        clock_error_rel: float = 0.0,
    ) -> None:
        super().__init__(chip.ADDRESS, noise, clock_error_rel)
        self.trigger_clears_done = self.done_needs_both_reads = self.keeps_old_result = False
        self._cin_capacitance_pf = cin_capacitance_pf
        self._pointer = 0
        self.power_up(0)

    def power_up(self, t_ns: int) -> None:
        """Reset registers, results and conversion to their power-up state."""
        super().power_up(t_ns)
        self._registers = dict(chip.RESET_VALUES)
        self._results = [0] * chip.N_SLOTS
        self._conf = self._done = 0
        # Slots of which the upper register was read since their results came.
        self._upper_read = 0
        self._running: _Conversion | None = None
        self._started_ns = self._ends_ns = t_ns

    def write(self, data: bytes, t_ns: int) -> None:
        """Process written bytes: a register pointer and, if two bytes follow, the register's new value.

        Raises:
            NackError: There is no such register.
        """
        self._finish_conversions_by(t_ns)
        self._pointer = data[0]
        if _GAIN_CAL_CIN4 < self._pointer < _MANUFACTURER_ID:
            raise NackError(f"no acknowledge of the register address {self._pointer:#04x}")
        if len(data) < 3:
            return
        word = data[1] << 8 | data[2]
        if self._pointer == _FDC_CONF:
            self._write_fdc_conf(word, t_ns)
        elif _CONF_MEAS1 <= self._pointer <= _GAIN_CAL_CIN4:
            self._registers[self._pointer] = word

    def read(self, n: int, t_ns: int) -> bytes:
        """Return the register at the pointer; further bytes read 0xFF, as no chip drives SDA then."""
        self._finish_conversions_by(t_ns)
        word = self._read_register(self._pointer).to_bytes(2, "big")
        return word if n == len(word) else word[:n] + b"\xff" * (n - 2)

    def _write_fdc_conf(self, word: int, t_ns: int) -> None:
        """Process a write to FDC_CONF: reset the chip, or start a conversion."""
        if word & _RESET:
            self.power_up(t_ns)
            return
        # DONE is read-only.
        self._conf = word & ~_DONE
        self._running = conversion = _conversion_of_word(word)
        if conversion is None:
            return
        measured = _measurement_of_config(self._registers[_CONF_MEAS1 + conversion.slot])
        if measured is None:
            self._running = None
            return
        if self.trigger_clears_done:
            self._done = 0
        if not self.keeps_old_result:
            self._results[conversion.slot] = chip.CODE_MAX
        self._started_ns = t_ns
        self._ends_ns = t_ns + round(conversion.nominal_duration_ns * self.clock_factor)

    def _finish_conversions_by(self, t_ns: int) -> None:
        """Store the result of the conversion, if it ends by `t_ns` [ns]."""
        conversion = self._running
        if conversion is None or t_ns < self._ends_ns or not self.finishes(self._ends_ns):
            return
        self._running = None
        self._results[conversion.slot] = self._convert(conversion)
        self._done |= chip.slot_bit(conversion.slot)
        self._upper_read &= ~chip.slot_bit(conversion.slot)

    def _convert(self, conversion: _Conversion) -> int:
        """Return the 24-bit code of a conversion, with noise, clipped to the range."""
        measured = _measurement_of_config(self._registers[_CONF_MEAS1 + conversion.slot])
        assert measured is not None
        capacitance_pf = self._cin_capacitance_pf(measured.cin, self._started_ns, self._ends_ns)
        if measured.negative_cin is not None:
            capacitance_pf -= self._cin_capacitance_pf(measured.negative_cin, self._started_ns, self._ends_ns)
        capacitance_pf -= measured.capdac * chip.CAPDAC_STEP_PF
        capacitance_pf += conversion.noise_rms_pf * self.unit_noise(self._ends_ns)
        return min(max(round(capacitance_pf * chip.CODES_PER_PF), chip.CODE_MIN), chip.CODE_MAX)

    def _read_register(self, address: int) -> int:
        if address == _FDC_CONF:
            return self._conf | chip.CONF_DONE.encode(self._done)
        if _MEAS1_MSB <= address <= _MEAS4_LSB:
            slot, lower = divmod(address, 2)
            code, bit = self._results[slot] & 0xFFFFFF, chip.slot_bit(slot)
            if lower:
                self._done &= ~(self._upper_read & bit)
                return (code & 0xFF) << 8
            self._upper_read |= bit
            if not self.done_needs_both_reads:
                self._done &= ~bit
            return code >> 8
        return self._registers.get(address, 0)
