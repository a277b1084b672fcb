"""Simulated AD7147 capacitance converter: registers, free-running sequencer, status bits, offset, noise and range.

It shares only register addresses with the driver. Simulated, and what shows it (the sources are those of the register
map):
- the sequencer converts stage after stage from power-up on, without an end (data sheet, table 10); a result is new when
  its stage ends; CONV_RESET starts stage 0 (flow3r);
- bit n of STAGE_COMPLETE_INT_STATUS is set when stage n ends, and cleared by a read (Linux, flow3r);
- addresses go on within a transaction (flow3r, iCub), and the last one stays for a later read (Linux); each register is
  read and written at the time its bytes are on the bus;
- a stage converts what is at its positive input less what is at its negative one and less the offset (flow3r, iCub),
  with a gain common to all inputs (EngineerZone 120875), clipped to the range; noise falls with the root of the
  decimation.

No source states this, so there are chips of each kind (`Ad7147Effects`): whether a burst is coherent, or a word
torn in its middle; whether a status bit needs its enable bit (Linux and flow3r wait for bits that they do not enable);
how many sequences after a new configuration are junk (flow3r: the first, sometimes); whether the calibration engine
moves results (Linux subtracts its ambient values itself); whether a burst can begin one register late (seen of AD7142:
EngineerZone 576116).

Assumed: another PWR_CONTROL holds from the running stage on, and stage 0 follows a shutdown; registers of stages hold
anything after power-up; a stage whose single-ended setup does not fit its inputs reads 0, one without excitation the
middle; addresses without a register read 0; the drift with temperature. Not simulated: low-power mode, which is as full
power; thresholds, proximity, and the chip's own records from 0x0E0 on.
"""

import math
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

from firmware_interface.chips import ad7147 as chip
from firmware_interface.chips.ad7147 import Ad7147Register, InputConnection
from firmware_interface.wire_timing import BUS_FREE_NS
from footsense.sim.chips.chip import SimulatedConverter
from footsense.sim.scene import Ad7147Effects

#: Mean capacitance to ground [pF] that an input (0..12) saw between two times [ns]; the second argument says what the
#: stage ties each input to.
InputCapacitance = Callable[[int, tuple[InputConnection, ...], int, int], float]

#: Change of the gain with temperature [1/K]: assumed, nothing is specified.
GAIN_DRIFT_PER_K = 2e-4
#: Sequences after which a calibration engine that moves results brings them to the middle: assumed.
_CALIBRATION_SEQUENCES = 64
#: What a junk result is off by, as an exclusive or: some hundred fF, plausible as a load.
_JUNK = 0x0555

_DECIMATION_OF_CODE = {each.code: decimation for decimation, each in chip.DECIMATIONS.items()}
_DECIMATION_OF_CODE[3] = 64  # another code of it (`AD7147_reg.h`)
_SINGLE_ENDED_SETUPS = {
    (True, False): chip.SETUP_POSITIVE,
    (False, True): chip.SETUP_NEGATIVE,
    (True, True): chip.SETUP_DIFFERENTIAL,
}
_PWR_CONTROL, _AMB_COMP_CTRL0 = int(Ad7147Register.PWR_CONTROL), int(Ad7147Register.AMB_COMP_CTRL0)
_STATUS, _RESULTS = int(Ad7147Register.STAGE_COMPLETE_INT_STATUS), int(Ad7147Register.CDC_RESULT_S0)
_STAGES, _RECORDS = int(Ad7147Register.STAGE0_CONNECTION), chip.stage_register(chip.N_STAGES)
_WRITABLE = (*range(Ad7147Register.STAGE_LOW_INT_STATUS), *range(_STAGES, _RECORDS))
#: Any values: those of stages after power-up.
_POWER_UP_STAGES = {register: register * 0x9E37 & 0xFFFF for register in range(_STAGES, _RECORDS)}


class _Control(NamedTuple):
    """PWR_CONTROL: whether anything is converted, stages of a sequence, decimation and nominal time of a stage [ns]."""

    runs: bool
    excites: bool
    n_stages: int
    decimation: int
    stage_ns: int


@cache
def _control_of_word(word: int) -> _Control:
    """Return what a value of PWR_CONTROL asks for."""
    decimation = _DECIMATION_OF_CODE[chip.DECIMATION.decode(word)]
    return _Control(
        runs=chip.POWER_MODE.decode(word) in (chip.POWER_MODE_FULL, chip.POWER_MODE_LOW),
        excites=not chip.NO_EXCITATION.decode(word),
        n_stages=min(chip.LAST_STAGE.decode(word) + 1, chip.N_STAGES),
        decimation=decimation,
        stage_ns=chip.DECIMATIONS[decimation].stage_ns,
    )


