"""`footsense test-stand calibrate` on a simulated stand: what it takes from a recording, and what it refuses."""

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from footsense.cli.test_stand.calibration import calibrate
from footsense.foot.calibration_files import read_calibration
from tests.support.cycles import without_temperatures
from tests.system.simulated_test_stand import record

pytestmark = pytest.mark.slow


def invoke(*arguments: str | Path) -> Result:
    return CliRunner().invoke(calibrate, [*map(str, arguments), "--foot", "foot-0007"])


def test_a_calibration_has_the_temperature_of_its_sessions(tmp_path: Path) -> None:
    """The mean of those told; NaN if one session has none."""
    session = record(tmp_path / "session.mcap", temperature_c=24.25)
    done = invoke(session, "--calibrations", tmp_path)
    assert done.exit_code == 0, done.exception
    calibration = read_calibration(tmp_path / "foot-0007", "aoyagi-3x3")
    assert calibration.calibrated_at_c == pytest.approx(24.25)
    assert "temperature [degC]  24.25" in re.sub("  +", "  ", done.stdout)
    text = " ".join(done.stdout.split())
    (unknown,) = re.findall(
        r"not identified gap \[um\] as designed for elements ([0-8 ]+), no load closes them", text
    )
    told = re.findall(r"element ([0-8]) ", text[text.index("gap [um]") : text.index("gain [1]")])
    assert sorted(unknown.split() + told) == list("012345678")
    untold = without_temperatures(session, tmp_path / "untold.mcap", session="untold")
    done = invoke(session, untold, "--calibrations", tmp_path / "both")
    assert done.exit_code == 0, done.exception
    assert np.isnan(read_calibration(tmp_path / "both" / "foot-0007", "aoyagi-3x3").calibrated_at_c)
