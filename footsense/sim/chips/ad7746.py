"""Simulated AD7746 capacitance converter: registers, single conversions, ready bits, range, noise, temperature.

It shares only register addresses and times with the driver. Simulated:
- the address pointer advances with every byte read or written; the byte 0xBF in its place resets the chip, which then
  does not answer for 200 us;
- a single conversion converts the enabled channels, capacitance first; then the chip is idle, and the mode reads idle;
- RDYCAP and RDYVT fall with new data, RDY with all of it; they rise when the data is read, which stays until the next
  conversion ends; a write of the configuration aborts a running conversion;
- the CAPDAC subtracts its steps, whose size differs between chips; codes are limited to 0x000000 and 0xFFFFFF;
- EXCERR after a conversion with a shorted excitation;
- noise by conversion time, of the cable to the foot as well: that of the chip is a twentieth of it.
Not simulated: continuous conversion, calibration modes, CIN2, the second CAPDAC, differential input, chopping, external
temperature and voltage.

Source:
    Analog Devices AD7745/AD7746 data sheet rev. 0; `firmware_interface/chips/ad7746.py` names the tables.
"""

from collections.abc import Callable

import numpy as np

from firmware_interface.chips import ad7746 as chip
from firmware_interface.chips.ad7746 import Ad7746Register
from footsense.sim.chips.chip import SimulatedConverter

#: Smallest and largest step of a chip's CAPDAC over the nominal one [1]: 17 pF of full scale are guaranteed, 21 pF
#: typical.
CAPDAC_GAIN_RANGE_REL = (0.85, 1.2)
#: Largest error of a chip's thermometer [K].
MAX_TEMPERATURE_ERROR_K = 2.0

_RATE_OF_CODE = {rate.code: rate for rate in chip.RATES.values()}
_CAP, _VT = chip.NOT_RDYCAP, chip.NOT_RDYVT

#: Mean capacitance [pF] between EXCA and CIN1 between two times [ns], and whether EXCA was shorted to ground in it.
MeanMutualCapacitance = Callable[[int, int], tuple[float, bool]]


