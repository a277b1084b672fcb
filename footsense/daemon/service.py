"""The complete daemon: opens inputs, pipeline, outputs and observers, and runs the main loop."""

import logging
import math
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from footsense.can.interface import Can
from footsense.can.sink import CanSink
from footsense.clock import MonotonicClock
from footsense.config import Config
from footsense.config.sections import Realtime
from footsense.daemon.acquisition import check_adapters, open_scan_source
from footsense.daemon.can_output import can_faults, can_sink, close_at_end, simulated_can
from footsense.daemon.estimation import pipeline_for
from footsense.daemon.loop import Loop
from footsense.daemon.models import load_models
from footsense.daemon.recording_header import recording_header
from footsense.daemon.scheduling import low_latency_interpreter, request_realtime
from footsense.daemon.simulation import PacedSource, is_simulated
from footsense.errors import ConfigError, FootsenseError
from footsense.estimation.network import Network
from footsense.frames import Flag, Vector
from footsense.ports import FrameSource, Observer, WakeupLatency
from footsense.recording.recorder import Recorder, check_recording_target
from footsense.ring.cycle_ring import CycleRing
from footsense.ring.records import ServiceStatus
from footsense.ring.ring_file import default_ring
from footsense.sim.can.frame_log import check_log_target
from footsense.sim.can.interface import SimulatedCan
from footsense.sim.scene import Scene
from footsense.telemetry.log_lines import n_lost_log_lines
from footsense.telemetry.systemd import LegStateLogger, SystemdNotifier

if TYPE_CHECKING:
    from footsense.daemon.test_stand import StandSession

_log = logging.getLogger(__name__)


@dataclass(kw_only=True)
class Service(Loop):
    """Open daemon: main loop, outputs, child processes.

    Attributes:
        legs: Names of the legs in the order of the rows of every frame.
        true_force_n_at: True force on every foot at a time [ns], shape (legs, 3) [N]; None on a real robot.
        source: Source of frames, paced by the wall clock if a simulation has to be.
        network: The network in use.
        simulated_can: Simulated CAN interface of a scene with CAN faults.
        n_late_discards: Returns how often readings were discarded, as the loop or a record came too late.
        wakeups: Wake-up latency of each thread's clock; none in virtual time.
        recorder: Recorder, if the run is recorded.
        is_viewable: Whether its ring is a file, which the page and other programs read.
    """

    sink: CanSink
    observers: list[Observer]
    legs: tuple[str, ...]
    true_force_n_at: Callable[[int], Vector] | None
    source: FrameSource
    network: Network
    simulated_can: SimulatedCan | None
    n_late_discards: Callable[[], int]
    wakeups: Sequence[WakeupLatency]
    recorder: Recorder | None = None
    is_viewable: bool = False

    def run(self, stop: Callable[[], bool] = bool, until_ns: float = math.inf) -> None:
        """Run the main loop until `stop` returns true, or until a time of the clock [ns]."""
        with low_latency_interpreter():
            self.run_until(self.source, stop, until_ns)

    def status(self) -> ServiceStatus:
        """Return the values of the service that its readers need and that no cycle has."""
        histograms = [thread.histogram for thread in self.wakeups]
        return ServiceStatus(
            can=self.sink.stats,
            baseline=self.pipeline.baseline_pf.tobytes(),
            wakeup_histogram=[sum(cell) for cell in zip(*histograms, strict=True)] if histograms else None,
            n_overruns=sum(thread.overruns for thread in self.wakeups),
            n_late_discards=self.n_late_discards(),
            n_lost_log_lines=n_lost_log_lines(),
            n_lost_cycles=self.recorder.n_lost_cycles if self.recorder else 0,
        )


