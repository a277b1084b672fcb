"""Simulated microcontroller (board `mcu`) that scans all feet, and the serial port to the service, in virtual time.

It shares only the layout of a record with the driver. Simulated: a clock that drifts and wraps; all records of a scan
in one burst, after its last conversion; bytes that arrive a record's length at a time, as on the wire. Not simulated:
delays of a USB adapter.
"""

from collections import deque
from collections.abc import Callable, Mapping

import numpy as np

from firmware_interface.can.codes import NODE_IDS
from firmware_interface.chips import fdc1004
from firmware_interface.serial_frames import (
    ELEMENTS,
    FRAME_BYTES,
    NO_VALUE_BASE,
    RECORD_BITS,
    NoValue,
    Record,
    RecordFlag,
    encode_record,
    pack_values,
)
from footsense.frames import Vector
from footsense.ports import Clock
from footsense.sim.chips.chip import LineStates
from footsense.sim.faults.damage import WiredFoot
from footsense.sim.robot import SimulatedRobot
from footsense.sim.scene import Scene

#: Share of a scan's time in which the elements are converted, one after the other.
_CONVERSION_TIME_SHARE = 0.9
_ROWS = _COLUMNS = 3
#: One row selected, the others waiting.
_SINGLE_ROW_STATES = [LineStates(0, 1 << row, 0b111 & ~(1 << row)) for row in range(_ROWS)]
#: Random stream of the noise, beside those of the legs.
_NOISE_STREAM = 6

_NS_PER_US = 1000
_AF_PER_PF = 1e6
_FULL_SCALE_AF = 2**31
_TIMER_WRAP_US = 1 << 32
#: Records of a leg with the flag of a recent start.
_N_STARTING_RECORDS = 256
#: Noise of one conversion [pF]: that of the default board at its fastest rate; no such board was measured.
_NOISE_RMS_PF = fdc1004.RATES[400].noise_ff * 1e-3
#: Relative error of its crystal [1].
_CLOCK_ERROR_REL = 40e-6

#: Capacitances of a leg's elements at a time [ns], stray included [pF], shape (9,); NaN where no converter answers.
ElementCapacitancesAt = Callable[[int], Vector]


class SimulatedRobotMcu:
    """Simulated microcontroller of a robot: scans all legs and sends one serial record per leg and scan.

    Args:
        legs: Capacitances of each leg, by its name.
        step_us: Time from element to element [us]; 0 for simultaneous conversions.
        noise: Source of its noise; None for none.

    Attributes:
        started_ns: Time of its last start, at which its clock is 0 [ns].
        n_scans: Scans since.
    """

    def __init__(
        self,
        legs: Mapping[str, ElementCapacitancesAt],
        *,
        step_us: int = 0,
        noise: np.random.Generator | None = None,
    ) -> None:
        self._legs = dict(legs)
        self._step_us = step_us
        self._noise = noise
        self.started_ns = self.n_scans = 0

    def scan(self, t_ns: int) -> bytes:
        """Return the serial records of one scan; the middle of its first conversion is at `t_ns` [ns]."""
        number, self.n_scans = self.n_scans, self.n_scans + 1
        flags = RecordFlag.STARTING if number < _N_STARTING_RECORDS else RecordFlag(0)
        t_us = round((t_ns - self.started_ns) * (1 + _CLOCK_ERROR_REL)) // _NS_PER_US % _TIMER_WRAP_US
        return b"".join(
            encode_record(
                Record(
                    leg=NODE_IDS[leg],
                    seq=number & 0xFFFF,
                    flags=flags,
                    step_us=self._step_us,
                    t_us=t_us,
                    values=pack_values(self._record_values(elements_pf, t_ns)),
                )
            )
            for leg, elements_pf in self._legs.items()
        )

    @property
    def conversion_span_ns(self) -> int:
        """Time from the first to the last conversion of a scan [ns]; the records are sent after it."""
        return (ELEMENTS - 1) * self._step_us * _NS_PER_US

    def _record_values(self, elements_pf: ElementCapacitancesAt, t_ns: int) -> list[int]:
        """Return one leg's record values: capacitances [aF], or a `NoValue` code without an answer or over range."""
        if self._step_us:
            step_ns = self._step_us * _NS_PER_US
            values_pf = np.array([elements_pf(t_ns + n * step_ns)[n] for n in range(ELEMENTS)])
        else:
            values_pf = elements_pf(t_ns)
        if self._noise is not None:
            values_pf = values_pf + self._noise.normal(0.0, _NOISE_RMS_PF, ELEMENTS)
        values_af = values_pf * _AF_PER_PF
        missing = (np.isnan(values_af), values_af >= _FULL_SCALE_AF)
        codes = (NO_VALUE_BASE + NoValue.NO_ANSWER, NO_VALUE_BASE + NoValue.OVER_RANGE)
        values: list[int] = np.select(missing, codes, values_af).round().astype(int).tolist()
        return values


