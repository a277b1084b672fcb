"""The composition root: the only module that knows which backend stands behind which port."""

import logging
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from footsense import __version__, loop
from footsense.backends.linux_i2c import LinuxI2cBus
from footsense.clock import MonotonicClock, wall_time_iso
from footsense.config import Can, Config
from footsense.core.baseline import TareLimits
from footsense.core.pipeline import Pipeline
from footsense.drivers.bus_scanner import BusScanner
from footsense.drivers.robot_scanner import RobotScanner
from footsense.drivers.scan_plan import scan_plan
from footsense.errors import ModelError, RecordingError
from footsense.frames import ELEMENTS, Flag
from footsense.inference.network import Network
from footsense.ports import Clock, FrameSource, I2cBus, Observer
from footsense.publish.can_sink import CanSink
from footsense.publish.journal import Journal
from footsense.recording.machine import this_machine
from footsense.recording.recorder import Recorder, check_target
from footsense.recording.replay import Replay
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
                [Wiring(bus.rate_hz, bus.mux.address, {**bus.legs}) for bus in config.buses],
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
                BusScanner(adapter, bus_clock, {**bus.legs}, bus.mux.address, plan)
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
    network = Network(path, n_legs=len(config.legs))
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
        stray_pf=np.array([config.stray_pf.get(leg, (0.0,) * ELEMENTS) for leg in config.legs]),
        tare=TareLimits(
            window_frames=config.tare.window_frames,
            noise_limit_ff=config.tare.noise_limit_ff,
            unloaded_limit_rel=config.tare.unloaded_limit_rel,
        ),
        max_age_ns=config.max_age_ms * 1_000_000,
        flags=Flag.SIMULATED if simulated else Flag(0),
    )


@contextmanager
def can_sink(config: Config, clock: Clock, log_file: Path | None) -> Iterator[CanSink]:
    """Open the CAN channel, and end with every leg's heartbeat `stopped`.

    Yields:
        The sink.

    Raises:
        CanError: The channel is missing or down.
        ConfigError: The log cannot be written.
    """
    sink = CanSink(
        interface=config.can.interface,
        channel=config.can.channel,
        legs=config.legs,
        clock=clock,
        log_file=log_file,
        bitrate=config.can.bitrate,
    )
    try:
        yield sink
    finally:
        sink.close()


def recorded_config(recording: Replay) -> Config:
    """Return the configuration that a recording was made with, its CAN kept inside the process.

    Raises:
        RecordingError: The header holds none that this version reads.
    """
    try:
        config = msgspec.json.decode(recording.header["config"], type=Config)
    except (KeyError, msgspec.DecodeError) as error:
        raise RecordingError(
            f"{recording.path}: no configuration that this version reads: {error}"
        ) from error
    return msgspec.structs.replace(config, can=Can(interface="virtual"))


@dataclass(slots=True)
class Service:
    """The daemon, put together and open.

    Attributes:
        legs: Names of the legs in the order of the rows of every frame.
        scanning: Where scans come from.
        source: The same source, or what slows it down.
        network: The network in use.
        pipeline: What makes forces of scans.
        sink: Where forces go.
        observers: Who sees every cycle; more may be added before `run`.
        recorder: What records, if anything does.
    """

    legs: tuple[str, ...]
    scanning: Scanning
    source: FrameSource
    network: Network
    pipeline: Pipeline
    sink: CanSink
    observers: list[Observer]
    recorder: Recorder | None

    def run(self, stop: Callable[[], bool]) -> None:
        """Run until `stop` says so."""
        loop.run(self.source, self.pipeline, self.sink, self.observers, self.scanning.clock, stop)


@contextmanager
def service(
    config: Config,
    scene: Scene | None,
    *,
    real_time: bool,
    record: Path | None = None,
    can_log: Path | None = None,
) -> Iterator[Service]:
    """Open all that the daemon needs, outputs last, and close it in the opposite order.

    Nothing is written before everything else has been found in order.

    Args:
        config: The robot.
        scene: What it does if it is simulated, None for its real buses.
        real_time: Whether the loop must never wait for its recorder.
        record: File to record to.
        can_log: File for what is sent on CAN.

    Yields:
        The service.

    Raises:
        FootsenseError: Something is missing or wrong; the message says what.
    """
    legs = config.legs
    with ExitStack() as stack:
        if record is not None:
            check_target(record)
        network = load_network(config)
        scan = stack.enter_context(scanning(config, scene))
        recorder = None
        if record is not None:
            recorder = Recorder(
                record, legs, _recording_header(config, scene, network), blocking=not real_time
            )
            stack.callback(recorder.close)
        sink = stack.enter_context(can_sink(config, scan.clock, can_log))
        observers: list[Observer] = [Journal(legs)]
        if recorder is not None:
            observers.append(recorder)
        yield Service(
            legs=legs,
            scanning=scan,
            source=scan.source,
            network=network,
            pipeline=pipeline_for(config, network, simulated=scene is not None),
            sink=sink,
            observers=observers,
            recorder=recorder,
        )


def _recording_header(config: Config, scene: Scene | None, network: Network) -> dict[str, str]:
    return {
        "footsense": __version__,
        "started": wall_time_iso(),
        "config": msgspec.json.encode(config).decode(),
        "scene": msgspec.json.encode(scene).decode() if scene else "",
        "model_sha256": network.sha256,
        "foot_type": network.card.foot_type,
        "feet": ",".join(f"{leg}={foot}" for leg, foot in config.feet.items()),
        **this_machine(),
    }
