"""Windows of a foot as the scans of several boards read it."""

import numpy as np
import pytest

from footsense.foot.response_table import FootResponse
from footsense.lab.board_comparison.windows import BoardScan, JudgedWindows, judged_windows
from tests.lab.released import FOOT_DESIGN, RELEASED

pytestmark = pytest.mark.lab

SMALL = BoardScan(2.75e-3, 3.2e-3, noise_pf=0.9e-3, range_end_pf=16.0)
FAST = SMALL._replace(step_s=0.77e-3)


def windows_at(scan: BoardScan) -> dict[str, JudgedWindows]:
    return judged_windows(
        FootResponse.load(RELEASED / "response.npz"), FOOT_DESIGN.loads, scan, 1, n_rests=200, n_gaits=1
    )


@pytest.mark.slow
@pytest.mark.parametrize("scan", [SMALL, FAST], ids=["small", "fast"])
def test_readings_are_as_old_as_the_scan_makes_them(scan: BoardScan) -> None:
    """Newest, oldest of the newest, and the mean over the elements; a walk's jitter aside, as at rest."""
    tests = windows_at(scan)
    for name in ("rest", "walk"):
        age_s = tests[name].window.age_s
        assert age_s[:, 0].min(axis=1).mean() == pytest.approx(scan.send_delay_s, rel=0.01)
        assert age_s[:, 0].mean() == pytest.approx(scan.mean_age_s, rel=0.01)
        assert np.ptp(age_s, axis=(1, 2)).mean() == pytest.approx((3 * 9 - 1) * scan.step_s)


def test_a_shorter_range_takes_forces_away() -> None:
    """The heaviest ones."""
    whole, short = windows_at(SMALL), windows_at(SMALL._replace(range_end_pf=8.0))
    assert whole["rest"].without_force_rel == whole["walk"].without_force_rel == 0.0
    assert 0.02 < short["rest"].without_force_rel < 0.9
    heaviest_n = [np.linalg.norm(one["rest"].force_n, axis=1).max() for one in (whole, short)]
    assert heaviest_n[0] > heaviest_n[1]
