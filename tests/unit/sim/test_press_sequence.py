"""A simulated test stand: presses, viscoelastic rubber, feet as made."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from footsense.errors import ConfigError
from footsense.sim.loads.press_sequence import PressSequence, paper_presses
from footsense.sim.rubber import (
    CREEP_REL,
    CREEP_TIME_S,
    PLAY_OPERATOR_WEIGHTS,
    PLAY_OPERATOR_WIDTHS_N,
    ViscoelasticRubber,
)
from footsense.sim.scene import load_scene

_UP = np.array([0.0, 0.0, 1.0])
_MS = 1_000_000


def test_the_papers_presses_are_its_counts_and_angles() -> None:
    """Section III F: 362 at 50 and 150 gf, 180 at 100 gf, their angles 5 deg beside each other."""
    training, verification = paper_presses("training"), paper_presses("verification")
    sizes_gf = np.linalg.norm(training, axis=1) / 9.80665e-3
    assert (sizes_gf.round(9).tolist().count(50.0), sizes_gf.round(9).tolist().count(150.0)) == (181, 181)
    np.testing.assert_allclose(np.linalg.norm(verification, axis=1), 0.980665)
    elevations_deg = np.degrees(np.arcsin(verification[:, 2] / 0.980665))
    assert sorted(set(elevations_deg.round(6).tolist())) == [45.0, 55.0, 65.0, 75.0, 85.0]


@given(st.integers(0, 5_000))
def test_a_stick_presses_holds_and_lets_go(at_ms: int) -> None:
    """Force and time of each press are as configured, with pauses without load between them."""
    loads = PressSequence(
        [(0.0, 0.0, 1.0), (0.3, 0.0, 0.4)],
        from_ns=1000 * _MS,
        rise_ns=100 * _MS,
        dwell_ns=500 * _MS,
        pause_ns=300 * _MS,
    )
    force_n = np.linalg.norm(loads.contact("lf", at_ms * _MS).force_n)
    number, since_ms = divmod(at_ms - 1000, 1000)
    size_n = (1.0, 0.5)[number] if number in {0, 1} else 0.0
    share = max(0.0, min(since_ms / 100, 1.0, (700 - since_ms) / 100))
    assert force_n == pytest.approx(size_n * share, abs=1e-12)
    assert loads.end_ns == 3000 * _MS


def test_contacts_lean_by_what_was_said() -> None:
    """The angle between normal and force has the stated rms; the force itself does not change."""
    force_n = np.tile([0.3, 0.2, 0.9], (4000, 1))
    loads = PressSequence(force_n, from_ns=0, rise_ns=0, dwell_ns=1, pause_ns=1, lean_deg=2.0, seed=3)
    contacts = [loads.contact("lf", 2 * k) for k in range(len(force_n))]
    cosines = [contact.normal @ contact.force_n / np.linalg.norm(contact.force_n) for contact in contacts]
    assert math.degrees(math.sqrt(np.mean(np.arccos(cosines) ** 2))) == pytest.approx(2.0, rel=0.05)
    assert all((contact.force_n == force_n[0]).all() for contact in contacts)


def test_rubber_creeps_as_its_chain_says_whatever_the_sampling() -> None:
    """A load that stands still grows by c (1 - exp(-t / tau)) in the solid."""
    load_n = 1.0 * _UP
    for step_ns in (1 * _MS, 170 * _MS):
        rubber = ViscoelasticRubber()
        rubber.next_effective_load(0, _UP, load_n)
        for t_ns in range(step_ns, 3400 * _MS + 1, step_ns):
            true_force_n = rubber.next_effective_load(t_ns, _UP, load_n)[1]
        loop_n = PLAY_OPERATOR_WEIGHTS @ PLAY_OPERATOR_WIDTHS_N
        crept = CREEP_REL @ (1.0 - np.exp(-3.4 / CREEP_TIME_S))
        assert true_force_n[2] == pytest.approx(1.0 - loop_n + crept, rel=1e-12)


def test_the_loop_is_as_wide_as_its_plays_and_the_rubber_is_at_rest_at_first() -> None:
    """On the way up and on the way down the plays lie on the two sides of the load; nothing pressed, nothing felt."""
    rubber = ViscoelasticRubber()
    np.testing.assert_array_equal(rubber.next_effective_load(0, _UP, np.zeros(3))[1], np.zeros(3))
    true_force_n = [rubber.next_effective_load(0, _UP, size_n * _UP)[1][2] for size_n in (0.5, 1.0, 0.5)]
    assert true_force_n[2] - true_force_n[0] == pytest.approx(
        2 * PLAY_OPERATOR_WEIGHTS @ PLAY_OPERATOR_WIDTHS_N
    )


def test_a_press_below_the_known_response_is_refused_by_its_number(tmp_path: Path) -> None:
    """One line that names the press."""
    file = tmp_path / "low.yaml"
    file.write_text("description: low\nload: {kind: calibration_loads, presses: [[0, 0, 1], [1, 0, 0.1]]}\n")
    with pytest.raises(ConfigError, match=r"presses\[1\].*elevation of 6 deg"):
        load_scene(str(file))
