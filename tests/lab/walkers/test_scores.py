"""Scores of a run: what is found, told twice, false and in the air, of a touch and of slides that are known."""

import numpy as np
import pytest

from footsense.frames import GaitEvent, GaitEventKind, State
from footsense.lab.evaluation.walker_runs import WalkerLoads, WalkerOutputs
from footsense.lab.evaluation.walker_scores import HOLDS_BOUNDS, scores

STEP_S, PEAK_N, FRICTION = 5e-3, 10.0, 0.5
TOUCH_S, SLIDE_S = (2.0, 3.0), (2.3, 2.5)


def outputs(*events: tuple[float, GaitEventKind, float]) -> WalkerOutputs:
    """One leg that touches once and slides once; events by the time of their frame [s], with their own time [s]."""
    t_s = np.linspace(0.0, 4.0, round(4.0 / STEP_S), endpoint=False)
    touches, slides = (((t_s >= begin) & (t_s < end))[:, None] for begin, end in (TOUCH_S, SLIDE_S))
    shape = (len(t_s), 1)
    normal = np.tile([0.0, 0.0, 1.0], (*shape, 1))
    ratio = np.where(slides, FRICTION, 0.1)
    force_n = PEAK_N * touches[..., None] * np.stack([ratio, 0.0 * ratio, np.ones(shape)], axis=2)
    slip_m_s = slides[..., None] * np.array([0.1, 0.0, 0.0])
    true = WalkerLoads(t_s, force_n, normal, slip_m_s, force_n, np.zeros(shape), FRICTION)
    return WalkerOutputs(
        t_s=t_s,
        true=true,
        all_loads=true,
        force_n=force_n + 0.01,
        sigma_n=np.full((*shape, 3), 0.02),
        state=np.full(shape, State.VALID, np.uint8),
        contact=touches,
        holds=np.where(slides, 0.02, 0.97),
        events=[
            (round(sent_s / STEP_S), GaitEvent(kind, 0, round(1e9 * at_s), 2e-3))
            for sent_s, kind, at_s in events
        ],
    )


TOUCHDOWN = (2.015, GaitEventKind.TOUCHDOWN, 2.003)
LIFT_OFF = (3.02, GaitEventKind.LIFT_OFF, 3.001)


def test_a_touch_that_is_told_once_is_found() -> None:
    found = scores(outputs(TOUCHDOWN, LIFT_OFF), PEAK_N)
    assert (found["n_touches"], found["n_missed"], found["n_twice"], found["n_in_air"]) == (1, 0, 0, 0)
    assert found["delays_ms"] == pytest.approx([15.0])
    assert found["errors_ms"] == pytest.approx([3.0])
    assert found["sigmas_ms"] == pytest.approx([2.0])
    assert found["lift_off_delays_ms"] == pytest.approx([20.0])
    assert found["within_2_sigma"] == 1.0


@pytest.mark.parametrize(
    ("events", "n_missed", "n_twice", "n_in_air"),
    [
        ((), 1, 0, 0),
        (((2.2, GaitEventKind.TOUCHDOWN, 2.0),), 1, 0, 0),
        ((TOUCHDOWN, (2.4, GaitEventKind.TOUCHDOWN, 2.4)), 0, 1, 0),
        ((TOUCHDOWN, LIFT_OFF, (3.5, GaitEventKind.TOUCHDOWN, 3.5)), 0, 0, 1),
    ],
    ids=["untold", "too late", "twice", "in the air"],
)
def test_what_is_wrong_with_a_touch_is_counted(
    events: tuple[tuple[float, GaitEventKind, float], ...], n_missed: int, n_twice: int, n_in_air: int
) -> None:
    found = scores(outputs(*events), PEAK_N)
    assert (found["n_missed"], found["n_twice"], found["n_in_air"]) == (n_missed, n_twice, n_in_air)


@pytest.mark.parametrize(
    ("told_s", "n_found", "n_false"),
    [((), 0, 0), ((2.35,), 1, 0), ((2.8,), 0, 1), ((2.35, 2.8), 1, 1)],
    ids=["untold", "told", "false", "both"],
)
def test_slides_are_found_by_slips_and_slips_of_feet_that_hold_are_false(
    told_s: tuple[float, ...], n_found: int, n_false: int
) -> None:
    slips = [
        event
        for at_s in told_s
        for event in ((at_s, GaitEventKind.SLIP, at_s), (at_s + 0.1, GaitEventKind.SLIP_END, at_s + 0.1))
    ]
    found = scores(outputs(TOUCHDOWN, *slips), PEAK_N)
    assert (found["n_slides"], found["n_slides_found"]) == (1, n_found)
    assert (found["n_slips"], found["n_false_slips"]) == (len(told_s), n_false)
    assert found["slip_delays_ms"] == pytest.approx([50.0] * n_found)


def test_the_probability_of_holding_is_compared_with_the_share_that_holds() -> None:
    bins = dict(zip(HOLDS_BOUNDS[1:], scores(outputs(TOUCHDOWN), PEAK_N)["holds_bins"], strict=True))
    assert bins.pop(0.05) == [40, 0]
    assert bins.pop(1.0) == [160, 160]
    assert not any(map(any, bins.values()))