@contextmanager
def open_service(
    config: Config,
    scene: Scene | None,
    *,
    real_time: bool,
    record: Path | None = None,
    can_log: Path | None = None,
    test_stand: "StandSession | None" = None,
) -> Iterator[Service]:
    """Open the daemon during a `with` block: inputs first, then outputs; close them in reverse order.

    Args:
        config: The robot.
        scene: Scene of its simulation, None for its real buses.
        real_time: Whether the loop must never wait for its recorder; a simulation is then paced by the wall clock.
        record: File to record to.
        can_log: File for the CAN frames that a simulation sends.
        test_stand: The test stand that one foot is pressed on; there the loop waits for its recorder, as nobody walks.

    Yields:
        The service.

    Raises:
        FootsenseError: An input or output is missing or wrong.
    """
    legs = config.legs
    with ExitStack() as stack:
        if record is not None:
            check_recording_target(record)
        if scene is not None and not is_simulated(config):
            # Simulated forces must not reach the controller of the real robot, nor readers of its ring.
            config = msgspec.structs.replace(config, can=Can(interface="virtual"), ring=None)
        if can_log is not None:
            interface = "virtual" if can_faults(scene) else config.can.interface
            check_log_target(can_log, interface, config.can.channel)
        models = load_models(config)
        # Before any chip is accessed; the recorder's process drops the scheduling that it inherits.
        flags = Flag.SIMULATED
        if scene is None:
            check_adapters(config)  # before this process could delay another one that reads these feet
            flags = request_scheduling(config.realtime)
        scan = stack.enter_context(open_scan_source(config, scene))
        if scan.response_sha256 not in {None, models.network.card.response_sha256}:
            _log.warning("the network was trained on another response table than the simulated feet follow")
        observers: list[Observer] = [
            LegStateLogger(legs, on_test_stand=test_stand is not None),
            SystemdNotifier(legs),
        ]
        pipeline = pipeline_for(models, flags)
        source: FrameSource = scan.source
        wakeups = scan.wakeups
        if scene is not None and real_time:
            pace = MonotonicClock()
            source = PacedSource(source, scan.clock, pace, pipeline.set_degraded_timing)
            wakeups = (pace.wakeups,)
        can = simulated_can(config, scene, scan.clock)
        sink = stack.enter_context(
            can_sink(models, scan.clock, can_log, can.connect if can is not None else None)
        )
        reference = None
        if test_stand is not None:
            from footsense.daemon.test_stand import open_sensor  # a robot needs no serial port

            row = legs.index(test_stand.leg)
            reference = stack.enter_context(closing(open_sensor(test_stand.test_stand, row, scan)))
        service = Service(
            legs=legs,
            true_force_n_at=scan.true_force_n_at,
            source=source,
            network=models.network,
            pipeline=pipeline,
            sink=sink,
            observers=observers,
            clock=scan.clock,
            simulated_can=can,
            reference=reference,
            n_late_discards=lambda: scan.source.n_late_discards,
            wakeups=wakeups,
        )
        header = recording_header(models, scene, flags, scan.clock.now_ns())
        header |= test_stand.header() if test_stand is not None else {}
        path = config.ring_path or (default_ring(is_simulated=scene is not None) if real_time else None)
        if ring := _open_ring(service, config, path, header, is_recorded=record is not None):
            observers.append(ring)
            service.recorder = _open_recorder(
                stack, record, ring, waits=not real_time or test_stand is not None
            )
        for observer in observers:
            stack.enter_context(close_at_end(observer.close))
        yield service


def _open_ring(
    service: Service, config: Config, path: Path | None, header: Mapping[str, str], *, is_recorded: bool
) -> CycleRing | None:
    """Open the ring of a service; without its file one for the recorder alone, or none, as forces must go on."""
    legs, rate_hz = config.legs, config.frames_hz
    if path is not None:
        try:
            ring = CycleRing(path, legs, header, rate_hz, service.status)
        except FootsenseError as error:
            _log.warning("%s; the forces go on without metrics, page and snapshot", error)
        else:
            service.is_viewable = True
            return ring
    return CycleRing(None, legs, header, rate_hz, service.status) if is_recorded else None


def _open_recorder(stack: ExitStack, path: Path | None, ring: CycleRing, *, waits: bool) -> Recorder | None:
    if path is None:
        return None
    # A signal that ends the start waits until it closes the recorder, too.
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        recorder = Recorder(path, ring, waits=waits)
        stack.enter_context(close_at_end(recorder.close))
        return recorder
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


def request_scheduling(asked: Realtime | None) -> Flag:
    """Request the configured scheduling; return the flags for every frame.

    Raises:
        ConfigError: The scheduling is required and denied.
    """
    refusals = () if asked is None else request_realtime(asked.priority)
    if asked is not None and asked.required and refusals:
        raise ConfigError(f"realtime.required: {'; '.join(refusals)}; or take `required` away")
    for refusal in refusals:
        _log.warning("%s; the frames say degraded_timing", refusal)
    return Flag.DEGRADED_TIMING if refusals else Flag(0)
