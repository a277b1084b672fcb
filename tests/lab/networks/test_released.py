"""The committed files: as good as they claim, and honest about where nine closures cannot decide."""

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from footsense.estimation.missing_elements import MISSING_SETS, Imputation
from footsense.estimation.network import steady_windows
from footsense.foot.specimen import Specimen
from footsense.frames import Vector
from footsense.lab.evaluation.cramer_rao import ambiguous_load_distance_and_angle
from footsense.lab.evaluation.evaluate_models import (
    PAPER_DIRECTION_DEG,
    PAPER_MAGNITUDE_GF,
    evaluate_models,
    open_models,
    sigma_coverage_shares,
)
from footsense.lab.model_card import readme
from footsense.lab.training.export import OnnxNetwork
from footsense.lab.training.load_cases import measured_closure_rel, random_loads
from tests.lab.released import FOOT_DESIGN, RELEASED

pytestmark = pytest.mark.lab


@pytest.mark.slow
def test_the_release_is_ten_times_better_than_the_paper() -> None:
    """On the paper's own 180 cases, with at most 120,000 weights; the card's errors are those of the file."""
    _, network = open_models(RELEASED)
    table = evaluate_models(RELEASED)
    row = table["paper_network"]
    assert row.direction_deg < 0.1 * PAPER_DIRECTION_DEG
    assert row.magnitude_gf < 0.1 * PAPER_MAGNITUDE_GF
    assert network.card["training"]["weights"] <= 120_000
    assert network.card["errors"]["paper_network"]["direction_deg"] == pytest.approx(
        row.direction_deg, rel=0.01
    )
    # The gap closure reads out linearly with less than half the error of the capacitance change.
    dc, elastance = table["paper_linear_dc"], table["paper_linear_elastance"]
    assert elastance.direction_deg < 0.5 * dc.direction_deg
    assert elastance.magnitude_gf < 0.5 * dc.magnitude_gf


class Held(NamedTuple):
    """Held-out loads of the released foot as its converter reads them, and its network."""

    force_n: Vector
    closure_rel: Vector
    network: OnnxNetwork


@pytest.fixture(scope="module")
def held() -> Held:
    response, network = open_models(RELEASED)
    cases = random_loads(response, FOOT_DESIGN.loads, 3000, 11)
    measured = measured_closure_rel(response.design, cases.closure_um, np.random.default_rng(11))
    return Held(cases.force_n, measured, network)


@pytest.mark.parametrize(
    "mask", MISSING_SETS, ids=lambda mask: "".join(str(e) for e in np.flatnonzero(mask)) or "none"
)
def test_sigma_is_honest_whatever_is_missing(held: Held, mask: NDArray[np.bool_]) -> None:
    """Held-out loads with the converter's noise: nine errors in ten are within two sigma, and sigma is not idle."""
    missing = np.broadcast_to(mask, held.closure_rel.shape)
    imputation = Imputation(np.array(held.network.card["moments"]))
    filled = imputation.impute(held.closure_rel, missing)
    force_n, sigma_n, *_ = held.network.estimate(steady_windows(filled, missing))
    shares = sigma_coverage_shares(held.force_n, force_n, sigma_n)
    assert min(shares["within_2_sigma"]) > 0.87
    assert max(shares["within_1_sigma"]) < 0.9


def test_light_loads_have_a_twin_and_heavy_ones_none() -> None:
    """A limit of the sensor: forces 80 deg apart that nine noisy closures of 20 gf cannot tell, and of 100 gf can."""
    response, _ = open_models(RELEASED)
    apart = {}
    for magnitude_gf in (20.0, 100.0):
        sigmas, angle_deg = ambiguous_load_distance_and_angle(
            Specimen(response), magnitude_gf, np.arange(43.0, 46.0, 0.5)
        )
        assert angle_deg.min() > 60.0
        apart[magnitude_gf] = sigmas.min()
    assert apart[20.0] < 2.0
    assert apart[100.0] > 10.0


@pytest.mark.slow
def test_the_model_card_is_what_a_build_writes() -> None:
    """All of it but the parity of JAX and ONNX Runtime, which only a build measures."""
    text = (RELEASED / "README.md").read_text(encoding="utf-8")
    parity_mn = float(text.partition("ONNX Runtime: ")[2].partition(" ")[0])
    response, network = open_models(RELEASED)
    table = evaluate_models(RELEASED)
    assert text == readme(FOOT_DESIGN, response, network.card, table, parity_mn / 1000.0, quick=False)