class _Stage(NamedTuple):
    """What a stage converts: all connections, inputs at either side, steps of offset; and whether its setup fits."""

    connections: tuple[InputConnection, ...]
    positive: tuple[int, ...]
    negative: tuple[int, ...]
    offset: int
    fits: bool


@cache
def _stage_of_words(low: int, high: int, offset: int) -> _Stage:
    """Return what a stage converts with its two connection registers and its AFE_OFFSET."""
    words = low & 0x3FFF | (high & 0xFFF) << 14
    connections = tuple(InputConnection(words >> 2 * cin & 3) for cin in range(chip.N_INPUTS))
    positive, negative = (
        tuple(cin for cin, connection in enumerate(connections) if connection == side)
        for side in (InputConnection.CDC_POSITIVE, InputConnection.CDC_NEGATIVE)
    )
    steps = 0
    for dac, swap, disable, sign in (
        (chip.POSITIVE_OFFSET, chip.POSITIVE_OFFSET_SWAP, chip.POSITIVE_OFFSET_DISABLE, 1),
        (chip.NEGATIVE_OFFSET, chip.NEGATIVE_OFFSET_SWAP, chip.NEGATIVE_OFFSET_DISABLE, -1),
    ):
        if not disable.decode(high):
            steps += dac.decode(offset) * (-sign if swap.decode(offset) else sign)
    setup = _SINGLE_ENDED_SETUPS.get((bool(positive), bool(negative)))
    return _Stage(connections, positive, negative, steps, setup == chip.SINGLE_ENDED_SETUP.decode(high))


