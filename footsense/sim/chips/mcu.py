"""A simulated microcontroller that scans feet by itself.

It shares only the layout of a record with the driver. Simulated: a clock that starts at any value, drifts and wraps;
sequence numbers that restart with a reset; all records of a scan in one burst, after its last conversion.
"""

from collections.abc import Callable, Mapping

import numpy as np

from firmware_interface.can_codes import NODE_IDS
from firmware_interface.chips import fdc1004
from firmware_interface.serial_frames import (
    ELEMENTS,
    NO_VALUE,
    NoValue,
    Record,
    RecordFlag,
    encode_record,
    pack_values,
)
from footsense.frames import Vector
from footsense.sim.chips.electronics import WiredFoot
from footsense.sim.chips.line_switch import LineStates
from footsense.sim.faults.schedule import Span, during
from footsense.sim.robot import SimulatedRobot
from footsense.sim.scene import Scene

_NS_PER_US = 1000
_AF_PER_PF = 1e6
_WRAP_US = 1 << 32
#: Records of a leg with the flag of a recent start.
_STARTING_RECORDS = 256
#: Noise of one conversion [pF]: that of the default board at its fastest rate; no such board was measured.
_NOISE_PF = fdc1004.RATES[400].noise_ff * 1e-3
#: Relative error of its crystal [1].
_CLOCK_ERROR_REL = 40e-6

#: Share of a scan's time in which the elements are converted, one after the other.
_CONVERTING_REL = 0.9
_ROWS = _COLUMNS = 3
#: One row selected, the others waiting.
_ALONE = [LineStates(0, 1 << row, 0b111 & ~(1 << row)) for row in range(_ROWS)]
#: Random stream of the noise, beside those of the legs.
_NOISE_DRAW = 6

#: Capacitances of a leg's elements at a time [ns], stray included [pF], shape (9,).
Elements = Callable[[int], Vector]


class SimulatedMcu:
    """Simulated microcontroller that scans all legs and sends serial records.

    Args:
        legs: Capacitances of each leg, by its name.
        step_us: Time from element to element [us]; 0 for simultaneous conversions.
        starts_us: Its clock at time 0 [us].
        noise: Source of its noise; None for none.

    Attributes:
        silent_ns: Spans in which a leg's converter does not answer, by the leg's name [ns].
    """

    def __init__(
        self,
        legs: Mapping[str, Elements],
        *,
        step_us: int = 0,
        starts_us: int = 0,
        noise: np.random.Generator | None = None,
    ) -> None:
        self.silent_ns: dict[str, Span] = {}
        self._legs = dict(legs)
        self._step_us = step_us
        self._starts_us = starts_us
        self._started_ns = 0
        self._noise = noise
        self._n_scans = 0
        self._lead = b""

    def restart(self, t_ns: int) -> None:
        """Reset at a time [ns]: clock and numbers restart at 0, and a zero byte ends the interrupted record."""
        self._lead = b"\0"
        self._starts_us = 0
        self._started_ns = t_ns
        self._n_scans = 0

    def scan(self, t_ns: int) -> bytes:
        """Return the records of a scan, of which the middle of the first conversion is at `t_ns` [ns]."""
        t_us = self._starts_us + round((t_ns - self._started_ns) * (1 + _CLOCK_ERROR_REL)) // _NS_PER_US
        number, self._n_scans = self._n_scans, self._n_scans + 1
        flags = RecordFlag.STARTING if number < _STARTING_RECORDS else 0
        lead, self._lead = self._lead, b""
        return lead + b"".join(
            encode_record(
                Record(
                    leg=NODE_IDS[leg],
                    seq=number & 0xFFFF,
                    flags=flags,
                    step_us=self._step_us,
                    t_us=t_us % _WRAP_US,
                    values=pack_values(self._values_af(leg, elements_pf, t_ns)),
                )
            )
            for leg, elements_pf in self._legs.items()
        )

    @property
    def converts_ns(self) -> int:
        """Time from the first to the last conversion of a scan, after which its records are sent [ns]."""
        return (ELEMENTS - 1) * self._step_us * _NS_PER_US

    def _values_af(self, leg: str, elements_pf: Elements, t_ns: int) -> list[int]:
        if leg in self.silent_ns and during([self.silent_ns[leg]], t_ns):
            return [NO_VALUE + NoValue.NO_ANSWER] * ELEMENTS
        if self._step_us:
            step_ns = self._step_us * _NS_PER_US
            values_pf = np.array([elements_pf(t_ns + n * step_ns)[n] for n in range(ELEMENTS)])
        else:
            values_pf = elements_pf(t_ns)
        if self._noise is not None:
            values_pf = values_pf + self._noise.normal(0.0, _NOISE_PF, ELEMENTS)
        over = values_pf * _AF_PER_PF >= 2**31
        values: list[int] = (
            np.where(over, NO_VALUE + NoValue.OVER_RANGE, values_pf * _AF_PER_PF).round().astype(int).tolist()
        )
        return values


def simulated_mcu(robot: SimulatedRobot, scene: Scene, rate_hz: float) -> SimulatedMcu:
    """Return a microcontroller on a simulated robot, whose buses are not used then.

    Args:
        robot: The robot.
        scene: The scene.
        rate_hz: Scans per second [Hz].
    """
    noise = np.random.default_rng((scene.seed, _NOISE_DRAW)) if scene.effects.converter_noise else None
    return SimulatedMcu(
        {name: _measured(leg.wired, scene.effects.stray_pf) for name, leg in robot.legs.items()},
        step_us=round(_CONVERTING_REL * 1e6 / rate_hz / ELEMENTS),
        noise=noise,
    )


def _measured(foot: WiredFoot, stray_pf: float) -> Elements:
    """Return the elements of a foot as electronics without a fault of their own measure them, row by row."""

    def elements_pf(t_ns: int) -> Vector:
        element_pf = [pf + stray_pf for pf in foot.elements_pf(t_ns)]
        return np.array(
            [
                foot.damage.pin_pf(column, element_pf[column::_COLUMNS], states, t_ns)
                for states in _ALONE
                for column in range(_COLUMNS)
            ]
        )

    return elements_pf
