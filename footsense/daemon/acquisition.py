"""Open the configured source of capacitance frames: real or simulated I2C buses, or a serial port."""

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace

from footsense.acquisition.bus_timing import BusTiming
from footsense.acquisition.free_scanner import FreeScanner
from footsense.acquisition.leg_bus import LegBus
from footsense.acquisition.linux_i2c import LinuxI2cBus
from footsense.acquisition.mcu_source import McuSource, Serial
from footsense.acquisition.robot_scanner import RobotScanner
from footsense.acquisition.scan_plan import AnyPlan, FreeRunningPlan, ScanPlan, bus_overload
from footsense.acquisition.scanner import BusScanner
from footsense.clock import MonotonicClock
from footsense.config import Config
from footsense.config.sections import Bus
from footsense.daemon.simulation import simulated_robot
from footsense.frames import CapFrame, Vector
from footsense.ports import Clock, SerialPort, WakeupLatency
from footsense.sim.robot import SimulatedRobot
from footsense.sim.robot_on_mcu import SimulatedSerialPort, simulated_mcu
from footsense.sim.scene import Scene

_log = logging.getLogger(__name__)

#: Share of the configured clock below which a bus is slow.
MIN_BUS_SPEED_REL = 0.9


@dataclass(frozen=True, slots=True)
class ScanSource:
    """Open source of capacitance frames, with its clock and, in simulation, the true forces.

    Attributes:
        source: The scanner, started.
        clock: Clock of its time stamps.
        frames_per_scan: Frames in which every element is read once: single conversions, or one for a whole scan.
        response_sha256: Hash of the response table of the simulated feet, None on a real robot.
        true_force_n_at: True force on every foot at a time [ns], shape (legs, 3) [N]; None on a real robot.
        wakeups: Wake-up latency of the thread of each bus; none in virtual time.
    """

    source: BusScanner | FreeScanner | RobotScanner | McuSource
    clock: Clock
    frames_per_scan: int = 1
    response_sha256: str | None = None
    true_force_n_at: Callable[[int], Vector] | None = None
    wakeups: tuple[WakeupLatency, ...] = ()

    def read_whole_scans(self, n: int) -> list[CapFrame]:
        """Read `n` scans; return the last frame of each."""
        scans: list[CapFrame] = []
        while len(scans) < n:
            frame = self.source.read()
            if frame.sequence % self.frames_per_scan == 0:
                scans.append(frame)
        return scans


def open_buses(config: Config, robot: SimulatedRobot | None, stack: ExitStack) -> list[tuple[LegBus, Clock]]:
    """Open the I2C adapters and reset lines of every bus; return the way to the legs of each, and its clock.

    Args:
        config: The robot.
        robot: Its simulation; None for its real buses.
        stack: Closes them.

    Raises:
        HardwareError: An adapter or a reset line is missing.
    """
    if robot is None:
        return [(_open_bus(bus, stack), MonotonicClock()) for bus in config.buses]
    return [
        (LegBus(wires, bus.mux_address, wires.mux if bus.mux.reset else None), wires.clock)
        for bus, wires in zip(config.buses, robot.buses, strict=True)
    ]


def bus_scanners(config: Config, buses: Sequence[tuple[LegBus, Clock]]) -> Sequence[BusScanner | FreeScanner]:
    """Return a scanner of each bus of a robot, not started.

    Args:
        config: The robot.
        buses: The way to the legs of each, and its clock.
    """
    plan = config.scan_plan
    return [
        BusScanner(legs, clock, bus.channels, plan)
        if isinstance(plan, ScanPlan)
        else FreeScanner(legs, clock, bus.channels, bus.converter_addresses, plan)
        for bus, (legs, clock) in zip(config.buses, buses, strict=True)
    ]


def check_adapters(config: Config) -> None:
    """Open and close every I2C adapter of a robot, to raise an error early.

    Raises:
        HardwareError: One is missing, or another process has locked it.
    """
    for bus in config.buses:
        LinuxI2cBus.open(bus.device).close()


