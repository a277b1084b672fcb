"""`footsense calibrate` on a simulated stand: what it takes from a recording beside the loads, and what it refuses."""

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from footsense.can.interface import Can
from footsense.cli.calibration import calibrate
from footsense.config import Config
from footsense.config.sections import Bus
from footsense.config.test_stand import Axes, SimulatedSensor, StandConfig
from footsense.daemon.service import open_service
from footsense.daemon.test_stand import StandSession
from footsense.estimation.settings import TareLimits
from footsense.foot.calibration_files import read_calibration
from footsense.recording.replay import Replay
from footsense.sim.scene import Scene
from footsense.sim.scene_loads import CalibrationLoads
from tests.support.cycles import without_temperatures
from tests.system.simulated_test_stand import MADE, presses

pytestmark = pytest.mark.slow

STAND = StandConfig(
    sensor=SimulatedSensor(seed=1, linearity_rel=0.0),
    axes=Axes(x="-x", y="-y", z="-z"),
    units="gf",
    rated=(4000.0, 4000.0, 8000.0),
    latency_ms=2.1,
)
#: A board with thermometers, and a foot that is not like its design yet.
CONFIG = Config(
    buses=(Bus(device="sim", legs={"lf": 0}),),
    can=Can(interface="virtual"),
    board="ad7746",
    feet={"lf": "foot-0007"},
    tare=TareLimits(unloaded_limit_rel=0.5),
)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of a session of 24 presses, most of which count."""
    path = tmp_path_factory.mktemp("stand") / "session.mcap"
    # The board's range ends below a shut gap.
    light = tuple((0.5 * x, 0.5 * y, 0.5 * z) for x, y, z in presses(24))
    load = CalibrationLoads(presses=light, rise_s=0.1, dwell_s=0.7, pause_s=0.8)
    scene = Scene(description="a test stand", load=load, lead_in_s=2.0, fabrication=MADE)
    end_ns = load.build(round(scene.lead_in_s * 1e9)).end_ns + 500_000_000
    run = StandSession(test_stand=STAND, leg="lf", foot="foot-0007", session="one")
    with open_service(CONFIG, scene, record=path, real_time=False, test_stand=run) as service:
        service.run(until_ns=end_ns)
    return path


def invoke(*arguments: str | Path) -> Result:
    return CliRunner().invoke(calibrate, [*map(str, arguments), "--foot", "foot-0007"])


def test_a_calibration_has_the_temperature_of_its_sessions(session: Path, tmp_path: Path) -> None:
    """The mean of the converter's temperature; NaN if one session has none."""
    done = invoke(session, "--calibrations", tmp_path)
    assert done.exit_code == 0, done.exception
    told = [cycle.temperature_c for cycle in Replay(session) if cycle.temperature_c is not None]
    calibration = read_calibration(tmp_path / "foot-0007", "aoyagi-3x3")
    assert calibration.calibrated_at_c == pytest.approx(told[0][0])
    assert f"temperature [degC]  {told[0][0]:.4g}" in re.sub("  +", "  ", done.stdout)
    untold = without_temperatures(session, tmp_path / "untold.mcap", session="untold")
    done = invoke(session, untold, "--calibrations", tmp_path / "both")
    assert done.exit_code == 0, done.exception
    assert np.isnan(read_calibration(tmp_path / "both" / "foot-0007", "aoyagi-3x3").calibrated_at_c)
