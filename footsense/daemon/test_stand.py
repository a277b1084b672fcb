"""A session on a test stand: its reference force sensor, its live guidance, and the simulated scene for practice."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from zlib import crc32

import msgspec
import numpy as np
from msgspec.structs import replace

from footsense.acquisition.serial_port import SerialLink
from footsense.calibration.checks import reference_findings
from footsense.calibration.evaluation import estimate_loads
from footsense.calibration.guide import SessionGuide
from footsense.calibration.loads import CalibrationLoad, LoadSet
from footsense.config.test_stand import NetFt, SerialSensor, SimulatedSensor, StandConfig
from footsense.daemon.acquisition import ScanSource
from footsense.errors import ConfigError
from footsense.estimation.network import Network
from footsense.frames import Vector
from footsense.ports import ReferenceSensor
from footsense.reference.net_ft import NetFtReference
from footsense.reference.sample_stream import SampleStream
from footsense.reference.sensor_mounting import SensorMounting
from footsense.reference.serial_sensor import LineDecoder, SerialReference
from footsense.sim.loads.press_sequence import paper_presses
from footsense.sim.reference_sensor import LINE_COLUMNS, SAMPLE_RATE_HZ, SimulatedForceSensor
from footsense.sim.scene import USUAL_EFFECTS, USUAL_HOST_COST_US, Fabrication, Scene
from footsense.sim.scene_loads import CalibrationLoads


@dataclass(frozen=True, slots=True, kw_only=True)
class StandSession:
    """One recording session on a test stand: test stand, leg, foot, session name.

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
        """Return the header entries for the recording: foot, session, leg, reference sensor."""
        return {
            "foot": self.foot,
            "session": self.session,
            "leg": self.leg,
            "reference": msgspec.json.encode(self.test_stand).decode(),
        }


def open_sensor(test_stand: StandConfig, row: int, scan_source: ScanSource) -> ReferenceSensor:
    """Open the reference force sensor of a test stand.

    Args:
        test_stand: Its file.
        row: Row of the pressed leg in the frames.
        scan_source: Clock that stamps the samples; for a simulated sensor, the true forces on the simulated feet.

    Raises:
        HardwareError: It is not connected.
        ConfigError: It is simulated, and the robot is not.
    """
    match test_stand.sensor:
        case SerialSensor() as sensor:
            link = SerialLink(sensor.device, sensor.baud, scan_source.clock)
            stream = _sample_stream(sensor.device, test_stand, sensor.rate_hz, sensor.unit_per_count)
            return SerialReference(
                link, LineDecoder(sensor.columns, sensor.separator), stream, sensor.start.encode()
            )
        case NetFt() as sensor:
            name = f"{sensor.host}:{sensor.port}"
            stream = _sample_stream(name, test_stand, sensor.rate_hz, 1 / sensor.counts_per_force)
            return NetFtReference(sensor.host, sensor.port, stream)
        case SimulatedSensor() as sensor:
            true_force_n_at = scan_source.true_force_n_at
            if true_force_n_at is None:
                raise ConfigError(
                    "sensor.kind: simulated needs a simulated foot; this configuration names real buses"
                )
            port = SimulatedForceSensor(
                lambda t_ns: true_force_n_at(t_ns)[row],
                scan_source.clock,
                sensor.seed,
                sensor.linearity_rel,
            )
            stream = _sample_stream("simulated sensor", test_stand, SAMPLE_RATE_HZ, 1.0)
            return SerialReference(port, LineDecoder(LINE_COLUMNS, ","), stream, b"start")


def _sample_stream(name: str, test_stand: StandConfig, rate_hz: float, unit_per_count: float) -> SampleStream:
    """Return the stream converter of a sensor."""
    axes = msgspec.structs.asdict(test_stand.axes)
    mounting = SensorMounting(axes, test_stand.mount_deg, test_stand.units, unit_per_count, test_stand.rated)
    return SampleStream(name, mounting, rate_hz, round(test_stand.latency_ms * 1e6))


def session_guide(
    test_stand: StandConfig,
    row: int,
    n_rows: int,
    n_wanted: int,
    network: Network,
    report: Callable[[str], None],
) -> SessionGuide:
    """Return the observer that guides a calibration session, with force estimates by the foot type's network.

    Args:
        test_stand: Its force sensor.
        row: Row of the leg in the frames.
        n_rows: Rows of the frames, and of the network.
        n_wanted: Number of loads of a complete set.
        network: Network of the design, whose forces check those of the sensor.
        report: Takes each message, one line.
    """

    def estimate(load: CalibrationLoad) -> Vector:
        loads = LoadSet.from_loads([load] * n_rows)
        force_n: Vector = estimate_loads(loads, network, network.card.trained_inputs, None).force_n[0]
        return force_n

    return SessionGuide(row, n_wanted, estimate, partial(reference_findings, test_stand), report)


def practice_scene(foot: str, row: int, session: str) -> Scene:
    """Return a scene that presses a foot, with the paper's fabrication tolerances, 362 times in random order.

    Args:
        foot: Its identity: another foot is another specimen.
        row: Row of its leg in the frames.
        session: Name of the mounting: in another one the foot sits a little differently, and the order is another.
    """
    mounting = crc32(session.encode()) & 0xFFFF
    presses = paper_presses("training")
    presses = presses[np.random.default_rng(mounting).permutation(len(presses))]
    number = int(foot.rpartition("-")[2])
    return Scene(
        description=f"{foot} on the test stand, pressed as in the paper.",
        load=CalibrationLoads(
            presses=tuple((x, y, z) for x, y, z in presses.tolist()), lean_deg=1.0, seed=mounting
        ),
        seed=mounting,
        host_cost_us=USUAL_HOST_COST_US,
        effects=replace(USUAL_EFFECTS, rubber=True),
        fabrication=Fabrication.with_paper_tolerances(seed=1, first=max(number - row, 0), mounting=mounting),
    )
