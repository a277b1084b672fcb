"""The daemon, put together: scans in, forces out, and everyone who watches."""

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from footsense import __version__
from footsense.can.frame_log import check_log_target
from footsense.can.sink import CanSink
from footsense.clock import MonotonicClock, WakeupLatency, gc_disabled, request_realtime, wall_time_iso
from footsense.config import Can, Config
from footsense.config import Metrics as MetricsConfig
from footsense.daemon import loop
from footsense.daemon.acquisition import Scanning, scanning
from footsense.daemon.calibrations import calibrations_entry
from footsense.daemon.estimation import Calibrations, load_calibrations, load_network, pipeline_for
from footsense.daemon.simulation import is_simulated
from footsense.errors import ConfigError, FootsenseError, RecordingError
from footsense.estimation.network import Network
from footsense.estimation.pipeline import Pipeline
from footsense.frames import CanStatistics, Flag
from footsense.ports import CanWire, Clock, FrameSource, Observer
from footsense.recording.machine import this_machine
from footsense.recording.recorder import Recorder, check_target
from footsense.sim.can.interface import SimulatedCan
from footsense.sim.faults.scene_faults import CanFault
from footsense.sim.scene import Scene
from footsense.telemetry.journal import Journal
from footsense.telemetry.log_lines import lost_lines
from footsense.telemetry.metrics import Metrics
from footsense.telemetry.systemd import SystemdNotifier, SystemdObserver

if TYPE_CHECKING:
    from footsense.daemon.test_stand import StandSensor, StandSession

_log = logging.getLogger(__name__)


@contextmanager
def can_sink(
    config: Config,
    clock: Clock,
    log_file: Path | None,
    stats: CanStatistics | None = None,
    *,
    real_time: bool = False,
    connect: Callable[[], CanWire] | None = None,
) -> Iterator[CanSink]:
    """Open the CAN channel, and end with every leg's heartbeat `stopped`.

    Yields:
        The sink.

    Raises:
        CanError: The channel is missing or down.
        ConfigError: The log's suffix is unknown.
        RecordingError: The log cannot be made, or is not whole at the end.
    """
    sink = CanSink(
        interface=config.can.interface,
        channel=config.can.channel,
        legs=config.legs,
        clock=clock,
        log_file=log_file,
        bitrate=config.can.bitrate,
        stats=stats,
        log_waits=not real_time,
        connect=connect,
    )
    with _ending(sink.close):
        yield sink


