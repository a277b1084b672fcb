"""Calibrated feet that become warm on a robot whose converters tell: from the chip's bytes to a replay."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from footsense.can.interface import Can
from footsense.cli.recordings import replay
from footsense.config import Config
from footsense.config.sections import Bus
from footsense.daemon.service import open_service
from footsense.foot.parameters import UNKNOWN_TEMPERATURE_SIGMA_REL
from footsense.frames import Cycle, State
from footsense.recording.mcap_writer import McapFile
from footsense.recording.replay import Replay
from footsense.ring.records import NumberedCycle
from footsense.sim.scene import Effects, Scene, Warming
from footsense.sim.scene_loads import Constant
from tests.support.calibrations import calibration
from tests.support.seen import Seen
from tests.system.simulated_test_stand import MADE, true_parameters

FORCE_N = (0.2, -0.1, 0.5)
ROOM_C, KELVIN = 25.0, 20.0

#: Warm before the tare, so that only the rubber is another one; asked for their temperature at once and after 10 s.
WARM = Effects(warming=Warming(from_s=0.0, over_s=0.01, kelvin=KELVIN))
#: Warm while they carry, long before they are asked again; their zeros drift along.
WARMS = Effects(warming=Warming(from_s=5.0, over_s=0.1, kelvin=KELVIN))


def robot(feet: Path) -> Config:
    return Config(
        buses=(Bus(device="sim", legs={"lf": 0, "rf": 1}),),
        can=Can(interface="virtual"),
        board="ad7746",
        feet={"lf": "foot-0007", "rf": "foot-0008"},
        calibrations=str(feet),
    )


def write_calibrations(feet: Path, temperature_c: float | None) -> Path:
    """Write the calibrations of both feet, as a perfect calibration at a temperature would."""
    for number in (0, 1):
        calibration(
            feet, f"foot-000{7 + number}", parameters=true_parameters(number), temperature_c=temperature_c
        )
    return feet


def walked(feet: Path, effects: Effects, until_s: float, record: Path | None = None) -> list[Cycle]:
    """Return the cycles of feet that carry from 2 s on."""
    scene = Scene(
        description="pressed",
        load=Constant(force_n=FORCE_N),
        lead_in_s=2.0,
        fabrication=MADE,
        effects=effects,
    )
    seen = Seen()
    with open_service(robot(feet), scene, record=record, real_time=False) as service:
        service.observers.append(seen)
        service.run(until_ns=until_s * 1e9)
    return seen.cycles


def test_a_known_temperature_corrects_and_an_unknown_one_widens(tmp_path: Path) -> None:
    """20 K make forces 8 % too small; what two converters are off by leaves 1 %, else sigma covers it."""
    size_n = float(np.linalg.norm(FORCE_N))
    known = walked(write_calibrations(tmp_path / "known", ROOM_C), WARM, 3.0)[-1].forces
    unknown = walked(write_calibrations(tmp_path / "unknown", None), WARM, 3.0)[-1].forces
    for forces in (known, unknown):
        assert forces.state.tolist() == [State.VALID, State.VALID]
    known_n, unknown_n = (np.linalg.norm(forces.force_n, axis=1) for forces in (known, unknown))
    # On scans of 0.1 s at rest the network itself is 4 % low.
    assert np.abs(known_n / size_n - 1.0).max() < 0.045
    np.testing.assert_allclose(unknown_n / size_n, 1.0 / 1.088, atol=0.02)
    # The network's own sigma, which slow scans at rest make wide, is in both.
    assert (unknown.sigma_n[:, 2] > UNKNOWN_TEMPERATURE_SIGMA_REL * unknown_n).all()
    assert (known.sigma_n[:, 2] < unknown.sigma_n[:, 2]).all()


@pytest.mark.slow
def test_a_replay_is_as_warm_as_the_walk_was(tmp_path: Path) -> None:
    """Temperatures are recorded when they change; without them the same readings give the forces of a cold foot."""
    walk = tmp_path / "walk.mcap"
    cycles = walked(write_calibrations(tmp_path / "feet", ROOM_C), WARMS, 10.6, walk)
    told = [cycle.temperature_c for cycle in cycles if cycle.temperature_c is not None]
    assert len(told) == 2
    np.testing.assert_allclose(told[1] - told[0], KELVIN, atol=1e-3)
    before, after = (cycles[n].forces.force_n[:, 2] for n in (850, -1))
    assert (after / before).min() > 1.08
    recorded = [cycle.temperature_c for cycle in Replay(walk) if cycle.temperature_c is not None]
    np.testing.assert_array_equal(recorded, told)
    result = CliRunner().invoke(replay, [str(walk), "--check"])
    assert "cycles equal bit for bit" in result.output, result.exception
    old = tmp_path / "old.mcap"
    with old.open("wb") as file:
        recording = McapFile(file.fileno(), Replay(walk).header)
        for number, cycle in enumerate(Replay(walk)):
            recording.add_entry(NumberedCycle(number, cycle._replace(temperature_c=None)))
        recording.finish()
    assert CliRunner().invoke(replay, [str(old)]).output == f"{len(cycles)} cycles replayed\n"
    result = CliRunner().invoke(replay, [str(old), "--check"])
    assert "leg lf: fx_n was" in str(result.exception)
