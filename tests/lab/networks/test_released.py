"""The committed files: as good as they claim, and honest about where nine closures cannot decide."""

from typing import NamedTuple

import numpy as np
import onnx
import pytest
from numpy.typing import NDArray
from onnx import TensorProto, numpy_helper
from onnx.reference import ReferenceEvaluator

from footsense.estimation.missing_elements import MISSING_SETS, Imputation
from footsense.estimation.network import steady_windows
from footsense.foot.network_card import INPUTS, NETWORK_FILE
from footsense.frames import Vector
from footsense.lab.build import readme
from footsense.lab.evaluation.evaluate_models import (
    PAPER_DIRECTION_DEG,
    PAPER_MAGNITUDE_GF,
    evaluate_models,
    open_models,
    sigma_coverage_shares,
)
from footsense.lab.training.export import OnnxNetwork
from footsense.lab.training.gait_readings import random_gaits
from footsense.lab.training.gait_windows import windows_of
from footsense.lab.training.load_cases import measured_closure_rel, paper_verification, random_loads
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
    filled = imputation.impute(held.closure_rel, mask)
    force_n, sigma_n, *_ = held.network.estimate(steady_windows(filled, missing))
    shares = sigma_coverage_shares(held.force_n, force_n, sigma_n)
    assert min(shares["within_2_sigma"]) > 0.87
    assert max(shares["within_1_sigma"]) < 0.9


@pytest.mark.slow
def test_single_precision_costs_less_than_a_bit_on_can() -> None:
    """Against the same graph in double precision: a twentieth of a bit at rest, a half in random gaits."""
    response, network = open_models(RELEASED)
    model = onnx.load(RELEASED / NETWORK_FILE)
    for stored in model.graph.initializer:
        if stored.data_type == TensorProto.FLOAT:
            stored.CopyFrom(numpy_helper.from_array(numpy_helper.to_array(stored).astype(float), stored.name))
    for node in model.graph.node:
        if node.op_type == "Cast":
            node.attribute[0].i = TensorProto.DOUBLE
    in_double = ReferenceEvaluator(model)
    walked, _ = windows_of(random_gaits(response, 990_100, 10, 1100, FOOT_DESIGN.loads.max_n))
    compared = {
        5e-5: steady_windows(paper_verification(response).closure_um / response.design.gap_um),
        5e-4: walked,
    }
    for limit_n, window in compared.items():
        inputs = {
            signal.name: np.asarray(part, np.float64).reshape(len(part), signal.width)
            for signal, part in zip(INPUTS, window, strict=True)
        }
        apart_n = network.estimate(window).force_n - in_double.run(["force_n"], inputs)[0]
        assert 0.0 < np.abs(apart_n).max() < limit_n


@pytest.mark.slow
def test_the_model_card_is_what_a_build_writes() -> None:
    """All of it but the parity of JAX and ONNX Runtime, which only a build measures."""
    text = (RELEASED / "README.md").read_text(encoding="utf-8")
    parity_mn = float(text.partition("ONNX Runtime: ")[2].partition(" ")[0])
    response, network = open_models(RELEASED)
    table = evaluate_models(RELEASED)
    assert text == readme(FOOT_DESIGN, response, network.card, table, parity_mn / 1000.0, quick=False)
