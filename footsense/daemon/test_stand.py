"""From a bench's file to its force sensor: which backend stands behind the port, and what it is told."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import msgspec
import numpy as np

from footsense.acquisition.serial_port import SerialLink
from footsense.config.test_stand import Binary, FileSensor, Lines, NetFt, Serial, Simulated, StandConfig
from footsense.daemon.acquisition import Scanning
from footsense.errors import ConfigError, RecordingError
from footsense.frames import Reference
from footsense.ports import ReferenceSensor, SerialPort
from footsense.recording.replay import Replay
from footsense.reference.mounting import Mounting
from footsense.reference.net_ft import NetFtReference
from footsense.reference.record_decoder import BinaryDecoder, Decoder, LineDecoder
from footsense.reference.recorded_file import FileReference, read_csv
from footsense.reference.sample_stream import ReferenceStream, SensorStatistics
from footsense.reference.sample_times import SampleTimes
from footsense.reference.serial_sensor import SerialReference
from footsense.sim.test_stand import reference_sensor as simulated

__all__ = ["StandSensor", "StandSession", "is_live", "sensor_of"]


@dataclass(frozen=True, slots=True, kw_only=True)
class StandSession:
    """What is recorded on a bench.

    Attributes:
        test_stand: Its force sensor.
        leg: The leg whose foot is pressed.
        foot: The identity of that foot.
        session: Name of this mounting of the foot.
    """

    test_stand: StandConfig
    leg: str
    foot: str
    session: str

    def header(self) -> dict[str, str]:
        """Return what the recording is to say of it."""
        return {
            "foot": self.foot,
            "session": self.session,
            "leg": self.leg,
            "reference": msgspec.json.encode(self.test_stand).decode(),
        }


class StandSensor(ReferenceSensor, Protocol):
    """A force sensor that tells how it went."""

    def figures(self) -> SensorStatistics:
        """Return the figures so far."""
        ...


def is_live(test_stand: StandConfig) -> bool:
    """Tell whether a sensor lives in real time: one that is no simulation, and no file."""
    return isinstance(test_stand.sensor, Serial | NetFt)


@contextmanager
def sensor_of(run: StandSession, row: int, scanning: Scanning) -> Iterator[StandSensor]:
    """Open a bench's force sensor, and close it at the end.

    Args:
        run: The bench and its leg.
        row: Row of that leg in the frames.
        scanning: The clock that its samples are stamped in; on a simulated robot, what the foot feels.

    Yields:
        The sensor.

    Raises:
        HardwareError: It is not there.
        ConfigError: It is simulated, and the robot is not.
        RecordingError: The recording that it is to be read from is none of a bench.
    """
    with closing(_opened(run.test_stand, row, scanning)) as sensor:
        yield sensor


def _opened(test_stand: StandConfig, row: int, scanning: Scanning) -> StandSensor:
    match test_stand.sensor:
        case Serial() as described:
            link = SerialLink(described.device, described.baud, scanning.clock)
            stream = _stream(described.device, test_stand, described.rate_hz, described.unit_per_count)
            return SerialReference(link, _decoder(described.framing), stream, described.start.encode())
        case NetFt() as described:
            name = f"{described.host}:{described.port}"
            stream = _stream(name, test_stand, described.rate_hz, 1 / described.counts_per_force)
            return NetFtReference(described.host, described.port, stream)
        case FileSensor() as described:
            return FileReference(_recorded(Path(described.path), test_stand))
        case Simulated() as described:
            return _simulated(described, test_stand, row, scanning)


def _simulated(described: Simulated, test_stand: StandConfig, row: int, scanning: Scanning) -> StandSensor:
    true_force_n = scanning.true_force_n
    if true_force_n is None:
        raise ConfigError(
            "sensor.kind: simulated needs a simulated foot; this configuration names real buses"
        )
    sensor = simulated.SimulatedSensor(
        lambda t_ns: true_force_n(t_ns)[row], described.seed, described.linearity_rel
    )
    port: SerialPort = simulated.SimulatedPort(sensor, scanning.clock)
    stream = _stream("simulated sensor", test_stand, simulated.RATE_HZ, 1.0)
    return SerialReference(port, LineDecoder(simulated.COLUMNS, ","), stream, b"start")


def _stream(name: str, test_stand: StandConfig, rate_hz: float, unit_per_count: float) -> ReferenceStream:
    times = SampleTimes(rate_hz, round(test_stand.latency_ms * 1e6))
    return ReferenceStream(name, _mounting(test_stand, unit_per_count), times)


def _mounting(test_stand: StandConfig, unit_per_count: float) -> Mounting:
    axes = {"x": test_stand.axes.x, "y": test_stand.axes.y, "z": test_stand.axes.z}
    return Mounting(axes, test_stand.mount_deg, test_stand.units, unit_per_count, test_stand.rated)


def _decoder(framing: Lines | Binary) -> Decoder:
    if isinstance(framing, Lines):
        return LineDecoder(framing.columns, framing.separator)
    return BinaryDecoder(framing.columns, framing.layout, bytes.fromhex(framing.sync), framing.checksum)


def _recorded(path: Path, test_stand: StandConfig) -> Reference:
    if path.suffix == ".csv":
        return read_csv(path, _mounting(test_stand, 1.0), round(test_stand.latency_ms * 1e6))
    blocks = [cycle.reference for cycle in Replay(path) if cycle.reference is not None]
    if not any(len(block.t_ns) for block in blocks):
        raise RecordingError(f"{path}: holds no reference; a recording of `footsense record` does")
    t_ns, force_n, saturated = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    order = np.argsort(t_ns, kind="stable")
    return Reference(t_ns[order], force_n[order], saturated[order])
