"""Simulated FDC1004 capacitance converter: registers, one-shot conversions, DONE bits, noise and range.

It shares only register addresses with the driver. Simulated (sections of the data sheet, SNOSCY5):
- one conversion at a time: a trigger with several measurements and no REPEAT starts none (8.5.3.1), and a trigger
  during a conversion aborts it;
- DONE_n is set when measurement n ends and cleared when its result is read (8.5.3.4); whether another trigger clears it
  too is not said: both kinds of chip are simulated;
- a result that was never converted, or is being converted, reads as 0x7FFFFF;
- the CAPDAC subtracts its steps from the capacitance of a pin;
- the result clips at the ends of the 24-bit range; white noise by rate.
Not simulated: REPEAT, offset and gain calibration, supply dependence, noise and temperature of the CAPDAC.
"""

from collections.abc import Callable, Iterator
from functools import cache
from itertools import repeat
from typing import NamedTuple

import numpy as np

from firmware_interface.chips import fdc1004 as chip
from footsense.sim.chips.chip import LegChip
from footsense.sim.faults.scene_faults import Span, in_any_span

#: Random numbers are drawn so many at a time, which is the same sequence as one by one.
_NOISE_BATCH_SIZE = 64

_RATE_OF_CODE = {rate.code: rate for rate in chip.RATES.values()}
_FDC_CONF = int(chip.Fdc1004Register.FDC_CONF)
_MEAS1_MSB, _MEAS4_LSB = int(chip.Fdc1004Register.MEAS1_MSB), int(chip.Fdc1004Register.MEAS4_LSB)
_CONF_MEAS1, _GAIN_CAL_CIN4 = int(chip.Fdc1004Register.CONF_MEAS1), int(chip.Fdc1004Register.GAIN_CAL_CIN4)
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


@cache
def _pin_and_capdac(config: int) -> tuple[int, int]:
    """Return the pin (CINx) that a CONF_MEASn value measures, and the CAPDAC steps that it subtracts."""
    takes_off = chip.MEAS_CHB.decode(config) == chip.CHB_CAPDAC
    return chip.MEAS_CHA.decode(config), chip.MEAS_CAPDAC.decode(config) if takes_off else 0


def _unit_noise(noise: np.random.Generator) -> Iterator[float]:
    """Yield normal noise of standard deviation 1, drawn in batches."""
    while True:
        yield from noise.standard_normal(_NOISE_BATCH_SIZE).tolist()


class SimulatedFdc1004(LegChip):
    """Simulated FDC1004 capacitance converter at register level, with conversions and noise.

    Args:
        cin_capacitance_pf: Capacitance at the pins.
        noise: Source of its noise; None for none.
        clock_error_rel: Relative excess of its conversion times [1].

    Attributes:
        stuck_ns: Spans in which its conversions do not finish [ns].
        clock_factor: Its conversion times over the nominal ones [1].
        trigger_clears_done: Whether the trigger of a measurement clears the DONE bits of the others.
    """

    def __init__(
        self,
        cin_capacitance_pf: MeanCinCapacitance,
        noise: np.random.Generator | None,
        clock_error_rel: float = 0.0,
    ) -> None:
        super().__init__(chip.ADDRESS)
        self.stuck_ns: list[Span] = []
        self.trigger_clears_done = False
        self._cin_capacitance_pf = cin_capacitance_pf
        self._noise = repeat(0.0) if noise is None else _unit_noise(noise)
        self.clock_factor = 1.0 + clock_error_rel
        self._pointer = 0
        self.power_up(0)

    def power_up(self, t_ns: int) -> None:
        """Reset registers, results and conversion to their power-up state."""
        self._registers = dict(chip.RESET_VALUES)
        self._results = [chip.CODE_MAX] * chip.N_SLOTS
        self._conf = 0
        self._done = 0
        self._running: _Conversion | None = None
        self._started_ns = self._ends_ns = t_ns

    def write(self, data: bytes, t_ns: int) -> None:
        """Process written bytes: a register pointer and, if two bytes follow, the register's new value."""
        self._finish_conversions_by(t_ns)
        self._pointer = data[0]
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
        if self.trigger_clears_done:
            self._done = 0
        self._results[conversion.slot] = chip.CODE_MAX
        self._started_ns = t_ns
        self._ends_ns = t_ns + round(conversion.nominal_duration_ns * self.clock_factor)

    def _finish_conversions_by(self, t_ns: int) -> None:
        """Store the result of the conversion, if it ends by `t_ns` [ns]."""
        conversion = self._running
        if conversion is None or t_ns < self._ends_ns or in_any_span(self.stuck_ns, self._ends_ns):
            return
        self._running = None
        self._results[conversion.slot] = self._convert(conversion)
        self._done |= chip.slot_bit(conversion.slot)

    def _convert(self, conversion: _Conversion) -> int:
        """Return the 24-bit code of a conversion, with noise, clipped to the range."""
        cin, capdac = _pin_and_capdac(self._registers[_CONF_MEAS1 + conversion.slot])
        capacitance_pf = self._cin_capacitance_pf(cin, self._started_ns, self._ends_ns)
        capacitance_pf -= capdac * chip.CAPDAC_STEP_PF
        capacitance_pf += conversion.noise_rms_pf * next(self._noise)
        return min(max(round(capacitance_pf * chip.CODES_PER_PF), chip.CODE_MIN), chip.CODE_MAX)

    def _read_register(self, address: int) -> int:
        if address == _FDC_CONF:
            return self._conf | chip.CONF_DONE.encode(self._done)
        if _MEAS1_MSB <= address <= _MEAS4_LSB:
            slot, lower = divmod(address, 2)
            code = self._results[slot] & 0xFFFFFF
            if lower:
                return (code & 0xFF) << 8
            self._done &= ~chip.slot_bit(slot)
            return code >> 8
        return self._registers.get(address, 0)
