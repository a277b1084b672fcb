"""From configuration to scans: real adapters or a simulated robot, and the scanner over them."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from footsense.app.estimation import released
from footsense.backends.linux_i2c import LinuxI2cBus
from footsense.clock import MonotonicClock, Wakeups
from footsense.config import Config
from footsense.drivers.bus_scanner import BusScanner
from footsense.drivers.robot_scanner import RobotScanner
from footsense.drivers.scan_plan import scan_plan
from footsense.errors import ConfigError
from footsense.ports import Clock, I2cBus
from footsense.sim.foot import FootResponse
from footsense.sim.robot import SimulatedRobot, Wiring
from footsense.sim.scene import Scene


@dataclass(frozen=True, slots=True)
class Scanning:
    """Where scans come from.

    Attributes:
        source: The scanner, started.
        clock: The time that its stamps are in.
        response_sha256: Hash of the response table that the simulated feet follow, None on a real robot.
        felt_n: What every foot feels at a time, None on a real robot.
        wakeups: What became of the deadlines on each bus; none in virtual time.
    """

    source: RobotScanner
    clock: Clock
    response_sha256: str | None
    felt_n: Callable[[int], NDArray[np.float64]] | None
    wakeups: tuple[Wakeups, ...] = ()


def is_simulated(config: Config) -> bool:
    """Tell whether the configuration names simulated buses."""
    return all(bus.device.startswith("sim") for bus in config.buses)


def simulated_robot(config: Config, scene: Scene) -> SimulatedRobot:
    """Return the robot of a scene, wired as configured.

    Raises:
        ModelError: The response table of its feet is missing or unreadable.
        ConfigError: Something is to break on a leg that the robot does not have.
    """
    for n, fault in enumerate(scene.faults):
        leg, bus = getattr(fault, "leg", None), getattr(fault, "bus", 0)
        if leg is not None and leg not in config.legs:
            raise ConfigError(
                f"scene: faults[{n}].leg: {leg} is no leg of this robot; it has {', '.join(config.legs)}"
            )
        if bus >= len(config.buses):
            raise ConfigError(
                f"scene: faults[{n}].bus: {bus} is no bus of this robot; it has 0 to {len(config.buses) - 1}"
            )
    wiring = [Wiring(bus.rate_hz, bus.mux.address, dict[str, int](bus.legs.items())) for bus in config.buses]
    return SimulatedRobot(scene, FootResponse.load(released("response.npz")), wiring)


@contextmanager
def scanning(config: Config, scene: Scene | None) -> Iterator[Scanning]:
    """Open the buses, start the scanner, and close both at the end.

    Args:
        config: The robot.
        scene: What it does if its buses are to be simulated; None for its real buses.

    Yields:
        The started scanner and its clock.

    Raises:
        HardwareError: A bus or its mux is not there.
    """
    with ExitStack() as stack:
        robot = None
        buses: list[I2cBus] = []
        clocks: list[Clock] = []
        clock: Clock = MonotonicClock()
        if scene is not None:
            robot = simulated_robot(config, scene)
            buses, clocks, clock = list(robot.buses), list(robot.clocks), robot.clock
        else:
            for bus in config.buses:
                buses.append(LinuxI2cBus.open(bus.device))
                stack.callback(buses[-1].close)
                clocks.append(MonotonicClock())
        plan = scan_plan(config.scan.order, config.scan.rate_sps)
        source = RobotScanner(
            [
                BusScanner(adapter, bus_clock, dict[str, int](bus.legs.items()), bus.mux.address, plan)
                for adapter, bus_clock, bus in zip(buses, clocks, config.buses, strict=True)
            ],
            element_wise=config.publish == "element",
        )
        stack.callback(source.close)
        source.start()
        if robot is None:
            wakeups = tuple(own.wakeups for own in clocks if isinstance(own, MonotonicClock))
            yield Scanning(source, clock, None, None, wakeups)
        else:
            yield Scanning(source, clock, robot.response_sha256, robot.felt_n)
