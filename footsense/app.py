"""The composition root: the only module that knows which backend stands behind which port."""

import logging
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from footsense.backends.linux_i2c import LinuxI2cBus
from footsense.clock import MonotonicClock
from footsense.config import Config
from footsense.core.baseline import TareLimits
from footsense.core.pipeline import Pipeline
from footsense.drivers.bus_scanner import BusScanner
from footsense.drivers.robot_scanner import RobotScanner
from footsense.drivers.scan_plan import scan_plan
from footsense.errors import ModelError
from footsense.frames import ELEMENTS, Flag
from footsense.inference.network import Network
from footsense.ports import Clock, I2cBus
from footsense.sim.foot import FootResponse
from footsense.sim.robot import SimulatedRobot, Wiring
from footsense.sim.scene import Scene

_log = logging.getLogger(__name__)

#: The foot that the released artefacts are for.
FOOT_TYPE = "aoyagi-3x3"


def released(name: str) -> Path:
    """Return the path of a released artefact: inside the installed package, or beside it in a checkout."""
    installed = Path(str(files("footsense"))) / "models" / FOOT_TYPE / name
    return installed if installed.exists() else Path(__file__).parents[1] / "models" / FOOT_TYPE / name


@dataclass(frozen=True, slots=True)
class Scanning:
    """Where scans come from.

    Attributes:
        source: The scanner, started.
        clock: The time that its stamps are in.
        felt_n: What every foot feels at a time, None on a real robot.
    """

    source: RobotScanner
    clock: Clock
    felt_n: Callable[[int], NDArray[np.float64]] | None


def legs_of(config: Config) -> tuple[str, ...]:
    """Return the legs in the order of the rows of every frame: bus by bus."""
    return tuple(leg for bus in config.buses for leg in bus.legs)


def is_simulated(config: Config) -> bool:
    """Tell whether the configuration names simulated buses."""
    return all(bus.device.startswith("sim") for bus in config.buses)


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
            robot = SimulatedRobot(
                scene,
                FootResponse.load(released("response.npz")),
                [Wiring(bus.rate_hz, bus.mux.address, dict(bus.legs)) for bus in config.buses],
            )
            buses, clocks, clock = list(robot.buses), list(robot.clocks), robot.clock
        else:
            for bus in config.buses:
                buses.append(LinuxI2cBus.open(bus.device))
                stack.callback(buses[-1].close)
                clocks.append(clock)
        plan = scan_plan(config.scan.order, config.scan.rate_sps)
        source = RobotScanner(
            [
                BusScanner(adapter, bus_clock, dict(bus.legs), bus.mux.address, plan)
                for adapter, bus_clock, bus in zip(buses, clocks, config.buses, strict=True)
            ]
        )
        stack.callback(source.close)
        source.start()
        yield Scanning(source, clock, robot.felt_n if robot else None)


def load_network(config: Config) -> Network:
    """Return the network that the configuration names, or the released one.

    Raises:
        ModelError: There is none, or it is made for another foot.
    """
    path = Path(config.model) if config.model else released("network.onnx")
    network = Network(path, n_legs=len(legs_of(config)))
    if network.card.foot_type != FOOT_TYPE:
        raise ModelError(
            f"{path}: made for foot type {network.card.foot_type!r}, these feet are {FOOT_TYPE!r}"
        )
    return network


def pipeline_for(config: Config, network: Network, *, simulated: bool) -> Pipeline:
    """Return the pipeline of a robot."""
    return Pipeline(
        estimator=network,
        calibration=network.card.calibration,
        stray_pf=np.array([config.stray_pf.get(leg, (0.0,) * ELEMENTS) for leg in legs_of(config)]),
        tare=TareLimits(
            window_frames=config.tare.window_frames,
            noise_limit_ff=config.tare.noise_limit_ff,
            unloaded_limit_rel=config.tare.unloaded_limit_rel,
        ),
        max_age_ns=config.max_age_ms * 1_000_000,
        flags=Flag.SIMULATED if simulated else Flag(0),
    )
