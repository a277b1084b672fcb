"""A press is detected and reduced to a calibration load, or rejected with the reason."""

import itertools
from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from footsense.calibration.detection import LoadDetector
from footsense.calibration.loads import CalibrationLoad, RejectedPress, Rejection
from footsense.frames import Cycle, Reading
from tests.support.feet import DESIGN
from tests.support.presses import (
    CLOSURE_REL,
    SAMPLE_NOISE_N,
    SAMPLE_NS,
    SimulatedPress,
    cycles,
    direction,
    force_profile,
)

Vector = NDArray[np.float64]


def find_presses(cycles: Iterable[Cycle]) -> list[CalibrationLoad | RejectedPress]:
    """Return the result of every press."""
    detector = LoadDetector(0)
    found = [*map(detector.process_cycle, cycles), detector.finish()]
    return [press for press in found if press is not None]


def find_loads(cycles: Iterable[Cycle]) -> list[CalibrationLoad]:
    """Return the loads of presses that are all accepted."""
    presses = find_presses(cycles)
    loads = [press for press in presses if isinstance(press, CalibrationLoad)]
    assert loads == presses
    return loads


def find_rejections(cycles: Iterable[Cycle]) -> list[Rejection]:
    """Return the rejections of presses that are all rejected, each with a reason."""
    presses = find_presses(cycles)
    rejected = [press for press in presses if isinstance(press, RejectedPress) and press.reason]
    assert rejected == presses
    return [press.rejection for press in rejected]


ONE = SimulatedPress(1.5, 1.2, tuple(direction(40.0, 60.0)))


def test_loads_are_what_was_pressed() -> None:
    """Three presses: their force within what averaging leaves of the noise, capacitances and zero to a femtofarad."""
    presses = [
        SimulatedPress(1.5 + 2.5 * k, 1.0, tuple(size_n * direction(70.0 * k, 55.0 + 10 * k)))
        for k, size_n in enumerate((0.5, 1.0, 1.4))
    ]
    loads = find_loads(cycles(force_profile(*presses), 9.5, drift_pf_per_s=0.005))
    assert len(loads) == 3
    for load, press in zip(loads, presses, strict=True):
        error_n = load.force_n - press.force_n
        assert (np.abs(error_n) < 5 * SAMPLE_NOISE_N / np.sqrt(60)).all()
        start_ns, end_ns = load.dwell_ns
        n_samples = (end_ns - start_ns) / SAMPLE_NS
        assert load.sigma_n == pytest.approx(SAMPLE_NOISE_N / np.sqrt(n_samples), rel=0.3)
        held_pf = DESIGN.capacitance_pf(np.array(press.force_n) @ CLOSURE_REL * DESIGN.gap_um)
        assert load.capacitance_pf - load.baseline_pf == pytest.approx(held_pf - DESIGN.unloaded_pf, abs=1e-3)
        assert 0.8e9 < end_ns - start_ns < 1.2e9
        assert abs((start_ns + end_ns) / 2e9 - 1.0 - (press.at_s + 0.2 + press.dwell_s / 2)) < 0.1


@pytest.mark.parametrize(
    ("press", "more", "why"),
    [
        (ONE._replace(dwell_s=0.15), {}, Rejection.TOO_SHORT),
        (ONE._replace(dwell_s=0.05, rise_s=1.2), {}, Rejection.SLIPPED),
        (ONE._replace(force_n=(0.0, 0.0, 0.05)), {}, Rejection.TOO_LIGHT),
        (ONE._replace(dwell_s=9.0), {}, Rejection.NOT_RELEASED),
        (ONE, {"saturated": lambda t_s: t_s > 2.0}, Rejection.REFERENCE_SATURATED),
        (ONE, {"missing": lambda t_s: t_s > 1.8}, Rejection.REFERENCE_MISSING),
        (ONE, {"missing": lambda t_s: t_s < 1.5}, Rejection.REFERENCE_MISSING),
        (ONE, {"missing": lambda t_s: int(t_s * 200) % 5 == 0 and t_s > 1.6}, Rejection.REFERENCE_MISSING),
        (ONE, {"reading": lambda t_s: Reading.OVER_RANGE if t_s > 2.0 else Reading.OK}, Rejection.OVER_RANGE),
        (ONE, {"reading": lambda _: Reading.NO_ANSWER}, Rejection.NOT_READ),
        (ONE, {"reading": lambda t_s: Reading.NO_ANSWER if t_s < 1.49 else Reading.OK}, Rejection.NOT_READ),
        (ONE, {"missing": lambda t_s: not 1.2 <= t_s < 1.204}, Rejection.REFERENCE_MISSING),
        (ONE, {"missing": lambda t_s: not 1.2 <= t_s < 1.208}, Rejection.REFERENCE_MISSING),
    ],
)
def test_what_does_not_count_has_a_reason(
    press: SimulatedPress, more: dict[str, Any], why: Rejection
) -> None:
    """Each defect of a press has a rejection of its own."""
    assert find_rejections(cycles(force_profile(press), 5.5, **more)) == [why]


