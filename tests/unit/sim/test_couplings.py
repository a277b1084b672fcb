"""What a conversion sees beside its element: in the state that a chip holds it."""

from pathlib import Path

import numpy as np
import pytest

from footsense.daemon.foot_types import released_path
from footsense.errors import ConfigError
from footsense.sim.chips.beside import BesideColumns, unloaded_stray_pf
from footsense.sim.chips.chip import LineStates
from footsense.sim.couplings import (
    COUPLINGS_FILE,
    Couplings,
    InputState,
    converted_pf,
    load_couplings,
    potential_of,
)

TABLE = load_couplings(released_path(COUPLINGS_FILE)).boards


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


@pytest.mark.parametrize("board", ["fdc1004", "ad7147"])
def test_the_stray_of_an_unloaded_foot_is_at_least_that_to_ground(board: str) -> None:
    found_pf = unloaded_stray_pf(board, TABLE[board], Couplings(idle_inputs="shield"), 5.387)
    least_pf = TABLE[board].mutual_pf[:, -1][
        TABLE[board].places(
            [f"row{n // 3 + 1}col{n % 3 + 1}" if board == "ad7147" else f"col{n % 3 + 1}" for n in range(9)]
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
