"""The window of a tare: what counts, what is left out, and what it says when it refuses."""

import numpy as np
import pytest

import footsense
from footsense.estimation.settings import MountedFeet, TareLimits
from footsense.estimation.tare import TareResult, Tares, TareWindow
from footsense.frames import CapFrame, CommandResult, Reading, Result
from tests.support.feet import DESIGN

UNLOADED_PF = np.full(9, 5.4)
LIMITS = TareLimits(window_scans=4, noise_limit_ff=5.0, unloaded_limit_rel=0.03)
NONE = np.zeros(9, bool)
OK = np.zeros(9, np.uint8)
SCAN_NS = 25_000_000


def tare(readings_pf: np.ndarray, missing: np.ndarray = NONE, foot: str = "") -> TareResult | None:
    """Return the tared over scans of these readings, shape (9,), one after the other."""
    window = TareWindow(LIMITS, UNLOADED_PF, SCAN_NS, foot)
    for number in range(LIMITS.window_scans):
        tared = window.add(readings_pf, OK, np.full(9, 1 + number), missing, 1 + number)
    return tared


def test_another_foot_is_refused_by_name() -> None:
    """A calibrated foot has unloaded readings of its own; the message names the foot instead of unloaded_pf."""
    tared = tare(UNLOADED_PF * np.linspace(0.88, 1.1, 9), foot="foot-0008")
    assert tared is not None
    assert (tared.result, tared.baseline_pf) == (Result.LOADED, None)
    assert tared.reason == (
        "the foot is not unloaded, or another than foot-0008: element 0 reads 4.752 pF, -12.0% from the 5.400 pF "
        "expected of foot-0008, at most 3.0% is allowed"
    )


@pytest.mark.parametrize(("foot_type", "standing_n"), [("hexapod-2kg", 3.3), ("quadruped-12kg", 29.4)])
def test_a_foot_on_which_its_robot_stands_is_loaded(foot_type: str, standing_n: float) -> None:
    """On all its feet, each of which carries little of its range: no element reads 3 % more, but all read 2.4 %."""
    foot = footsense.Foot(foot_type)
    free_pf, standing_pf = foot.capacitance_pf(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, standing_n]]))
    assert np.abs(standing_pf / free_pf - 1.0).max() < LIMITS.unloaded_limit_rel
    tared = tare(UNLOADED_PF * standing_pf / free_pf)
    assert tared is not None
    assert (tared.result, tared.baseline_pf) == (Result.LOADED, None)
    assert tared.reason == (
        "the foot is not unloaded: its elements read +2.4% on average from what is expected of the free foot "
        "(unloaded_pf), at most +1.0% is allowed"
    )


def test_an_open_element_is_called_open_and_not_loaded() -> None:
    """No load makes a capacitance smaller by half."""
    readings_pf = UNLOADED_PF.copy()
    readings_pf[[1, 5]] = 0.3
    tared = tare(readings_pf)
    assert tared is not None
    assert tared.result is Result.ELEMENT_FAULT
    assert tared.reason.startswith("an element is open: element 1 reads 0.300 pF, -94.4% from the 5.400 pF")


def test_a_frame_counts_once_every_element_has_been_read_anew() -> None:
    """Conversion by conversion it takes nine frames for one; what settles or was never read does not count."""
    window = TareWindow(LIMITS, UNLOADED_PF, SCAN_NS)
    assert window.add(UNLOADED_PF, OK, np.zeros(9, np.int64), NONE, 1) is None
    assert window.add(np.full(9, np.nan), OK, np.full(9, 1), NONE, 1) is None
    stamps = np.zeros(9, np.int64)
    frames = 0
    tared = None
    while tared is None:
        stamps[frames % 9] = frames + 1
        frames += 1
        tared = window.add(UNLOADED_PF, OK, stamps.copy(), NONE, 1 + frames)
    assert (tared.result, frames) == (Result.DONE, 4 * 9)