def _open_bus(bus: Bus, stack: ExitStack) -> LegBus:
    """Open a bus's I2C adapter and its reset line; return the access to its legs."""
    adapter = LinuxI2cBus.open(bus.device)
    stack.callback(adapter.close)
    line = None
    if bus.mux.reset is not None:
        # Only a robot with a RESET line pays for gpiod: 1 MB and 5 ms.
        from footsense.acquisition.gpio import LinuxResetLine

        line = LinuxResetLine.open(bus.mux.reset.device, bus.mux.reset.line)
        stack.callback(line.close)
    return LegBus(adapter, bus.mux_address, line)


def _log_bus_timing(bus: Bus, timing: BusTiming | None, plan: AnyPlan) -> None:
    """Log a bus's scan limits, and a warning if it is slower than configured, or than converters that run freely."""
    if timing is None:
        return
    _log.info("%s: %s", bus.device, timing)
    if timing.bus_hz < MIN_BUS_SPEED_REL * bus.rate_hz:
        _log.warning(
            "%s runs at %.0f kHz, not at the %.0f kHz of the configuration: a Raspberry Pi's follows the core clock; "
            "set core_freq_min, or correct rate_hz",
            bus.device,
            timing.bus_hz * 1e-3,
            bus.rate_hz * 1e-3,
        )
    overload = bus_overload(plan, timing.lower_bounds)
    if overload is not None and isinstance(plan, FreeRunningPlan):
        _log.warning("%s %s", bus.device, overload)


@contextmanager
def open_scan_source(config: Config, scene: Scene | None) -> Iterator[ScanSource]:
    """Open buses or serial port and start scanning, during a `with` block.

    Args:
        config: The robot.
        scene: Scene of its simulation; None for its real buses.

    Yields:
        The started scanner with its clock.

    Raises:
        HardwareError: A bus, its mux or the line is missing.
    """
    with ExitStack() as stack:
        robot = None if scene is None else simulated_robot(config, scene)
        if config.serial is not None:
            opened = _open_microcontroller(config.serial, robot, scene)
            stack.callback(opened.source.close)
        else:
            opened = _open_bus_scanners(config, robot, stack)
        if robot is not None:
            opened = replace(
                opened,
                clock=robot.clock,
                response_sha256=robot.response_sha256,
                true_force_n_at=robot.true_force_n_at,
                wakeups=(),
            )
        yield opened


def _open_microcontroller(serial: Serial, robot: SimulatedRobot | None, scene: Scene | None) -> ScanSource:
    """Open the serial port of the microcontroller, or of a simulated one."""
    own = MonotonicClock()
    clock: Clock = own if robot is None else robot.clock
    if robot is None or scene is None:
        from footsense.acquisition.serial_port import SerialLink  # pyserial is not loaded for I2C

        port: SerialPort = SerialLink(serial.device, serial.baud, clock)
    else:
        mcu = simulated_mcu(robot, scene, serial.rate_hz)
        port = SimulatedSerialPort(mcu, clock, rate_hz=serial.rate_hz, bits_per_s=serial.baud)
    return ScanSource(McuSource(port, clock, serial), clock, wakeups=(own.wakeups,))


def _open_bus_scanners(config: Config, robot: SimulatedRobot | None, stack: ExitStack) -> ScanSource:
    """Open and start the scanners of all I2C buses."""
    buses = open_buses(config, robot, stack)
    scanners = bus_scanners(config, buses)
    source = scanners[0] if len(scanners) == 1 else RobotScanner(scanners, threads=robot is None)
    stack.callback(source.close)
    source.start()
    for bus, scanner in zip(config.buses, scanners, strict=True):
        _log_bus_timing(bus, scanner.bus_timing, config.scan_plan)
    return ScanSource(
        source,
        MonotonicClock(),
        max(scanner.frames_per_scan for scanner in scanners),
        wakeups=tuple(clock.wakeups for _, clock in buses if isinstance(clock, MonotonicClock)),
    )
