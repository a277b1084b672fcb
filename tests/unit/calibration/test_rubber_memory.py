"""Unloaded readings of rubber that remembers the last presses: cleaned of that, and of nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from footsense.calibration.rubber_memory import correct_baselines_for_creep
from footsense.foot.directions import normalized
from footsense.foot.specimen import Foot
from footsense.sim.loads.press_sequence import paper_presses
from tests.support.test_stand_loads import design, load_set, made

_DRIFT_PF = 0.01


@pytest.mark.parametrize("every", [3, 18])
def test_what_the_rubber_remembers_is_taken_off_and_drift_is_left(every: int) -> None:
    """Play stays in the direction of the press before, creep in that of the last presses; 21 presses tell both."""
    own, force_n = made(1), paper_presses("training")[::every]
    loads = load_set(own, force_n, np.random.default_rng(1))
    mean_n, staying_n = np.zeros(3), [np.zeros(3)]
    for one_n in force_n[:-1]:
        mean_n = 0.9 * mean_n + 0.1 * one_n
        staying_n.append(0.01 * one_n / np.linalg.norm(one_n) + 0.015 * mean_n)
    contacts = normalized(np.concatenate([force_n[:1], force_n[:-1]]))
    rested_pf = loads.baseline_pf + np.linspace(0.0, _DRIFT_PF, len(loads))[:, None]
    remembering_pf = Foot(design().response, own).capacitance_pf(contacts, np.array(staying_n))
    read_pf = rested_pf + remembering_pf - loads.baseline_pf
    found_pf = correct_baselines_for_creep(design().response, replace(loads, baseline_pf=read_pf)).baseline_pf
    assert np.abs(read_pf - rested_pf).mean() > 0.02
    assert abs((found_pf - rested_pf).mean()) < 0.004
    assert (found_pf - rested_pf).std() < 0.01


def test_an_elastic_foot_is_left_as_it_is() -> None:
    """Noise of the readings is no memory."""
    rng = np.random.default_rng(2)
    loads = load_set(made(2), paper_presses("training")[::12], rng)
    noisy_pf = loads.baseline_pf + 0.0002 * rng.normal(size=loads.baseline_pf.shape)
    found_pf = correct_baselines_for_creep(
        design().response, replace(loads, baseline_pf=noisy_pf)
    ).baseline_pf
    np.testing.assert_allclose(found_pf, noisy_pf, atol=0.001)
