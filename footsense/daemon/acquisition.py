"""From configuration to scans: real adapters or a simulated robot, and the scanner over them."""

import logging
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_interface.serial_frames import RECORD_BITS
from footsense.acquisition.bus_scanner import BusScanner
from footsense.acquisition.bus_timing import Timing
from footsense.acquisition.gpio import LinuxResetLine
from footsense.acquisition.kernel_mux_scanner import KernelMuxScanner
from footsense.acquisition.linux_i2c import LinuxI2cBus
from footsense.acquisition.mcu_source import RecordSource
from footsense.acquisition.robot_scanner import LegsScanner, RobotScanner
from footsense.acquisition.scan_plan import ScanPlan, scan_plan
from footsense.acquisition.serial_port import SerialLink
from footsense.clock import MonotonicClock, Wakeups
from footsense.config import Bus, Config, Serial
from footsense.daemon.foot_types import artefact, require_foot_type
from footsense.errors import ConfigError
from footsense.foot.response_table import FootResponse
from footsense.ports import Clock, I2cBus, ResetLine, SerialPort
from footsense.sim.bus.serial_line import SimulatedLine
from footsense.sim.chips.mcu import simulated_mcu
from footsense.sim.faults.scene_faults import OnChips, OnWires
from footsense.sim.robot import SimulatedRobot, Wiring
from footsense.sim.scene import Scene

_log = logging.getLogger(__name__)

#: Share of the configured clock below which a bus is said to be slow.
_SLOW_REL = 0.9


@dataclass(frozen=True, slots=True)
class Scanning:
    """Where scans come from.

    Attributes:
        source: The scanner, started; `source.temperature_c` is that of each leg's converter, NaN for none.
        clock: The time that its stamps are in.
        response_sha256: Hash of the response table that the simulated feet follow, None on a real robot.
        true_force_n: What every foot feels at a time, None on a real robot.
        wakeups: What became of the deadlines on each bus; none in virtual time.
        has_thermometers: Whether the converters have temperature sensors.
    """

    source: RobotScanner | RecordSource
    clock: Clock
    response_sha256: str | None
    true_force_n: Callable[[int], NDArray[np.float64]] | None
    wakeups: tuple[Wakeups, ...] = ()
    has_thermometers: bool = False


def is_simulated(config: Config) -> bool:
    """Tell whether the configuration names simulated buses, or a simulated line."""
    if config.serial is not None:
        return config.serial.device == "sim"
    return all(bus.device.startswith("sim") for bus in config.buses)


def simulated_robot(config: Config, scene: Scene) -> SimulatedRobot:
    """Return the robot of a scene, wired as configured.

    Raises:
        ModelError: The response table of its feet is missing, unreadable, or of another foot type.
        ConfigError: Something is to break on a leg that the robot does not have.
    """
    for n, fault in enumerate(scene.faults):
        leg, bus = getattr(fault, "leg", None), getattr(fault, "bus", None)
        if config.serial is not None and isinstance(fault, OnChips | OnWires):
            raise ConfigError(
                f"scene: faults[{n}]: strikes chips or wires of an I2C bus, which the board mcu does not have"
            )
        if leg is not None and leg not in config.legs:
            raise ConfigError(
                f"scene: faults[{n}].leg: {leg} is no leg of this robot; it has {', '.join(config.legs)}"
            )
        if bus is not None and bus >= len(config.buses):
            raise ConfigError(
                f"scene: faults[{n}].bus: {bus} is no bus of this robot; it has 0 to {len(config.buses) - 1}"
            )
    wiring = [
        Wiring(
            bus.rate_hz,
            bus.mux.address,
            bus.channels or {leg: channel for channel, leg in enumerate(bus.legs)},
            kernel_mux=bool(bus.adapters),
            board=config.board,
        )
        for bus in config.buses
    ]
    if config.serial is not None:  # its legs are on wires of its own, which nobody sees
        wiring = [Wiring(400_000, 0x71, {leg: place for place, leg in enumerate(config.legs)})]
    table = artefact(config, "response.npz")
    response = FootResponse.load(table)
    require_foot_type(table, response.foot_type, config)
    return SimulatedRobot(scene, response, wiring)


def plan_for(config: Config) -> ScanPlan:
    """Return what is done on each bus of a robot that is read over I2C."""
    return scan_plan(config.order, config.rate_sps, config.board)


class OpenBus(NamedTuple):
    """One bus, open.

    Attributes:
        bus: As configured.
        clock: The time that it lives in.
        trunk: Its adapter; None where the kernel drives the mux.
        adapters: Adapter of each leg by name, where the kernel drives the mux; none elsewhere.
        reset_line: What drives the RESET pin of its mux; None if nothing does.
    """

    bus: Bus
    clock: Clock
    trunk: I2cBus | None
    adapters: dict[str, I2cBus]
    reset_line: ResetLine | None


