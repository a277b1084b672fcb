"""What a conversion sees beside its element: in the state that a chip holds it, and what another chip excites."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from footsense.daemon.foot_types import released_path
from footsense.errors import ConfigError
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Specimen
from footsense.sim.chips.beside import BesideColumns, BesideElements, unloaded_stray_pf
from footsense.sim.chips.chip import LineStates
from footsense.sim.chips.electronics import leg_electronics
from footsense.sim.chips.excitation import Excitation
from footsense.sim.chips.fdc1004 import SimulatedFdc1004
from footsense.sim.couplings import (
    COUPLINGS_FILE,
    Couplings,
    InputState,
    converted_pf,
    load_couplings,
    mean_product,
    potential_of,
)
from footsense.sim.faults.damage import WiredFoot
from footsense.sim.scene import Effects

#: Excitation [Hz], and duration of a conversion at 400 a second [s].
EXCITATION_HZ, CONVERSION_S = 25e3, 2.5e-3
TABLE = load_couplings(released_path(COUPLINGS_FILE)).boards


def square_product(phase: float, difference_rel: float) -> float:
    """Return the mean of the product of two square waves over a conversion, sample by sample."""
    t_s = (np.arange(200_000) + 0.5) / 200_000 * CONVERSION_S
    one = np.sign(np.sin(2.0 * np.pi * EXCITATION_HZ * t_s))
    other = np.sign(np.sin(2.0 * np.pi * EXCITATION_HZ * (1.0 + difference_rel) * t_s + phase))
    return float((one * other).mean())


@pytest.mark.parametrize("difference_rel", [0.0, 0.0005, 0.002, 0.01, -0.02])
def test_the_mean_product_of_two_clocks_is_that_of_their_square_waves(difference_rel: float) -> None:
    for phase in (-3.0, -0.4, 0.0, 1.0, 5.0):
        found = mean_product(phase, difference_rel * EXCITATION_HZ, CONVERSION_S)
        assert found == pytest.approx(square_product(phase, difference_rel), abs=0.01)


@pytest.mark.parametrize(("difference_rel", "rms"), [(0.002, 0.57), (0.01, 0.26), (0.02, 0.10)])
def test_what_an_unsynchronised_chip_adds_falls_with_the_difference_of_the_clocks(
    difference_rel: float, rms: float
) -> None:
    phases = np.linspace(0.0, 2.0 * np.pi, 1000, endpoint=False).tolist()
    found = [mean_product(phase, difference_rel * EXCITATION_HZ, CONVERSION_S) for phase in phases]
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(rms, abs=0.01)


def test_two_conversions_correlate_while_they_overlap() -> None:
    own = Excitation(0, 2_500_000, 0, EXCITATION_HZ, 0.0)
    assert own.correlation(own) == pytest.approx(1.0)
    assert own.correlation(own._replace(phase=np.pi)) == pytest.approx(-1.0)
    assert own.correlation(own._replace(start_ns=1_250_000, end_ns=9_000_000, phase=-0.5)) == pytest.approx(
        0.5 * mean_product(-0.5 - 2.0 * np.pi * EXCITATION_HZ * 1.25e-3, 0.0, 1.0)
    )
    assert own.correlation(own._replace(start_ns=2_500_000, end_ns=9_000_000)) == 0.0


@pytest.mark.parametrize(
    ("state", "found_ff"),
    # Floating, the neighbour is in series with its own 3 pF to ground; the line has 100 fF to ground beside it.
    [("ground", 400.0), ("shield", 103.0), ("floating", 100.0 + 1.0 / (1.0 / 300.0 + 1.0 / 3000.0))],
)
def test_an_idle_input_counts_as_its_chip_holds_it(state: InputState, found_ff: float) -> None:
    """At ground, at the bias of an AD7147 or the shield to 1 %, and floating."""
    mutual_pf = np.array([[0.0, 0.3, 0.1], [0.3, 0.0, 3.0], [0.1, 3.0, 0.0]])
    potential = np.array([1.0, potential_of(state, 0.01), 0.0])
    assert 1e3 * converted_pf(mutual_pf, 0, potential) == pytest.approx(found_ff)


def test_unselected_rows_count_by_the_error_of_the_shield() -> None:
    """Board `fdc1004`: 1 % of an element of another row, and of its changes; none of one in another column."""
    columns = BesideColumns(TABLE["fdc1004"], "ground", 0.01)
    rows = LineStates(0, 0b001, 0b110)
    rest_pf = columns.added_pf(0, [5.0] * 9, rows)
    changes = {3: 1.0, 6: 1.0, 0: 0.0, 4: 0.0, 1: 0.0}
    for element, share in changes.items():
        pressed_pf = [5.0 + (number == element) for number in range(9)]
        assert columns.added_pf(0, pressed_pf, rows) - rest_pf == pytest.approx(0.01 * share, abs=1e-12)
    exact = BesideColumns(TABLE["fdc1004"], "ground", 0.0)
    assert rest_pf - exact.added_pf(0, [5.0] * 9, rows) > 0.1


def test_a_converter_that_converts_beside_another_adds_what_its_lines_couple() -> None:
    """Board `fdc1004_columns`: between nothing, as at the shield, and twice what they are at ground."""
    elements = BesideElements(TABLE["fdc1004_columns"], "ground", 0.0)
    names = list(TABLE["fdc1004_columns"].conductors)
    line, excited = names.index("row2col1"), [names.index("row2col2"), names.index("shld2")]
    coupled_pf = TABLE["fdc1004_columns"].mutual_pf[line, excited].sum()
    at_rest_pf = elements.overlapped_pf(1, 0, [5.0] * 9)
    for mean in (1.0, 0.3, -1.0):
        beside_pf = elements.overlapped_pf(1, 0, [5.0] * 9, [(1, 1, mean)])
        assert beside_pf - at_rest_pf == pytest.approx(-mean * coupled_pf)


def test_without_couplings_nothing_is_noted_of_excitations() -> None:
    """A scene that asks for none computes none; one that does has a source of phases for each converter."""
    foot = WiredFoot(lambda _: [5.0] * 9, (), Specimen(FootResponse.load(released_path("response.npz"))))
    for effects, notes in ((Effects(), False), (Effects(couplings=Couplings()), True)):
        chips: Any = leg_electronics(
            "fdc1004_columns", foot, effects, (1, 0), TABLE["fdc1004_columns"]
        ).converters
        assert all(isinstance(chip, SimulatedFdc1004) for chip in chips)
        assert [chip.excitations is not None for chip in chips] == [notes] * 3


@pytest.mark.parametrize("board", ["fdc1004", "fdc1004_columns"])
def test_the_stray_of_an_unloaded_foot_is_at_least_that_to_ground(board: str) -> None:
    found_pf = unloaded_stray_pf(board, TABLE[board], Couplings(idle_inputs="shield"), 5.387)
    least_pf = TABLE[board].mutual_pf[:, -1][
        TABLE[board].places(
            [
                f"row{n // 3 + 1}col{n % 3 + 1}" if board == "fdc1004_columns" else f"col{n % 3 + 1}"
                for n in range(9)
            ]
        )
    ]
    assert (np.array(found_pf) > least_pf).all()
    assert max(found_pf) < 1.5


def test_a_table_that_is_none_is_refused_in_one_line(tmp_path: Path) -> None:
    """An asymmetric one, and one whose rows are too short."""
    file = tmp_path / "couplings.yaml"
    for mutual, said in (
        ("[[0.0, 1.0], [2.0, 0.0]]", "has to be symmetric"),
        ("[[0.0, 1.0]]", "needs 2 capacitances"),
        ("[[0.0, -1.0], [-1.0, 0.0]]", "at least 0"),
    ):
        file.write_text(
            "foot_type: f\nboards:\n  fdc1004:\n    conductors: [col1, gnd]\n"
            f"    mutual_ff: {mutual}\n    metal_ff: [1.0, 0.0]\n"
        )
        with pytest.raises(ConfigError, match=said) as error:
            load_couplings(file)
        assert "\n" not in str(error.value)