class Untared:
    """A leg without a baseline, by what its elements read more than those of the free foot [fF], scan by scan."""

    def __init__(self, scan_ms: float) -> None:
        self.scan_ns, self.n = round(1e6 * scan_ms), 0
        self.tares = Tares(TareLimits(), MountedFeet.of(DESIGN, [None], reading_pf=UNLOADED_PF), self.scan_ns)
        self.results: list[CommandResult] = []
        self.baseline_pf: np.ndarray | None = None

    def read(self, *more_ff: float) -> None:
        for each_ff in more_ff:
            if self.baseline_pf is None:
                self.n += 1
                pf, t_ns = UNLOADED_PF[None] + 1e-3 * each_ff, np.full((1, 9), self.n * self.scan_ns)
                frame = CapFrame(self.n, t_ns, pf, OK[None])
                tared_pf, results = self.tares.add(frame, NONE[None], self.n * self.scan_ns, lambda leg: None)
                self.baseline_pf = tared_pf.get(0)
                self.results += results


@pytest.mark.parametrize(
    ("scan_ms", "swing_scans", "tared_over"),
    [(24.0, 5, 4), (24.0, 4, 4), (24.0, 3, None), (6.75, 9, 8), (6.75, 7, None)],
)
def test_a_foot_that_walks_is_tared_in_its_first_swing_that_is_long_enough(
    scan_ms: float, swing_scans: int, tared_over: int | None
) -> None:
    """A tenth of a second, or the window of a tare if that takes less; wherever the swing begins within a window."""
    for stance_scans in range(9, 18):
        leg = Untared(scan_ms)
        pressed_ff = 150.0 * np.sin(np.linspace(0.0, np.pi, stance_scans + 2)[1:-1])
        for _ in range(3):
            leg.read(*pressed_ff, *[0.0] * swing_scans)
        if tared_over is None:
            assert leg.baseline_pf is None
        else:
            assert leg.n <= stance_scans + swing_scans
            assert leg.baseline_pf == pytest.approx(UNLOADED_PF)
            assert leg.results[-1].reason.startswith(f"tared over {tared_over} scans")


@pytest.mark.parametrize("phase", range(4))
def test_a_load_that_goes_slowly_is_not_taken_for_a_free_foot(phase: int) -> None:
    """100 fF/s, by which four scans of 24 ms vary by less than the noise that a whole window may have."""
    leg = Untared(24.0)
    leg.read(*[200.0] * (10 + phase), *np.arange(150.0, 0.0, -2.4), *[0.0] * 20)
    assert leg.baseline_pf == pytest.approx(UNLOADED_PF, abs=3e-3)


def test_a_foot_that_is_loaded_and_moves_now_and_then_is_told_once() -> None:
    """Not with each of its windows; a command is answered all the same, by readings after it."""
    leg = Untared(6.75)
    for _ in range(20):
        leg.read(*[200.0] * 12, *np.linspace(200.0, 300.0, 12))
    told = [result.result for result in leg.results]
    assert told in ([Result.LOADED], [Result.NOT_QUIET, Result.LOADED])
    leg.tares.command(0)
    leg.read(*[200.0] * 7)
    assert len(leg.results) == len(told)
    leg.read(200.0)
    assert [result.result for result in leg.results[len(told) :]] == [Result.LOADED]


def test_a_reading_that_fails_ends_it() -> None:
    """ABSENT if nothing answers, ELEMENT_FAULT with the names if single readings are none, unless they are missing."""
    for code, expected in ((Reading.NO_ANSWER, Result.ABSENT), (Reading.NOT_READY, Result.ELEMENT_FAULT)):
        reading = OK.copy()
        reading[[2, 3]] = code
        tared = TareWindow(LIMITS, UNLOADED_PF, SCAN_NS).add(
            UNLOADED_PF, reading, np.ones(9, np.int64), NONE, 1
        )
        assert tared is not None
        assert tared.result is expected
        reason = tared.reason
    assert reason == "elements 2, 3 give no reading"
    assert (
        TareWindow(LIMITS, UNLOADED_PF, SCAN_NS).add(
            UNLOADED_PF, reading, np.ones(9, np.int64), reading != 0, 1
        )
        is None
    )