class SimulatedAd7746(SimulatedConverter):
    """Simulated AD7746 capacitance converter at register level, with conversions and noise.

    Args:
        mutual_capacitance: The foot between EXCA and CIN1.
        noise: Source of its noise; None for none.
        clock_error_rel: Relative excess of its conversion times [1].
        capdac_gain_rel: Size of its CAPDAC steps over the nominal one [1].
        temperature_c: Returns the reading of its thermometer at a time [ns], error included [deg C].
    """

    def __init__(
        self,
        mutual_capacitance: MeanMutualCapacitance,
        noise: np.random.Generator | None,
        clock_error_rel: float = 0.0,
        capdac_gain_rel: float = 1.0,
        temperature_c: Callable[[int], float] = lambda t_ns: 25.0,  # noqa: ARG005 - the same at any time
    ) -> None:
        super().__init__(chip.ADDRESS, noise, clock_error_rel)
        self._mutual_capacitance = mutual_capacitance
        self._capdac_step_pf = chip.CAPDAC_STEP_PF * capdac_gain_rel
        self._temperature_c = temperature_c
        self.power_up(-chip.RESET_NS)

    def acknowledges(self, t_ns: int) -> bool:
        """Return whether the chip acknowledges its address at a time [ns]: not within 200 us of a reset."""
        return super().acknowledges(t_ns) and t_ns >= self._ready_ns

    def write(self, data: bytes, t_ns: int) -> None:
        """Process written bytes: a register pointer with the values from there on, or the reset command."""
        self._finish_conversions_by(t_ns)
        if data[0] == chip.RESET_COMMAND:
            self.power_up(t_ns)
            return
        self._pointer = data[0]
        for value in data[1:]:
            if Ad7746Register.CAP_SETUP <= self._pointer < chip.N_REGISTERS:
                self._registers[self._pointer] = value
            if self._pointer == Ad7746Register.CONFIGURATION:
                self._start_conversions(t_ns)
            self._pointer += 1

    def read(self, n: int, t_ns: int) -> bytes:
        """Return `n` bytes from the register at the pointer on; bytes behind the last register read 0xFF."""
        self._finish_conversions_by(t_ns)
        # The status as it was when it was sent: what follows in the same burst clears its bits.
        answer = bytes(self._registers[self._pointer : self._pointer + n])
        read = range(self._pointer, self._pointer + n)
        for ready, data in ((_CAP, Ad7746Register.CAP_DATA), (_VT, Ad7746Register.VT_DATA)):
            if any(data <= address < data + 3 for address in read):
                self._registers[Ad7746Register.STATUS] |= ready | chip.NOT_RDY
        self._pointer += n
        return answer + b"\xff" * (n - len(answer))

    def power_up(self, t_ns: int) -> None:
        """Reset all registers to their power-up values, as a reset command does; no answer for 200 us."""
        super().power_up(t_ns)
        self._registers = bytearray(chip.N_REGISTERS)
        self._registers[Ad7746Register.STATUS] = chip.NOT_RDY | _CAP | _VT
        settings = chip.RESET_VALUES
        self._registers[Ad7746Register.CAP_SETUP : Ad7746Register.CAP_SETUP + len(settings)] = settings
        self._pointer = 0
        self._ready_ns = t_ns + chip.RESET_NS
        #: Channel, start and end of the pending conversions, in their order.
        self._running: list[tuple[int, int, int]] = []

    def _start_conversions(self, t_ns: int) -> None:
        """Abort pending conversions; in single mode, schedule one for each enabled channel."""
        self._running = []
        configuration = self._registers[Ad7746Register.CONFIGURATION]
        if configuration & 0x07 != chip.MODE_SINGLE:
            return
        enabled: list[tuple[int, int]] = []
        if self._registers[Ad7746Register.CAP_SETUP] & chip.CAP_ENABLE:
            enabled.append((_CAP, _RATE_OF_CODE[configuration >> 3 & 0x07].conversion_ns))
        if self._registers[Ad7746Register.VT_SETUP] & chip.VT_ENABLE:
            enabled.append((_VT, chip.VT_CONVERSION_NS[configuration >> 6]))
        for kind, lasts_ns in enabled:
            end_ns = t_ns + round(lasts_ns * self.clock_factor)
            self._running.append((kind, t_ns, end_ns))
            t_ns = end_ns

    def _finish_conversions_by(self, t_ns: int) -> None:
        """Store the results of all conversions that end by `t_ns` [ns]."""
        while self._running and self._running[0][2] <= t_ns:
            kind, start_ns, end_ns = self._running[0]
            if not self.finishes(end_ns):
                return
            del self._running[0]
            data = Ad7746Register.CAP_DATA if kind == _CAP else Ad7746Register.VT_DATA
            code = (
                self._convert_capacitance(start_ns, end_ns)
                if kind == _CAP
                else self._temperature_code(end_ns)
            )
            self._registers[data : data + 3] = code.to_bytes(3, "big")
            self._registers[Ad7746Register.STATUS] &= ~kind
            if not self._running:
                self._registers[Ad7746Register.STATUS] &= ~chip.NOT_RDY
                self._registers[Ad7746Register.CONFIGURATION] &= ~0x07

    def _convert_capacitance(self, start_ns: int, end_ns: int) -> int:
        """Return the code of the mean capacitance between two times [ns], noise included, and set or clear EXCERR."""
        registers = self._registers
        capacitance_pf, shorted = 0.0, False
        if (
            registers[Ad7746Register.EXC_SETUP] & chip.EXC_A
            and not registers[Ad7746Register.CAP_SETUP] & chip.CAP_CIN2
        ):
            capacitance_pf, shorted = self._mutual_capacitance(start_ns, end_ns)
        registers[Ad7746Register.STATUS] &= ~chip.EXCERR
        registers[Ad7746Register.STATUS] |= chip.EXCERR if shorted else 0
        if registers[Ad7746Register.CAPDAC_A] & chip.CAPDAC_ENABLE:
            capacitance_pf -= (registers[Ad7746Register.CAPDAC_A] & chip.CAPDAC_MAX) * self._capdac_step_pf
        rate = _RATE_OF_CODE[registers[Ad7746Register.CONFIGURATION] >> 3 & 0x07]
        capacitance_pf += rate.noise_ff * 1e-3 * self.unit_noise(end_ns)
        code = round(capacitance_pf * chip.ZERO_CODE / chip.FULL_SCALE_PF) + chip.ZERO_CODE
        return min(max(code, 0), chip.CODE_MAX)

    def _temperature_code(self, t_ns: int) -> int:
        """Return the code of the chip's temperature sensor at `t_ns`."""
        return round((self._temperature_c(t_ns) + 4096) * 2048)
