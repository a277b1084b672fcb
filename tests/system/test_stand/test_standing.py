"""`footsense test-stand calibrate --no-reference`: from a robot that stood to forces in a direction that is right."""

import json
import re
from pathlib import Path

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner, Result

from footsense.can.interface import Can
from footsense.cli.info import info
from footsense.cli.test_stand.calibration import calibrate
from footsense.config import Config
from footsense.config.sections import Bus
from footsense.daemon.service import open_service
from footsense.estimation.settings import TareLimits
from footsense.foot.calibration_files import read_calibration
from footsense.foot.directions import angles_between_deg
from footsense.sim.scene import Effects, Scene
from footsense.sim.scene_loads import CalibrationLoads
from tests.support.seen import Seen
from tests.system.simulated_test_stand import MADE, presses

pytestmark = pytest.mark.slow

_ROBOT = Config(
    buses=(Bus(device="sim", addresses={"lf": 0x2C, "rf": 0x2D}),),
    can=Can(interface="virtual"),
    feet={"lf": "foot-0007", "rf": "foot-0008"},
    tare=TareLimits(unloaded_limit_rel=0.5),
)


def _run(
    robot: Config, postures: tuple[tuple[float, float, float], ...], record: Path | None = None
) -> float:
    """Let feet as made, whose mount is right, stand on creeping rubber; return their mean direction error [deg]."""
    fabrication = msgspec.structs.replace(MADE, gap_um=1.0, stray_pf=0.3, mount_deg=0.0)
    gentle = tuple((0.6 * x, 0.6 * y, 0.6 * z) for x, y, z in postures)  # at which no gap closes
    load = CalibrationLoads(presses=gentle, rise_s=0.2, dwell_s=0.9, pause_s=0.6, lean_deg=3.0)
    effects = Effects(converter_noise=True, rubber=True, gap_contact=True)
    scene = Scene(description="postures", load=load, fabrication=fabrication, effects=effects)
    source, seen = load.build(round(scene.lead_in_s * 1e9)), Seen()
    with open_service(robot, scene, record=record, real_time=False) as service:
        service.observers.append(seen)
        service.run(until_ns=source.end_ns + 500_000_000)
    errors_deg = []
    for cycle in seen.cycles:
        for row, leg in enumerate(robot.legs):
            true_n = source.contact(leg, cycle.forces.t_sent_ns).force_n
            if np.linalg.norm(true_n) > 0.15 and np.isfinite(cycle.forces.force_n[row]).all():
                errors_deg.append(angles_between_deg(cycle.forces.force_n[row], np.array(true_n)))
    return float(np.mean(errors_deg))


def _calibrate(*arguments: str | Path) -> Result:
    return CliRunner().invoke(calibrate, ["--no-reference", *map(str, arguments)])


def test_a_robot_that_stood_knows_its_feet(tmp_path: Path) -> None:
    """Other forces than those of the postures are several times nearer; each foot has a calibration that says so."""
    recording, feet = tmp_path / "standing.mcap", tmp_path / "feet"
    before_deg = _run(_ROBOT, presses(10), recording)
    done = _calibrate(recording, "--calibrations", feet, "--json")
    assert done.exit_code == 0, done.output
    rows = json.loads(done.stdout)
    assert [row["foot"] for row in rows] == ["foot-0007", "foot-0008"]
    assert all(row["n_loads"] >= 8 and row["unknown_deg"] < 1.0 for row in rows)
    calibrated = msgspec.structs.replace(_ROBOT, calibrations=str(feet), tare=TareLimits())
    after_deg = _run(calibrated, presses(8, seed=2))
    assert before_deg > 5.0
    assert after_deg < min(3.0, 0.3 * before_deg)
    manifest = read_calibration(feet / "foot-0007").manifest
    assert (manifest.by_standing, manifest.held_out, manifest.n_sessions) == (True, None, 1)
    about = CliRunner().invoke(info, [str(feet / "foot-0007")]).stdout
    assert "none: of a robot that stood" in about
    assert "without a reference" in (feet / "foot-0007" / "card.md").read_text()
    again = _calibrate(recording, "--calibrations", feet)
    assert "foot-0007: exists and is not overwritten" in str(again.exception)


def test_a_robot_that_did_not_stand_is_told_so(tmp_path: Path) -> None:
    """In one line for each foot, and nothing is written."""
    recording = tmp_path / "short.mcap"
    _run(_ROBOT, presses(3), recording)
    done = _calibrate(recording, "--calibrations", tmp_path / "feet", "--foot", "foot-0008")
    assert re.match(r"foot-0008: [123] different loads at rest; at least 5", str(done.exception))
    assert not (tmp_path / "feet").exists()
    assert "not of foot-0009" in str(_calibrate(recording, "--foot", "foot-0009").exception)