def test_an_element_that_is_silent_afterwards_leaves_the_rest_before() -> None:
    """Nothing is known of the drift then."""
    (load,) = find_loads(
        cycles(force_profile(ONE), 5.5, reading=lambda t_s: Reading.NO_ANSWER if t_s > 3.1 else Reading.OK)
    )
    assert np.isfinite(load.baseline_pf).all()


def test_what_the_sensor_says_at_its_end_is_no_zero() -> None:
    """Samples of 40 N in the rest, said to be its end, move no force."""

    def reading_n(force_n: Vector) -> Vector:
        return force_n if force_n.any() else force_n + 40.0

    def saturated(t_s: float) -> bool:
        return 0.5 < t_s < 0.9 or t_s > 3.3

    def at_its_end(t_s: float) -> Vector:
        return force_profile(ONE)(t_s) + (1e-9 if not saturated(t_s) else 0.0)

    (load,) = find_loads(cycles(at_its_end, 5.5, reading_n=reading_n, saturated=saturated))
    assert load.force_n == pytest.approx(ONE.force_n, abs=0.03)


def test_a_zero_far_off_makes_no_slip_steady() -> None:
    """What a press may move by is a share of the force, not of where the sensor's zero stands."""
    sample = itertools.count()

    def reading_n(force_n: Vector) -> Vector:
        t_s = next(sample) * SAMPLE_NS * 1e-9
        return force_n * (t_s - 1.0) + 40.0

    assert find_rejections(cycles(force_profile(ONE), 5.5, reading_n=reading_n)) == [Rejection.SLIPPED]


def test_a_zero_that_has_moved_since_an_old_press_does_not_count() -> None:
    """A sensor that drifts by 0.2 N in a minute: the second press has the zero of the seconds before it."""
    late = ONE._replace(at_s=61.5)
    sample = itertools.count()

    def reading_n(force_n: Vector) -> Vector:
        return force_n + 0.2 * (next(sample) * SAMPLE_NS * 1e-9 > 30.0)

    loads = find_loads(cycles(force_profile(ONE, late), 65.5, reading_n=reading_n))
    assert loads[1].force_n == pytest.approx(ONE.force_n, abs=0.02)


def test_an_unloaded_foot_gives_no_load() -> None:
    """A minute of noise and drift presses no press."""
    assert find_loads(cycles(force_profile(), 60.0, drift_pf_per_s=0.01)) == []


def test_pressed_again_at_once_is_two_loads() -> None:
    """The second has the zero of before the first; what the foot did after the first is not known."""
    loads = find_loads(cycles(force_profile(ONE, ONE._replace(at_s=3.2)), 6.0))
    assert len(loads) == 2
    assert loads[1].baseline_pf == pytest.approx(loads[0].baseline_pf, abs=1e-3)


def test_pressed_again_at_once_is_measured_from_the_pause_between() -> None:
    """What the first press left in the rubber is none of the second's load."""
    second = ONE._replace(at_s=ONE.at_s + 2 * ONE.rise_s + ONE.dwell_s + 0.15)
    left_pf = 0.02

    def remembering(cycle: Cycle) -> Cycle:
        remembers = cycle.forces.t_sent_ns * 1e-9 - 1.0 > ONE.at_s + 0.5
        scan = cycle.scan._replace(capacitance_pf=cycle.scan.capacitance_pf + left_pf * remembers)
        return cycle._replace(scan=scan)

    loads = find_loads(map(remembering, cycles(force_profile(ONE, second), 6.0, scan_ns=7_000_000)))
    assert loads[1].baseline_pf == pytest.approx(DESIGN.unloaded_pf + left_pf, abs=2e-3)


def test_a_slow_converter_is_enough() -> None:
    """Ten scans a second find presses that are held for a second."""
    presses = [ONE._replace(at_s=1.5 + 2.0 * k, dwell_s=1.0) for k in range(3)]
    loads = find_loads(cycles(force_profile(*presses), 8.0, scan_ns=99_000_000))
    assert len(loads) == 3
    assert np.array([load.force_n - ONE.force_n for load in loads]) == pytest.approx(
        np.zeros((3, 3)), abs=0.03
    )


def test_presses_in_a_row_each_have_their_own_zero() -> None:
    """With 0.4 s between them, drift is taken off each; the reference's zero is that of all rests before."""
    presses = [ONE._replace(at_s=1.5 + 1.2 * k, dwell_s=0.6, rise_s=0.1) for k in range(8)]
    loads = find_loads(cycles(force_profile(*presses), 12.0, drift_pf_per_s=0.02))
    assert len(loads) == 8
    moved_pf = np.array([load.baseline_pf - loads[0].baseline_pf for load in loads]).mean(axis=1)
    assert moved_pf == pytest.approx(0.02 * 1.2 * np.arange(8), abs=1e-3)
    error_n = np.array([load.force_n - ONE.force_n for load in loads])
    assert np.sqrt((error_n[2:] ** 2).mean(axis=0)) == pytest.approx(np.zeros(3), abs=0.012)
