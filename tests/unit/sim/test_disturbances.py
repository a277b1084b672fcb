"""Disturbances of readings: what a scene names is what the converter's input sees."""

import math
from typing import Any

import numpy as np
import pytest

from footsense.sim.faults import scene_faults as faults
from footsense.sim.faults.disturbances import Disturbances

_STEP_NS, _CONVERSION_NS = 2_550_000, 2_500_000


def added_ff(*each: faults.Disturbance, n: int = 1, row_mask: int = 1, column: int = 0) -> Any:
    """Return what is added to `n` conversions in a row from 1 s on [fF]."""
    disturbances = Disturbances(each, np.random.default_rng(3))
    starts_ns = 1_000_000_000 + _STEP_NS * np.arange(n)
    return 1e3 * np.array(
        [disturbances.added_pf(row_mask, column, int(t), int(t) + _CONVERSION_NS) for t in starts_ns]
    )


def test_white_noise_has_its_deviation_and_common_noise_stays_over_a_scan() -> None:
    own = added_ff(faults.WhiteNoise(at_s=0, noise_ff=20.0), n=20_000)
    common = added_ff(faults.WhiteNoise(at_s=0, noise_ff=20.0, common_rel=0.8), n=20_000)
    assert own.std() == pytest.approx(20.0, rel=0.05)
    assert common.std() == pytest.approx(20.0, rel=0.1)
    assert np.corrcoef(own[:-1], own[1:])[0, 1] == pytest.approx(0.0, abs=0.03)
    assert np.corrcoef(common[:-1], common[1:])[0, 1] == pytest.approx(0.78, abs=0.05)


@pytest.mark.parametrize(("frequency_hz", "rms_share"), [(61.0, 0.962), (400.0, 0.0)])
def test_a_tone_is_averaged_over_each_conversion(frequency_hz: float, rms_share: float) -> None:
    tone = added_ff(faults.Tone(at_s=0, amplitude_ff=20.0, frequency_hz=frequency_hz), n=4000)
    assert tone.std() == pytest.approx(rms_share * 20.0 / math.sqrt(2), abs=0.1)


def test_bursts_and_impulses_come_when_they_are_due() -> None:
    bursts = added_ff(faults.NoiseBursts(at_s=1, noise_ff=10.0, period_s=0.5, active_s=0.1), n=2000)
    phase_s = (_STEP_NS * 1e-9 * np.arange(2000)) % 0.5
    assert np.array_equal(bursts != 0, phase_s < 0.1)
    impulses = added_ff(faults.Impulses(at_s=0, amplitude_ff=-200.0, rate_rel=0.01), n=20_000)
    assert set(impulses) == {0.0, -200.0}
    assert np.mean(impulses != 0) == pytest.approx(0.01, rel=0.2)


def test_shifts_reach_their_lines_alone() -> None:
    shifts = (
        faults.ColumnShift(at_s=0, amplitude_ff=50.0, column=1),
        faults.RowShift(at_s=0, amplitude_ff=7.0, row=2),
        faults.GroundShift(at_s=0, amplitude_ff=1.0),
        faults.GroundShift(at_s=0, until_s=0.5, amplitude_ff=1000.0),
    )
    shifted = [
        [added_ff(*shifts, row_mask=1 << row, column=column).item() for column in range(3)]
        for row in range(3)
    ]
    assert shifted == pytest.approx(np.array([[1, 51, 1], [1, 51, 1], [8, 58, 8]]))


def test_a_leak_grows_unevenly() -> None:
    leak = faults.Leakage(at_s=0, amplitude_ff=40.0, time_constant_s=0.5)
    assert added_ff(leak, column=0).item() == pytest.approx(40.0 * (1 - math.exp(-2.0)))
    assert added_ff(leak, column=2).item() == pytest.approx(0.3 * 40.0 * (1 - math.exp(-2.0)))


def test_metal_beside_the_tail_adds_what_the_table_says_of_each_line() -> None:
    metal_ff = [float(number) for number in range(9)]
    disturbances = Disturbances([faults.MetalBesideTail(at_s=0)], np.random.default_rng(1), metal_ff)
    added = [1e3 * disturbances.added_pf(1 << row, column, 0, 1) for row in range(4) for column in range(3)]
    assert added[:9] == pytest.approx(metal_ff)
    assert added[9:] == [0.0, 0.0, 0.0], "pins beyond the last line"
