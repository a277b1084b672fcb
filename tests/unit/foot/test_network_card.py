"""The card of a network: format 3, with the daemon's own inputs and outputs, or refused in one line."""

import json
from typing import Any

import numpy as np
import pytest

from footsense.errors import ModelError
from footsense.foot.capacitor import GAP_CLOSED_THRESHOLD_REL
from footsense.foot.network_card import FORMAT, INPUTS, OUTPUTS, read_card
from tests.support.networks import CARD, MOMENTS, card, signals


def refusal(text: str | None) -> str:
    """Return the line with which a card is refused."""
    with pytest.raises(ModelError) as caught:
        read_card(text, "network.onnx")
    line = str(caught.value)
    assert line.startswith("network.onnx: ")
    assert "\n" not in line
    return line


def test_a_card_that_fits_says_what_the_pipeline_needs() -> None:
    """Capacitors, trained range and moments; further entries are of no concern."""
    trained = read_card(card(training={"steps": 1}), "network.onnx").trained_inputs
    assert (trained.design.gap_um, trained.design.film_eps_r) == (20.0, 2.7)
    np.testing.assert_array_equal(trained.closure_rel_min, np.full(9, -0.05))
    np.testing.assert_array_equal(trained.moments, MOMENTS)
    gap_um = np.array([10.0, 20.0, 40.0])
    np.testing.assert_allclose(
        trained.gap_closed_threshold_over_design_gap(gap_um),
        GAP_CLOSED_THRESHOLD_REL * np.array([0.5, 1.0, 2.0]),
    )
    assert trained.max_usable_closure_rel(np.full(9, 40.0)).tolist() == [0.8] * 9


def test_the_window_is_three_readings_of_nine_elements() -> None:
    """What crosses the interface, in its order and its units: a change needs another format."""
    assert [(signal.name, signal.width, signal.unit) for signal in INPUTS] == [
        ("closure_rel", 27, "1"),
        ("age_s", 27, "s"),
        ("missing", 9, "1"),
    ]
    assert [(signal.name, signal.width, signal.unit) for signal in OUTPUTS] == [
        ("force_n", 3, "N"),
        ("sigma_n", 3, "N"),
        ("contact", 4, "1"),
        ("contact_sigma", 4, "1"),
    ]
    assert FORMAT == 3


@pytest.mark.parametrize("former", [1, 2, 4])
def test_another_format_is_named(former: int) -> None:
    """Before anything else of it is read: an older card has other entries."""
    assert refusal(json.dumps({"format": former, "input": {"name": "closure_rel"}})) == (
        f"network.onnx: card format {former}, this version reads format 3"
    )


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"inputs": CARD["inputs"][::-1]}, "its inputs are missing, age_s, closure_rel; the daemon needs"),
        ({"inputs": []}, "its inputs are none; the daemon needs closure_rel, age_s, missing"),
        ({"outputs": signals("outputs", 2, name="normal")}, "its outputs are force_n, sigma_n, normal, contact_sigma"),
        ({"inputs": signals("inputs", 0, width=45)}, "has closure_rel of width 45 in '1'"),
        ({"inputs": signals("inputs", 1, unit="ms")}, "has age_s of width 27 in 'ms'"),
        ({"outputs": signals("outputs", 0, order="z y x")}, "'z y x', the daemon needs force_n of width 3 in 'N'"),
        ({"outputs": signals("outputs", 3, order="")}, "has contact_sigma of width 4 in '1', '', the daemon needs"),
        ({"closure_rel_max": [0.8] * 3 + [-0.05] + [0.8] * 5}, "element 3 is trained from closure -0.05 to -0.05"),
        ({"gap_um": 0.0}, "the card does not fit: Expected `float` > 0.0 - at `$.gap_um`"),
        ({"scan": "rows"}, "the card does not fit: Invalid enum value 'rows' - at `$.scan`"),
        ({"moments": np.triu(MOMENTS).tolist()}, "moments have to be a symmetric, positive definite matrix"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused_with_what_is_needed(changes: dict[str, Any], says: str) -> None:
    """Inputs and outputs by name, width, unit and order; range; moments."""
    assert says in refusal(card(**changes))


def test_no_card_is_no_network_of_ours() -> None:
    """The command that makes one is named."""
    assert "a network made by `footsense lab build` has one" in refusal(None)
