"""Couplings of a foot's lines: the method against exact formulas, and the tables against the drawn flexes."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ellipk

from footsense.foot.type_folders import released_names
from footsense.frames import Vector
from footsense.lab.couplings.flex_couplings import BOARDS, flex_couplings
from footsense.lab.couplings.moments import EPS0_FF_PER_MM, Strip, mutual_capacitance
from footsense.lab.fabrication.parts.flex import Board, flexes
from footsense.lab.foot_file import load_foot
from footsense.sim.couplings import load_couplings
from tests.lab.released import RELEASED

MODELS = RELEASED.parent

#: Light in vacuum [mm/s], for capacitance from impedance.
LIGHT_MM_PER_S = 299_792_458e3


def coplanar(width_mm: float, gap_mm: float, n_segments: int) -> float:
    """Return the capacitance of two equal coplanar strips [fF/mm]."""
    far = gap_mm / 2.0 + width_mm
    strips = [Strip("a", -far, -gap_mm / 2.0), Strip("b", gap_mm / 2.0, far)]
    _, mutual = mutual_capacitance(strips, n_segments=n_segments)
    return EPS0_FF_PER_MM * float(mutual[0, 1] + mutual[0, 0] / 2.0)


@pytest.mark.parametrize(("width_mm", "gap_mm"), [(0.08, 0.42), (0.2, 0.3), (4.0, 1.0)])
def test_two_coplanar_strips_have_the_exact_capacitance_and_converge_to_it(
    width_mm: float, gap_mm: float
) -> None:
    """eps0 K(k') / K(k) with k = s / (s + 2 w) (conformal map), to 0.5 %; four times nearer with twice the segments."""
    k = gap_mm / (gap_mm + 2.0 * width_mm)
    exact = EPS0_FF_PER_MM * ellipk(1.0 - k * k) / ellipk(k * k)
    off = [coplanar(width_mm, gap_mm, n) / exact - 1.0 for n in (16, 32)]
    assert abs(off[0]) < 5e-3
    assert abs(off[1]) < 0.3 * abs(off[0])


@pytest.mark.parametrize("width_over_height", [1.0, 10.0, 100.0])
def test_a_strip_above_a_plane_has_the_capacitance_with_its_fringe(width_over_height: float) -> None:
    """Of the impedance of a microstrip in air (Hammerstad and Jensen 1980, eq. 1, to 0.01 %)."""
    u = width_over_height
    f = 6.0 + (2.0 * math.pi - 6.0) * math.exp(-((30.666 / u) ** 0.7528))
    ohms = 376.730313668 / (2.0 * math.pi) * math.log(f / u + math.sqrt(1.0 + 4.0 / u**2))
    expected = 1e15 / (ohms * LIGHT_MM_PER_S)
    _, mutual = mutual_capacitance([Strip("a", 0.0, u)], plane_mm=-1.0, n_segments=32)
    assert EPS0_FF_PER_MM * mutual[0, 0] == pytest.approx(expected, rel=2e-3)


def test_capacitances_are_symmetric_and_positive() -> None:
    """Of lines between guards and a plane behind them: energy is positive, and so is every mutual capacitance."""
    strips = [Strip(f"n{k % 5}", 0.5 * k, 0.5 * k + 0.1) for k in range(9)]
    strips.append(Strip("plane", -0.5, 5.0, 0.05))
    _, mutual = mutual_capacitance(strips)
    maxwell = np.diag(mutual.sum(axis=1)) - (mutual - np.diag(mutual.diagonal()))
    np.testing.assert_array_equal(mutual, mutual.T)
    assert (mutual >= -1e-9).all()
    assert np.linalg.eigvalsh(maxwell).min() > 0.0


def matrices(foot_type: str, board: Board) -> tuple[Vector, Vector]:
    """Return the table's capacitances of a foot, and those of a coarser computation of its drawn flexes [fF]."""
    kept = load_couplings(MODELS / foot_type / "couplings.yaml").boards[board]
    drawn = flex_couplings(flexes(load_foot(MODELS / foot_type / "foot.yaml"), board), n_segments=8)
    assert kept.conductors == drawn.conductors
    return tuple(np.vstack([found.mutual_ff, found.metal_ff]) for found in (kept, drawn))  # type: ignore[return-value]


@pytest.mark.slow
def test_the_table_is_that_of_the_drawn_flex() -> None:
    """Board `fdc1004` of the default foot, within the error of the coarser computation."""
    kept_ff, drawn_ff = matrices("aoyagi-3x3", "fdc1004")
    np.testing.assert_allclose(drawn_ff, kept_ff, rtol=0.06, atol=2.0)


@pytest.mark.slow
@pytest.mark.parametrize(("foot_type", "board"), list(zip(released_names()[1:], BOARDS, strict=True)))
def test_every_table_is_that_of_its_drawn_flex(foot_type: str, board: Board) -> None:
    """Each board of one foot: all six would take some minutes."""
    kept_ff, drawn_ff = matrices(foot_type, board)
    np.testing.assert_allclose(drawn_ff, kept_ff, rtol=0.06, atol=2.0)


@pytest.mark.slow
def test_one_guard_net_behind_the_lines_takes_most_of_their_coupling() -> None:
    """Board `ad7147`: the sum of a line's couplings to other lines, against the same copper without the layer."""
    lower, upper = flexes(load_foot(MODELS / "aoyagi-3x3" / "foot.yaml"), "ad7147")
    to_lines = []
    for shield_net in (upper.shield_net, ""):
        found = flex_couplings((lower, replace(upper, shield_net=shield_net)), n_segments=8)
        places = found.places([name for name in found.conductors if name.startswith("row")])
        to_lines.append(found.mutual_pf[np.ix_(places, places)].sum())
    assert to_lines[0] < 0.6 * to_lines[1]


def test_the_layer_of_board_ad7147_lies_behind_bars_and_tail() -> None:
    """Behind every bar between two columns, and from the sheet to the contacts."""
    upper = flexes(load_foot(MODELS / "aoyagi-3x3" / "foot.yaml"), "ad7147")[1]
    lines = {net for net, _ in upper.electrodes}
    assert {pad.net for pad in upper.shield} == {"acshield"} == set(upper.contacts) - lines
    assert {pad.centre_mm[1] for pad in upper.shield} == {-2.5, 2.5, 0.0}
    assert not flexes(upper.design, "fdc1004")[1].shield