@contextmanager
def _ending(close: Callable[[], None]) -> Iterator[None]:
    """Close at the end; that a log or recording is not whole must not hide what ended the run."""
    try:
        yield
    except BaseException:
        with suppress(RecordingError):
            close()
        raise
    close()


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
        can: The simulated CAN interface of a scene in which it breaks.
        reference: The force sensor of a test stand.
    """

    legs: tuple[str, ...]
    scanning: Scanning
    source: FrameSource
    network: Network
    pipeline: Pipeline
    sink: CanSink
    observers: list[Observer]
    recorder: Recorder | None
    can: SimulatedCan | None
    reference: "StandSensor | None" = None

    def run(self, stop: Callable[[], bool]) -> None:
        """Run until `stop` says so."""
        scanning = self.scanning
        with gc_disabled():
            loop.run(
                self.source,
                self.pipeline,
                self.sink,
                self.observers,
                scanning.clock,
                stop,
                self.reference,
                (lambda: scanning.source.temperature_c) if scanning.has_thermometers else None,
            )

    def figures(self) -> dict[str, object]:
        """Return what was sent and what was lost, as plain values."""
        stats = self.sink.stats
        return {
            "can": {"sent": stats.sent, "dropped": stats.dropped, "rejected_commands": stats.rejected},
            "cycles_not_recorded": self.recorder.lost if self.recorder else None,
        }


@contextmanager
def service(
    config: Config,
    scene: Scene | None,
    *,
    real_time: bool,
    record: Path | None = None,
    can_log: Path | None = None,
    test_stand: "StandSession | None" = None,
) -> Iterator[Service]:
    """Open all that the daemon needs, outputs last, and close it in the opposite order.

    Nothing is written before everything else has been found in order.

    Args:
        config: The robot.
        scene: What it does if it is simulated, None for its real buses.
        real_time: Whether the loop must never wait for its recorder; a simulation is then played at that pace.
        record: File to record to.
        can_log: File for what is sent on CAN.
        test_stand: The test stand that one foot is pressed on; there the loop waits for its recorder, as nobody walks.

    Yields:
        The service.

    Raises:
        FootsenseError: Something is missing or wrong; the message says what.
    """
    legs = config.legs
    stats = CanStatistics()
    recorder: Recorder | None = None
    with ExitStack() as stack:
        if record is not None:
            check_target(record)
        if can_log is not None:
            check_log_target(can_log)
        if scene is not None and not is_simulated(config):
            # Simulated forces must not reach the controller of the robot whose wiring they borrow.
            config = msgspec.structs.replace(config, can=Can(interface="virtual"))
        calibrations = load_calibrations(config)
        network = load_network(config, calibrations)
        # Before any chip is touched; the recorder's process gives up again what they inherit of it.
        flags = _flags(config, simulated=scene is not None)
        scan = stack.enter_context(scanning(config, scene))
        if scan.response_sha256 not in {None, network.card.response_sha256}:
            _log.warning("the network was trained on another response table than the simulated feet follow")
        observers: list[Observer] = [
            Journal(legs, on_test_stand=test_stand is not None),
            SystemdObserver(SystemdNotifier(), legs),
        ]
        source: FrameSource = scan.source
        wakeups = scan.wakeups
        if scene is not None and real_time:
            pace = MonotonicClock()
            source, wakeups = loop.Paced(source, scan.clock, pace), (pace.wakeups,)
        lost = lambda: recorder.lost if recorder else 0  # noqa: E731 - the recorder begins later
        for metrics in _counted(config.metrics, legs, stats, wakeups, scan, lost):
            stack.callback(metrics.close)
            observers.append(metrics)
        can = _breaking_can(config, scene, scan.clock)
        connect = can.connect if can is not None else None
        sink = stack.enter_context(
            can_sink(config, scan.clock, can_log, stats, real_time=real_time, connect=connect)
        )
        reference = None
        if test_stand is not None:
            from footsense.daemon.test_stand import sensor_of  # a robot needs no serial port

            reference = stack.enter_context(sensor_of(test_stand, legs.index(test_stand.leg), scan))
        if record is not None:
            header = _recording_header(config, scene, network, flags, calibrations)
            header |= test_stand.header() if test_stand is not None else {}
            recorder = Recorder(record, legs, header, blocking=not real_time or test_stand is not None)
            observers.append(recorder)
        for observer in observers:
            stack.enter_context(_ending(observer.close))
        yield Service(
            legs=legs,
            scanning=scan,
            source=source,
            network=network,
            pipeline=pipeline_for(config, network, flags, calibrations),
            sink=sink,
            observers=observers,
            recorder=recorder,
            can=can,
            reference=reference,
        )


def _counted(
    config: MetricsConfig | None,
    legs: tuple[str, ...],
    stats: CanStatistics,
    wakeups: Sequence[WakeupLatency],
    scan: Scanning,
    recorder_lost: Callable[[], int],
) -> list[Metrics]:
    """Return the metrics, none where their file cannot be written: that costs metrics, and no forces."""
    if config is None:
        return []
    try:
        metrics = Metrics(
            legs,
            stats,
            Path(config.counters),
            wakeups=wakeups,
            missed_deadlines=lambda: scan.source.missed_deadlines,
            recorder_lost=recorder_lost,
            log_lost=lost_lines,
        )
    except FootsenseError as error:
        _log.warning("%s; the forces go on without metrics", error)
        return []
    return [metrics]


def _breaking_can(config: Config, scene: Scene | None, clock: Clock) -> SimulatedCan | None:
    """Return the CAN interface of a scene in which it breaks; in any other, the virtual channel does."""
    faults = [fault for fault in scene.faults if isinstance(fault, CanFault)] if scene is not None else []
    return SimulatedCan(clock, config.can.bitrate, faults) if faults else None


def _flags(config: Config, *, simulated: bool) -> Flag:
    """Ask for the scheduling that the configuration names; return what every frame has to say of itself.

    Raises:
        ConfigError: It is required, and not granted.
    """
    if simulated:
        return Flag.SIMULATED
    asked = config.realtime
    refusals = () if asked is None else request_realtime(asked.priority, asked.cpu)
    if asked is not None and asked.required and refusals:
        raise ConfigError(f"realtime.required: {'; '.join(refusals)}; or take `required` away")
    for refusal in refusals:
        _log.warning("%s; the frames say degraded_timing", refusal)
    return Flag.DEGRADED_TIMING if refusals else Flag(0)


def _recording_header(
    config: Config, scene: Scene | None, network: Network, flags: Flag, calibrations: Calibrations
) -> dict[str, str]:
    return {
        "footsense": __version__,
        "started": wall_time_iso(),
        "config": msgspec.json.encode(config).decode(),
        "scene": msgspec.json.encode(scene).decode() if scene else "",
        "flags": str(int(flags)),
        "model_sha256": network.sha256,
        "foot_type": network.card.foot_type,
        "feet": ",".join(f"{leg}={foot}" for leg, foot in config.feet.items()),
        **calibrations_entry(calibrations),
        **this_machine(),
    }