def simulated_mcu(robot: SimulatedRobot, scene: Scene, rate_hz: float) -> SimulatedRobotMcu:
    """Return a simulated microcontroller that scans the feet of a simulated robot, whose I2C buses stay unused.

    Args:
        robot: The robot.
        scene: The scene.
        rate_hz: Scans per second [Hz].
    """
    noise = np.random.default_rng((scene.seed, _NOISE_STREAM)) if scene.effects.converter_noise else None
    return SimulatedRobotMcu(
        {
            name: _measured_capacitances_at(leg.wired, scene.effects.stray_pf)
            for name, leg in robot.legs.items()
        },
        step_us=round(_CONVERSION_TIME_SHARE * 1e6 / rate_hz / ELEMENTS),
        noise=noise,
    )


def _measured_capacitances_at(foot: WiredFoot, stray_pf: float) -> ElementCapacitancesAt:
    """Return a function of time [ns] that returns a foot's element capacitances [pF], scanned row by row."""

    def elements_pf(t_ns: int) -> Vector:
        element_pf = [pf + stray_pf for pf in foot.elements_pf(t_ns)]
        measured_pf = [
            foot.pin_pf(column, element_pf[column::_COLUMNS], states, t_ns)
            for states in _SINGLE_ROW_STATES
            for column in range(_COLUMNS)
        ]
        if foot.disturbances is not None:
            for n, states in enumerate(_SINGLE_ROW_STATES):
                for column in range(_COLUMNS):
                    measured_pf[_COLUMNS * n + column] += foot.disturbances.added_pf(
                        states.selected_mask, column, t_ns, t_ns + 1
                    )
        return np.array(measured_pf)

    return elements_pf


class SimulatedSerialPort:
    """Serial port at the daemon's end, fed by a simulated microcontroller.

    Args:
        mcu: The controller at the other end.
        clock: Virtual clock: a wait for bytes moves it.
        rate_hz: Scans per second.
        bits_per_s: Bits per second.

    Attributes:
        n_opened: Times that it has been opened.
    """

    def __init__(self, mcu: SimulatedRobotMcu, clock: Clock, *, rate_hz: float, bits_per_s: int) -> None:
        self.n_opened = 1
        self._mcu = mcu
        self._clock = clock
        self._period_ns = round(1e9 / rate_hz)
        self._byte_ns = RECORD_BITS * 1_000_000_000 // (FRAME_BYTES * bits_per_s)
        self._due: deque[tuple[int, bytes]] = deque()
        self._next_ns = clock.now_ns() + self._period_ns  # first conversion of the scan that comes next

    def read(self) -> bytes:
        """Return the bytes that have arrived by the present virtual time, and scan the feet whenever a scan is due."""
        now_ns = self._clock.now_ns()
        while self._next_ns + self._mcu.conversion_span_ns <= now_ns:
            self.schedule_arrival(self._mcu.scan(self._next_ns), self._next_ns)
            self._next_ns += self._period_ns
        arrived = b""
        while self._due and self._due[0][0] <= now_ns:
            arrived += self._due.popleft()[1]
        return arrived

    def wait_for_bytes_until_ns(self, t_ns: int) -> None:
        """Advance the clock to the next arrival of bytes, at the latest to `t_ns` [ns]."""
        sends_ns = self._next_ns + self._mcu.conversion_span_ns
        self._clock.sleep_until_ns(min(t_ns, self._due[0][0] if self._due else sends_ns))

    def write(self, data: bytes) -> None:
        """Discard the bytes: the simulated microcontroller takes no commands."""

    def close(self) -> None:
        """Do nothing: a simulated port holds no resources."""

    def schedule_arrival(self, data: bytes, t_ns: int) -> None:
        """Schedule the arrival of a scan's bytes, record by record; `t_ns` is the scan's first conversion [ns]."""
        sends_ns = t_ns + self._mcu.conversion_span_ns
        for end in range(FRAME_BYTES, len(data) + FRAME_BYTES, FRAME_BYTES):
            piece = data[end - FRAME_BYTES : end]
            self._due.append((sends_ns + min(end, len(data)) * self._byte_ns, piece))