class SimulatedAd7147(SimulatedConverter):
    """Simulated AD7147 capacitance converter at register level, with its sequencer, conversions and noise.

    Args:
        input_capacitance_pf: Capacitance at the inputs.
        noise: Source of its noise; None for none.
        clock_error_rel: Relative excess of its conversion times [1].
        address: Its address on the bus, by its straps.
        effects: What kind of chip it is; the spans of gain and offset in it are not used.
        gain_rel: Relative excess of its gain without a change of temperature [1].
        offset_rel: Relative excess of the steps of its offset [1].
        temperature_change_k: Change of its temperature [K] at a time [ns]; None for none.
        bus_clock_hz: Clock of its bus, by which each byte is timed [Hz].
        shifts: Source of bursts that begin one register late; None for none.
    """

    def __init__(
        self,
        input_capacitance_pf: InputCapacitance,
        noise: np.random.Generator | None,
        clock_error_rel: float = 0.0,
        *,
        address: int = chip.ADDRESSES[0],
        effects: Ad7147Effects | None = None,
        gain_rel: float = 0.0,
        offset_rel: float = 0.0,
        temperature_change_k: Callable[[int], float] | None = None,
        bus_clock_hz: int = 400_000,
        shifts: np.random.Generator | None = None,
    ) -> None:
        super().__init__(address, noise, clock_error_rel)
        self._input_capacitance_pf = input_capacitance_pf
        self._effects = effects or Ad7147Effects()
        self._codes_per_pf = (1.0 + gain_rel) * 1e3 / chip.FF_PER_CODE
        self._offset_step_pf = (1.0 + offset_rel) * chip.OFFSET_STEP_PF
        self._temperature_change_k = temperature_change_k
        self._bit_ns = 1e9 / bus_clock_hz
        self._shifts = shifts
        self._pointer = 0
        self.power_up(0)

    def power_up(self, t_ns: int) -> None:
        """Reset registers, results and sequencer to their power-up state."""
        super().power_up(t_ns)
        self._registers = {**chip.RESET_VALUES, **_POWER_UP_STAGES}
        self._results = [0] * chip.N_STAGES
        self._moved = [0] * chip.N_STAGES
        self._completed = 0
        self._control = _control_of_word(0)
        self._configured()
        self._start_sequence(t_ns)

    def write(self, data: bytes, t_ns: int) -> None:
        """Process written bytes: a register address, and values of the registers from there on."""
        self._pointer = int.from_bytes(data[:2], "big")
        for k in range(2, len(data) - 1, 2):
            end_ns = t_ns - BUS_FREE_NS - round((1 + 9 * (len(data) - k - 2)) * self._bit_ns)
            self._advance(end_ns)
            self._write_register(self._pointer, int.from_bytes(data[k : k + 2], "big"), end_ns)
            self._pointer += 1

    def read(self, n: int, t_ns: int) -> bytes:
        """Return `n` bytes of the registers from the last address on."""
        if self._shifts is not None and n > 2 and self._shifts.random() < self._effects.shifted_burst_rel:
            self._pointer += 1
        start_ns = t_ns - BUS_FREE_NS - round((1 + 9 * n) * self._bit_ns)
        answer = bytearray()
        for k in range(0, n, 2):
            if k == 0 or not self._effects.coherent_bursts:
                self._advance(start_ns + round(9 * k * self._bit_ns))
            word = self._read_register(self._pointer)
            if self._effects.torn_words and not self._effects.coherent_bursts and self._pointer != _STATUS:
                self._advance(start_ns + round(9 * (k + 1) * self._bit_ns))
                word = word & 0xFF00 | self._read_register(self._pointer) & 0x00FF
            answer += word.to_bytes(2, "big")
            self._pointer += 1
        return bytes(answer[:n])

    def _register(self, address: int) -> int:
        return self._registers.get(address, 0)

    def _configured(self) -> None:
        """Let the next sequences be junk."""
        self._ended = 0

    def _start_sequence(self, t_ns: int) -> None:
        self._stage, self._started_ns = 0, t_ns

    def _write_register(self, address: int, word: int, t_ns: int) -> None:
        if address not in _WRITABLE:
            return
        self._registers[address] = word
        if address == _PWR_CONTROL:
            if chip.SW_RESET.decode(word):
                self.power_up(t_ns)
                return
            if not self._control.runs:
                self._start_sequence(t_ns)
            self._control = _control_of_word(word)
            self._configured()
        elif address == _AMB_COMP_CTRL0 and chip.CONV_RESET.decode(word):
            self._registers[address] = word & ~chip.CONV_RESET.encode(1)
            self._configured()
            self._start_sequence(t_ns)
        elif address >= _STAGES:
            self._configured()

    def _read_register(self, address: int) -> int:
        if address == _STATUS:
            completed, self._completed = self._completed, 0
            return completed
        if 0 <= address - _RESULTS < chip.N_STAGES:
            return self._results[address - _RESULTS]
        return self._register(address)

    def _advance(self, t_ns: int) -> None:
        """End the stages that end by a time [ns]."""
        stage_ns, n_stages = round(self._control.stage_ns * self.clock_factor), self._control.n_stages
        if not self._control.runs or t_ns < self._started_ns + stage_ns:
            return
        # Of sequences that nobody read the last two leave all that can be seen, unless some of them do not end.
        unread = (t_ns - self._started_ns) // (n_stages * stage_ns) - 2
        if unread > 0 and not (self.stuck_ns or self.hangs_ns):
            self._started_ns += unread * n_stages * stage_ns
            self._ended += unread * n_stages
        while (end_ns := self._started_ns + stage_ns) <= t_ns:
            if self.finishes(end_ns):
                self._end_stage(self._stage, end_ns)
            self._ended += 1
            self._started_ns = end_ns
            self._stage = self._stage + 1 if self._stage + 1 < n_stages else 0

    def _end_stage(self, stage: int, end_ns: int) -> None:
        """Store the result of a stage and set its status bit."""
        code = self._convert(stage, end_ns)
        calibrates = self._register(Ad7147Register.STAGE_CAL_EN) >> stage & 1
        sequence = self._ended // self._control.n_stages
        if calibrates and self._effects.calibration_moves_results:
            if sequence % _CALIBRATION_SEQUENCES == _CALIBRATION_SEQUENCES - 1:
                self._moved[stage] = chip.CODE_MID - code
            code = min(max(code + self._moved[stage], 0), chip.CODE_MAX)
        self._results[stage] = code ^ _JUNK if sequence < self._effects.junk_sequences else code
        enabled = self._register(Ad7147Register.STAGE_COMPLETE_INT_ENABLE) >> stage & 1
        if enabled or not self._effects.complete_needs_enable:
            self._completed |= 1 << stage

    def _convert(self, stage: int, end_ns: int) -> int:
        """Return the code of a stage that ends at a time [ns], with noise, clipped to the range."""
        registers, first = self._registers, _STAGES + chip.REGISTERS_PER_STAGE * stage
        what = _stage_of_words(registers[first], registers[first + 1], registers[first + 2])
        if not what.fits:
            return 0
        if not self._control.excites:
            return chip.CODE_MID
        pf = self._offset_step_pf * -what.offset
        for inputs, sign in ((what.positive, 1.0), (what.negative, -1.0)):
            for cin in inputs:
                pf += sign * self._input_capacitance_pf(cin, what.connections, self._started_ns, end_ns)
        pf += (
            self._effects.noise_ff * 1e-3 * math.sqrt(64 / self._control.decimation) * self.unit_noise(end_ns)
        )
        if self._temperature_change_k is not None:
            pf *= 1.0 + GAIN_DRIFT_PER_K * self._temperature_change_k(end_ns)
        return min(max(round(chip.CODE_MID + pf * self._codes_per_pf), 0), chip.CODE_MAX)