def open_buses(config: Config, robot: SimulatedRobot | None, stack: ExitStack) -> list[OpenBus]:
    """Open the adapters and reset lines of every bus, to be closed with the stack.

    Args:
        config: The robot.
        robot: Its simulation; None for its real buses.
        stack: Closes them.

    Raises:
        HardwareError: An adapter or a reset line is not there.
    """
    opened = []
    for number, bus in enumerate(config.buses):
        if robot is not None:
            trunk = None if bus.adapters else robot.buses[number]
            reset_line = robot.muxes[number] if bus.mux.reset else None
            adapters: dict[str, I2cBus] = dict(robot.adapters[number])
            opened.append(OpenBus(bus, robot.clocks[number], trunk, adapters, reset_line))
            continue
        line = None
        if bus.mux.reset is not None and not bus.adapters:
            line = LinuxResetLine.open(bus.mux.reset.device, bus.mux.reset.line)
            stack.callback(line.close)
        opened.append(
            OpenBus(
                bus=bus,
                clock=MonotonicClock(),
                trunk=None if bus.adapters else _opened(bus.device, stack),
                adapters={leg: _opened(device, stack) for leg, device in bus.adapters.items()},
                reset_line=line,
            )
        )
    return opened


def _opened(device: str, stack: ExitStack) -> I2cBus:
    adapter = LinuxI2cBus.open(device)
    stack.callback(adapter.close)
    return adapter


def _tell(bus: Bus, timing: Timing | None) -> None:
    """Say in the journal what a bus allows, and whether it runs as fast as it was said to."""
    if timing is None:
        return
    _log.info("%s: %s", bus.device, timing)
    if timing.costs.rate_hz < _SLOW_REL * bus.rate_hz:
        _log.warning(
            "%s runs at %.0f kHz, not at the %.0f kHz of the configuration: a Raspberry Pi's follows the core clock; "
            "set core_freq_min, or correct rate_hz",
            bus.device,
            timing.costs.rate_hz * 1e-3,
            bus.rate_hz * 1e-3,
        )


def _from_mcu(
    serial: Serial, robot: SimulatedRobot | None, scene: Scene | None, stack: ExitStack
) -> Scanning:
    """Open the line to the microcontroller, or to a simulated one."""
    own = MonotonicClock()
    clock: Clock = own if robot is None else robot.clock
    if robot is None or scene is None:
        port: SerialPort = SerialLink(serial.device, serial.baud, clock)
    else:
        mcu = simulated_mcu(robot, scene, serial.rate_hz)
        port = SimulatedLine(mcu, clock, rate_hz=serial.rate_hz, baud=serial.baud)
    wire_ns = round(RECORD_BITS * 1e9 / serial.baud)
    source = RecordSource(port, clock, serial.legs, rate_hz=serial.rate_hz, wire_ns=wire_ns)
    stack.callback(source.close)
    if robot is None:
        return Scanning(source, clock, None, None, (own.wakeups,))
    return Scanning(source, clock, robot.response_sha256, robot.true_force_n)


@contextmanager
def scanning(config: Config, scene: Scene | None) -> Iterator[Scanning]:
    """Open the buses, start the scanner, and close both at the end.

    Args:
        config: The robot.
        scene: What it does if its buses are to be simulated; None for its real buses.

    Yields:
        The started scanner and its clock.

    Raises:
        HardwareError: A bus, its mux or the line is not there.
    """
    with ExitStack() as stack:
        robot = None if scene is None else simulated_robot(config, scene)
        if config.serial is not None:
            yield _from_mcu(config.serial, robot, scene, stack)
            return
        buses = open_buses(config, robot, stack)
        plan = plan_for(config)
        scanners: list[LegsScanner] = []
        for bus, its_clock, trunk, adapters, reset_line in buses:
            if trunk is None:
                scanners.append(KernelMuxScanner(adapters, its_clock, plan))
            else:
                scanners.append(BusScanner(trunk, its_clock, bus.channels, bus.mux.address, plan, reset_line))
        source = RobotScanner(scanners, element_wise=config.publish == "element")
        stack.callback(source.close)
        source.start()
        for bus, started in zip(config.buses, scanners, strict=True):
            _tell(bus, started.timing)
        warm = plan.board.thermometer is not None
        if robot is None:
            clocks = [own.clock for own in buses if isinstance(own.clock, MonotonicClock)]
            yield Scanning(source, MonotonicClock(), None, None, tuple(own.wakeups for own in clocks), warm)
        else:
            yield Scanning(source, robot.clock, robot.response_sha256, robot.true_force_n, (), warm)
