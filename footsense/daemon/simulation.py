"""Build the simulated robot of a configuration and a scene; play virtual time at the speed of real time."""

import logging
import math
from collections.abc import Callable, Iterator
from pathlib import Path

from msgspec.structs import replace

from footsense.config import SMALL_BOARD, Config
from footsense.daemon.foot_types import check_foot_type
from footsense.errors import ConfigError, ModelError
from footsense.foot.response_table import FootResponse
from footsense.foot.type_folders import foot_type_folder
from footsense.frames import CapFrame
from footsense.ports import Clock, FrameSource
from footsense.sim.couplings import COUPLINGS_FILE, BoardCouplings, load_couplings
from footsense.sim.faults.scene_faults import (
    BrokenRow,
    ChipFault,
    MetalBesideTail,
    SwitchIgnoresWrites,
    WireFault,
)
from footsense.sim.robot import BusWiring, SimulatedRobot
from footsense.sim.scene import Scene

_log = logging.getLogger(__name__)


def is_simulated(config: Config) -> bool:
    """Return whether the configured buses or serial port are simulated."""
    if config.serial is not None:
        return config.serial.device == "sim"
    return all(bus.device.startswith("sim") for bus in config.buses)


def simulated_robot(config: Config, scene: Scene) -> SimulatedRobot:
    """Return the simulated robot of a scene, wired as configured.

    Raises:
        ModelError: The response table of its feet, or couplings that the scene asks for, are missing, unreadable, or
            of another foot type.
        ConfigError: A fault of the scene is for a bus that the robot does not have, or the couplings are none.
    """
    wiring = [
        BusWiring(
            bus.rate_hz,
            bus.mux_address,
            bus.channels,
            bus.converter_addresses,
            config.board,
        )
        for bus in config.buses
    ]
    if config.serial is not None:  # any wiring: the microcontroller's is not simulated
        wiring = [
            BusWiring(
                SMALL_BOARD.buses[0].rate_hz, 0x71, {leg: channel for channel, leg in enumerate(config.legs)}
            )
        ]
    folder = foot_type_folder(config.foot_type)
    table = folder / "response.npz"
    response = FootResponse.load(table)
    check_foot_type(table, response.foot_type, config)
    for problem in _inapplicable_faults(config, scene):
        raise ConfigError(f"scene: {problem}")
    scene = _without_absent_legs(scene, config.legs)
    plan = config.scan_plan if config.buses else None
    grace_ns = plan.longest_frame_ns if plan else math.inf
    return SimulatedRobot(scene, response, wiring, grace_ns, _couplings(config, scene, folder))


def _couplings(config: Config, scene: Scene, folder: Path) -> dict[str, BoardCouplings]:
    """Return the couplings of the feet's lines by board; none where the scene asks for none.

    Raises:
        ModelError: They are missing, or of another foot type.
    """
    if scene.effects.couplings is None and not any(
        isinstance(fault, MetalBesideTail) for fault in scene.faults
    ):
        return {}
    path = folder / COUPLINGS_FILE
    if not path.exists():
        raise ModelError(f"{path}: no such file; `footsense lab couplings` writes it")
    table = load_couplings(path)
    check_foot_type(path, table.foot_type, config)
    return table.boards


def _without_absent_legs(scene: Scene, legs: tuple[str, ...]) -> Scene:
    """Return a scene without the faults of legs that a robot does not have."""
    legs_of_faults = [getattr(fault, "leg", None) for fault in scene.faults]
    absent = [leg for leg in legs_of_faults if leg is not None and leg not in legs]
    if absent:
        named, there = ", ".join(dict.fromkeys(absent)), ", ".join(legs)
        _log.warning("the scene's faults of %s are left out: this robot has %s", named, there)
    faults = zip(legs_of_faults, scene.faults, strict=True)
    return replace(scene, faults=tuple(fault for leg, fault in faults if leg not in absent))


def _inapplicable_faults(config: Config, scene: Scene) -> Iterator[str]:
    """Yield the faults of a scene that this robot cannot have, as text."""
    for n, fault in enumerate(scene.faults):
        bus = getattr(fault, "bus", None)
        if config.serial is not None and isinstance(fault, ChipFault | WireFault):
            yield f"faults[{n}]: is for chips or wires of an I2C bus, which the board mcu does not have"
        if isinstance(fault, SwitchIgnoresWrites | BrokenRow) and config.board == "ad7147":
            yield f"faults[{n}]: is for row lines and their switch, which the board ad7147 does not have"
        if bus is not None and bus >= len(config.buses):
            yield f"faults[{n}].bus: {bus} is no bus of this robot; it has 0 to {len(config.buses) - 1}"


class PacedSource:
    """Frame source that plays a virtual one at the speed of real time.

    Args:
        source: The source to slow down.
        played: The time that its frames are in.
        real: The time to play them in.
        set_lagging: Called when the source begins to lag behind real time, and when it has caught up.
    """

    def __init__(
        self, source: FrameSource, played: Clock, real: Clock, set_lagging: Callable[[bool], None]
    ) -> None:
        from footsense.client import LinkLimits  # in a simulation alone: a service on a robot starts without

        self._source = source
        # From there on forces are too late for a consumer.
        self._max_lag_ns = LinkLimits().max_age_ns
        self._played = played
        self._real = real
        self._set_lagging = set_lagging
        self._offset_ns: int | None = None
        self._first_ns = self._on_time_ns = self._due_ns = self._lag_ns = 0
        self._is_lagging = False
        self._has_lagged = False

    def read(self) -> CapFrame | None:
        """Return the next frame, delayed until it is due by the real clock."""
        scan = self._source.read()
        if self._offset_ns is None:
            self._first_ns = self._on_time_ns = self._real.now_ns()
            self._offset_ns = self._first_ns - self._played.now_ns()
        self._due_ns = due_ns = self._played.now_ns() + self._offset_ns
        self._lag_ns = lag_ns = max(0, self._real.now_ns() - due_ns)
        if not lag_ns:
            self._on_time_ns = due_ns
        if self._is_lagging != (lag_ns > (0 if self._is_lagging else self._max_lag_ns)):
            self._is_lagging = not self._is_lagging
            self._set_lagging(self._is_lagging)
            if not self._has_lagged:
                self._has_lagged = True
                _log.warning(
                    "the simulation cannot keep pace with real time on this computer: it runs at %.3g of real time; "
                    "while it lags, the frames say degraded_timing",
                    self._speed_since(self._on_time_ns),
                )
        self._real.sleep_until_ns(due_ns)
        return scan

    @property
    def real_time_factor(self) -> float:
        """Time that was played over the real time that it took, since the first frame [1]; 1 if it keeps pace."""
        return self._speed_since(self._first_ns)

    def _speed_since(self, start_ns: int) -> float:
        played_ns = self._due_ns - start_ns
        return played_ns / (played_ns + self._lag_ns) if self._lag_ns else 1.0

    def close(self) -> None:
        """Close the source."""
        self._source.close()
