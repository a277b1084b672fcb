"""A made foot on a simulated test_stand: poked, read by the daemon through the chips' bytes, recorded, and found again.

Two sessions: one to learn, with the paper's 362 presses, one to judge, with its 180, in which the foot was put on anew
and the reference was zeroed anew. Forces are those of the reference; what the foot really felt is kept beside them.
"""

from pathlib import Path
from typing import Final, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from footsense.calibration.session.recorded_session import RecordedSession, read_session
from footsense.config import Bus, Can, Config
from footsense.config.test_stand import Axes, Simulated, StandConfig
from footsense.daemon.acquisition import scanning
from footsense.daemon.foot_types import FOOT_TYPE
from footsense.daemon.service import service
from footsense.daemon.test_stand import StandSession
from footsense.sim.loads.ground_load import Load
from footsense.sim.scene import CalibrationLoads, Effects, Fabrication, Scene, Unloaded
from footsense.sim.test_stand.calibration_loads import PressSequence, paper_presses
from footsense.sim.test_stand.reference_sensor import RATED_GF, TRANSMISSION_NS

Vector = NDArray[np.float64]

#: Twenty feet of this seed are much like the mean of 160.
_TYPICAL_SEED = 8

LEG: Final = "lf"
#: How long a press grows and goes, how long it is held, and how long the foot then rests [s].
_RISE_S, _HOLD_S, _REST_S = 0.05, 0.5, 0.5
#: How exactly rails hold a stick [deg].
_LEAN_DEG = 1.0
#: Before the first press, the foot is tared and the reference finds its zero [s].
_LEAD_IN_S = 1.5
#: Scans whose mean is what an element reads at rest.
_REST_SCANS = 40

_RATED = (float(RATED_GF[0]), float(RATED_GF[1]), float(RATED_GF[2]))

#: What is not ideal on a test stand, all at once.
_EFFECTS = Effects(converter_noise=True, converter_clock_rel=0.02, gap_contact=True, rubber=True)


class Workshop(NamedTuple):
    """Which feet are made, as badly as the paper's, and of what type.

    Attributes:
        seed: Of all that is drawn.
        foot_type: A released type, or a folder.
    """

    seed: int = _TYPICAL_SEED
    foot_type: str = FOOT_TYPE


class Trial(NamedTuple):
    """One foot, poked.

    Attributes:
        learning: Its session with the 362 presses.
        judging: Its session with the 180.
        felt_n: What it really felt in each load of the second that counts [N], shape (n, 3).
    """

    learning: RecordedSession
    judging: RecordedSession
    felt_n: Vector


def run_test_stand(workshop: Workshop, number: int, folder: Path, *, every: int = 1) -> Trial:
    """CalibrationLoad a foot in both sessions and read the recordings.

    Args:
        workshop: Where it was made.
        number: Which of its feet.
        folder: Where the recordings go; not there yet, both are made.
        every: Take one of so many presses.

    Raises:
        FootsenseError: The daemon cannot be started, or a recording is there already.
    """
    config = _config(workshop, number)
    learning, _ = _session(workshop, number, config, "training", folder, every)
    judging, presses = _session(workshop, number, config, "verification", folder, every)
    felt_n = np.array([presses.contact(LEG, load.t_ns).force_n for load in judging.loads])
    return Trial(learning, judging, felt_n)


def name_of(number: int) -> str:
    """Return the identity of a foot of the workshop."""
    return f"foot-{number:04d}"


def _session(
    workshop: Workshop, number: int, config: Config, presses: str, folder: Path, every: int
) -> tuple[RecordedSession, Load]:
    """Record a session on the test_stand, and read it; return what was done to the foot beside it."""
    judging = presses == "verification"
    scene = Scene(
        description=f"{name_of(number)} on the test_stand, {presses}",
        load=CalibrationLoads(
            presses=tuple((x, y, z) for x, y, z in paper_presses(presses)[::every].tolist()),
            rise_s=_RISE_S,
            dwell_s=_HOLD_S,
            rest_s=_REST_S,
            lean_deg=_LEAN_DEG,
            seed=_seed(workshop, number) + judging,
        ),
        lead_in_s=_LEAD_IN_S,
        seed=_seed(workshop, number) + judging,
        effects=_EFFECTS,
        fabrication=Fabrication.as_badly_made(seed=workshop.seed, first=number, mounting=1 + judging),
    )
    sensor = Simulated(seed=_seed(workshop, number))
    test_stand = StandConfig(
        sensor=sensor,
        axes=Axes(x="-x", y="-y", z="-z"),
        units="gf",
        rated=_RATED,
        latency_ms=TRANSMISSION_NS / 1e6,
    )
    run = StandSession(test_stand=test_stand, leg=LEG, foot=name_of(number), session=presses)
    path = folder / f"{name_of(number)}-{presses}.mcap"
    load = scene.load.build(round(scene.lead_in_s * 1e9))
    assert isinstance(load, PressSequence), "a bench loads"
    with service(config, scene, real_time=False, record=path, test_stand=run) as running:
        clock = running.scanning.clock
        running.run(lambda: clock.now_ns() > load.ends_ns)
    return read_session(path, name_of(number)), load


def _config(workshop: Workshop, number: int) -> Config:
    """Return a bench's configuration: one leg, its elements at rest as a probe finds them."""
    config = Config(
        buses=(Bus(device="sim", legs={LEG: 0}),),
        can=Can(interface="virtual"),
        feet={LEG: name_of(number)},
        foot_type=workshop.foot_type,
    )
    hanging = Scene(
        description="at rest",
        load=Unloaded(),
        seed=_seed(workshop, number),
        effects=_EFFECTS,
        fabrication=Fabrication.as_badly_made(seed=workshop.seed, first=number, mounting=0),
    )
    with scanning(config, hanging) as found:
        scans = [found.source.read() for _ in range(_REST_SCANS)]
    read_pf = [scan.capacitance_pf[0] for scan in scans if not scan.reading.any()]
    unloaded_pf = tuple(np.mean(read_pf, axis=0).round(4).tolist())
    return msgspec.structs.replace(config, unloaded_pf={LEG: unloaded_pf})


def _seed(workshop: Workshop, number: int) -> int:
    return 10_000 * workshop.seed + 2 * number
