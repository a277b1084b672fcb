"""Simulated robot with board `mcu`: one microcontroller scans all feet."""

import numpy as np

from firmware_interface.serial_frames import ELEMENTS
from footsense.frames import Vector
from footsense.sim.chips.line_switch import LineStates
from footsense.sim.chips.mcu import ElementCapacitancesAt, SimulatedRobotMcu
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
        return np.array(
            [
                foot.pin_pf(column, element_pf[column::_COLUMNS], states, t_ns)
                for states in _SINGLE_ROW_STATES
                for column in range(_COLUMNS)
            ]
        )

    return elements_pf
