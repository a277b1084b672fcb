"""Which loads tell how good a calibration is: those of a mounting that the fit did not know."""

from collections import Counter
from pathlib import Path

import pytest

from footsense.calibration.calibrate import calibrate_sessions
from footsense.calibration.recorded_session import RecordedSession
from footsense.errors import CalibrationError
from footsense.sim.loads.press_sequence import paper_presses
from tests.support.test_stand_loads import design, load_set, made

_FORCE_N = 0.3 * paper_presses("training")[::12]


def session(name: str, number: int) -> RecordedSession:
    """Return one of three recordings of a foot, with a third of its loads."""
    return RecordedSession(
        path=Path(f"{number}.mcap"),
        sha256=str(number),
        name=name,
        foot="foot-0007",
        foot_type="aoyagi-3x3",
        test_stand=None,
        temperature_c=None,
        loads=load_set(made(1), _FORCE_N[number::3]),
        dwells_ns=(),
        rejected=Counter(),
        n_lost_cycles=0,
        damage="",
    )


@pytest.mark.parametrize(("names", "kept"), [("abb", 2 / 3), ("aab", 1 / 3), ("aaa", 1 / 5)])
def test_a_mounting_is_kept_whole_however_many_recordings_it_has(names: str, kept: float) -> None:
    """The last of several mountings, or every fifth load of the only one."""
    sessions = [session(name, number) for number, name in enumerate(names)]
    held_out = calibrate_sessions(design(), sessions).held_out
    assert held_out is not None
    n = sum(len(one.loads) for one in sessions)
    assert held_out.calibrated.n == pytest.approx(kept * n, abs=1)


def test_a_session_that_is_not_there_is_no_judge() -> None:
    """Those that are there are named, each once."""
    with pytest.raises(
        CalibrationError, match=r"--hold-out c: has to be one of several sessions, here are a, b$"
    ):
        calibrate_sessions(design(), [session(name, number) for number, name in enumerate("abb")], "c")
