"""Simulated test-stand sessions of one fabricated foot, run through the real daemon and recorder, and read back.

Two sessions: one for calibration, with the paper's 362 presses, and one for evaluation, with its 180, in which the foot
is mounted anew and the reference has a new offset. The simulator's true forces are kept beside those of the reference.
"""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final, Literal, NamedTuple

import msgspec
import numpy as np

from footsense.calibration.loads import LoadSet
from footsense.calibration.recorded_session import RecordedSession, read_session
from footsense.can.interface import Can
from footsense.clock import stopwatch_ns
from footsense.config import Config
from footsense.config.sections import Bus
from footsense.config.test_stand import Axes, SimulatedSensor, StandConfig
from footsense.daemon.acquisition import open_scan_source
from footsense.daemon.foot_types import DEFAULT_FOOT_TYPE
from footsense.daemon.service import open_service
from footsense.daemon.test_stand import StandSession
from footsense.frames import Vector
from footsense.sim.loads.ground_load import ContactSource
from footsense.sim.loads.press_sequence import PressSequence, paper_presses
from footsense.sim.reference_sensor import LINE_TRANSMISSION_NS, RATED_GF
from footsense.sim.scene import Effects, Fabrication, Scene
from footsense.sim.scene_loads import CalibrationLoads, Unloaded

#: Twenty feet of this seed have errors near the mean of 160.
_TYPICAL_FOOT_SEED = 8

TRIAL_LEG: Final = "lf"
Protocol = Literal["training", "verification"]
PROTOCOLS: Final[tuple[Protocol, ...]] = ("training", "verification")
#: Rise and fall of a press, dwell, and pause before the next [s].
_RISE_S, _DWELL_S, _PAUSE_S = 0.05, 0.5, 0.5
#: Accuracy of the rails of the stick [deg].
_PRESS_LEAN_DEG = 1.0
#: Time before the first press, for the tare and the offset of the reference [s].
_LEAD_IN_S = 1.5
#: Scans of the unloaded reading.
_N_UNLOADED_SCANS = 40

#: All effects of a test stand that are not ideal.
_EFFECTS = Effects(converter_noise=True, converter_clock_rel=0.02, gap_contact=True, rubber=True)


class FootBatch(NamedTuple):
    """A batch of simulated feet with the paper's fabrication tolerances: seed and foot type.

    Attributes:
        seed: Seed of the batch.
        foot_type: A released type, or a folder.
    """

    seed: int = _TYPICAL_FOOT_SEED
    foot_type: str = DEFAULT_FOOT_TYPE


class PressedFoot(NamedTuple):
    """Calibration loads of both sessions of one simulated foot, as read back from their recordings.

    Attributes:
        training: Accepted loads of the session for the calibration, of 362 presses.
        test: Accepted loads of the session for the evaluation, of 180.
        test_true_force_n: True forces of `test` [N], shape (n, 3).
        n_rejected_test_presses: Presses of the second session that are not accepted.
        training_read_duration_s: Time to read the recording of the first session [s].
    """

    training: LoadSet
    test: LoadSet
    test_true_force_n: Vector
    n_rejected_test_presses: int
    training_read_duration_s: float


def press_foot(batch: FootBatch, foot_number: int, *, every_nth_press: int = 1) -> PressedFoot:
    """Simulate and record both sessions of a foot; return their loads as read back.

    Args:
        batch: Batch of the foot.
        foot_number: Number of the foot in it.
        every_nth_press: Use one of so many presses.

    Raises:
        FootsenseError: The daemon cannot be started.
    """
    config = _trial_config(batch, foot_number)
    with TemporaryDirectory(prefix="footsense-test-stand-") as folder:
        (training, _, read_ns), (test, presses, _) = (
            _record_session(batch, foot_number, config, protocol, Path(folder), every_nth_press)
            for protocol in PROTOCOLS
        )
    true_force_n = [presses.contact(TRIAL_LEG, sum(dwell_ns) // 2).force_n for dwell_ns in test.dwells_ns]
    return PressedFoot(
        training.loads, test.loads, np.array(true_force_n), test.rejected.total(), read_ns * 1e-9
    )


def foot_name(foot_number: int) -> str:
    """Return the name of a foot of a batch."""
    return f"foot-{foot_number:04d}"


def _record_session(
    batch: FootBatch,
    foot_number: int,
    config: Config,
    protocol: Protocol,
    folder: Path,
    every_nth_press: int,
) -> tuple[RecordedSession, ContactSource, int]:
    """Record one simulated test-stand session; return it read back, its true load, and the reading time [ns].

    Returns:
        The session read from file, the simulated presses, and how long reading took [ns].
    """
    foot, mounting = foot_name(foot_number), 1 + (protocol == "verification")
    seed = _foot_seed(batch, foot_number)
    scene = Scene(
        description=f"{foot} on the test stand, {protocol}",
        load=CalibrationLoads(
            presses=tuple((x, y, z) for x, y, z in paper_presses(protocol)[::every_nth_press].tolist()),
            rise_s=_RISE_S,
            dwell_s=_DWELL_S,
            pause_s=_PAUSE_S,
            lean_deg=_PRESS_LEAN_DEG,
            seed=seed + mounting - 1,
        ),
        lead_in_s=_LEAD_IN_S,
        seed=seed + mounting - 1,
        effects=_EFFECTS,
        fabrication=Fabrication.with_paper_tolerances(seed=batch.seed, first=foot_number, mounting=mounting),
    )
    x_gf, y_gf, z_gf = RATED_GF.tolist()
    test_stand = StandConfig(
        sensor=SimulatedSensor(seed=seed),
        axes=Axes(x="-x", y="-y", z="-z"),
        units="gf",
        rated=(x_gf, y_gf, z_gf),
        latency_ms=LINE_TRANSMISSION_NS / 1e6,
    )
    run = StandSession(test_stand=test_stand, leg=TRIAL_LEG, foot=foot, session=protocol)
    path = folder / f"{foot}-{protocol}.mcap"
    load = scene.load.build(round(scene.lead_in_s * 1e9))
    assert isinstance(load, PressSequence), "the scene is of presses"
    with open_service(config, scene, real_time=False, record=path, test_stand=run) as running:
        running.run(until_ns=load.end_ns)
    began_ns = stopwatch_ns()
    return read_session(path, foot), load, stopwatch_ns() - began_ns


def _trial_config(batch: FootBatch, foot_number: int) -> Config:
    """Return the configuration of one leg, with the unloaded readings that a probe would measure."""
    config = Config(
        buses=(Bus(device="sim", legs={TRIAL_LEG: 0}),),
        can=Can(interface="virtual"),
        feet={TRIAL_LEG: foot_name(foot_number)},
        foot_type=batch.foot_type,
    )
    hanging = Scene(
        description="unloaded",
        load=Unloaded(),
        seed=_foot_seed(batch, foot_number),
        effects=_EFFECTS,
        fabrication=Fabrication.with_paper_tolerances(seed=batch.seed, first=foot_number, mounting=0),
    )
    with open_scan_source(config, hanging) as found:
        scans = found.read_whole_scans(_N_UNLOADED_SCANS)
    readings_pf = [scan.capacitance_pf[0] for scan in scans if not scan.reading.any()]
    unloaded_pf = tuple(np.mean(readings_pf, axis=0).round(4).tolist())
    return msgspec.structs.replace(config, unloaded_pf={TRIAL_LEG: unloaded_pf})


def _foot_seed(batch: FootBatch, foot_number: int) -> int:
    """Return the seed of a foot of a batch."""
    return 10_000 * batch.seed + 2 * foot_number
