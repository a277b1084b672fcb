"""Load cases, training, export and the whole chain on the coarse foot."""

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import onnx
import pytest
from click.testing import CliRunner

from footsense.cli.lab import lab
from footsense.errors import FootsenseError, ModelError
from footsense.inference.card import METADATA_KEY
from footsense.lab import dataset
from footsense.lab.build import PARITY_N, QUICK, Built, build
from footsense.lab.compare import compare
from footsense.lab.evaluate import errors, sigma_model
from footsense.lab.evaluate_models import open_models
from footsense.lab.export import OnnxNetwork
from footsense.lab.response import SYMMETRIES, element_map
from footsense.sim.foot import FootResponse

pytestmark = pytest.mark.lab


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return where the quick build goes."""
    return tmp_path_factory.mktemp("models")


@pytest.fixture(scope="module")
def built(folder: Path) -> Built:
    """Run the whole chain once."""
    return build(folder, QUICK, lambda _: None)


def test_the_papers_sets_have_the_papers_sizes(response: FootResponse) -> None:
    """362 training and 180 verification cases, elevations from 40 deg, forces 50, 150 and 100 gf."""
    training, verification = dataset.paper_training(response), dataset.paper_verification(response)
    assert (len(training.force_n), len(verification.force_n)) == (362, 180)
    size_gf = np.linalg.norm(training.force_n, axis=1) / dataset.GRAM_FORCE_N
    np.testing.assert_allclose(np.unique(size_gf.round(9)), [50.0, 150.0])
    elevation = np.degrees(np.arcsin(training.force_n[:, 2] / (size_gf * dataset.GRAM_FORCE_N)))
    assert elevation.min() == pytest.approx(40.0)
    apart = training.force_n[:181, None] / 50.0 - verification.force_n[None] / 100.0
    assert np.linalg.norm(apart, axis=2).min() > 0.03 * dataset.GRAM_FORCE_N


def test_symmetric_copies_are_loads_of_the_same_foot(response: FootResponse) -> None:
    """Each copy of (force, closures) is what the foot does under the copied force, to the table's rounding."""
    force = dataset.wide(response, 1, 7).force_n
    normal = force / np.linalg.norm(force)
    copies = dataset.Cases(force, response.closure_um(normal, force)).with_symmetric_copies()
    assert len(np.unique(copies.force_n.round(6), axis=0)) == 8
    again = response.closure_um(copies.force_n / np.linalg.norm(force), copies.force_n)
    np.testing.assert_allclose(again, copies.closure_um, atol=1e-4)


def test_element_map_turns_the_array() -> None:
    """Mirroring left and right swaps columns 0 and 2; every map is a permutation."""
    mirror = np.diag([1.0, -1.0, 1.0])
    assert element_map(mirror).tolist() == [2, 1, 0, 5, 4, 3, 8, 7, 6]
    assert all(sorted(element_map(g)) == list(range(9)) for g in SYMMETRIES)


def test_the_wide_set_stays_inside_its_promise(response: FootResponse) -> None:
    """Open gaps, at most 2 N, light touches present, the same for the same seed."""
    cases = dataset.wide(response, 2000, 5)
    size = np.linalg.norm(cases.force_n, axis=1)
    assert size.max() <= dataset.WIDE_MAX_N
    assert np.mean(size < 0.05) > 0.05
    assert cases.closure_um.max() < response.design.gap_um
    assert (dataset.wide(response, 2000, 5).force_n == cases.force_n).all()


def test_errors_are_those_of_hand_computation() -> None:
    """A right angle is 90 deg, a 10 % longer estimate of 1 N is 10.197 gf off."""
    truth = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    row = errors(truth, np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.1]]))
    assert row.direction_deg == pytest.approx(45.0)
    assert row.magnitude_gf == pytest.approx(0.1 / dataset.GRAM_FORCE_N / 2.0)


def test_sigma_model_finds_what_it_was_given() -> None:
    """Errors drawn with sigma = 3 mN + 2 % of |f| are read back."""
    rng = np.random.default_rng(3)
    truth = np.zeros((40_000, 3))
    truth[:, 2] = rng.uniform(0.0, 2.0, 40_000)
    sigma = 0.003 + 0.02 * truth[:, 2:]
    floor, rel = sigma_model(truth, truth + sigma * rng.normal(size=(40_000, 3)))
    np.testing.assert_allclose(floor, 0.003, atol=5e-4)
    np.testing.assert_allclose(rel, 0.02, rtol=0.03)


def test_the_chain_beats_the_paper_even_when_quick(built: Built) -> None:
    """A coarse mesh and a short training still estimate better than 2.4 deg and 5.3 gf."""
    row = built.table["paper_network"]
    assert row.direction_deg < 2.4
    assert row.magnitude_gf < 5.3
    assert built.parity_n < PARITY_N


def test_elastance_is_the_better_linear_input(built: Built) -> None:
    """The gap closure reads out linearly with less than half the error of the capacitance change."""
    dc, elastance = built.table["paper_linear_dc"], built.table["paper_linear_elastance"]
    assert elastance.direction_deg < 0.5 * dc.direction_deg
    assert elastance.magnitude_gf < 0.5 * dc.magnitude_gf


def test_the_card_says_what_the_daemon_needs(built: Built, folder: Path) -> None:
    """Key by key, and the file is of the fixed, old format with a free batch size."""
    model = onnx.load(folder / "network.onnx")
    (prop,) = model.metadata_props
    card = json.loads(prop.value)
    assert prop.key == METADATA_KEY
    assert card == built.card
    assert (card["format"], card["foot_type"]) == (1, "aoyagi-3x3")
    assert (card["gap_um"], card["film_um"], card["film_eps_r"], card["electrode_area_mm2"]) == (
        20,
        17,
        2.7,
        16,
    )
    assert [len(card[key]) for key in ("closure_rel_min", "closure_rel_max")] == [9, 9]
    assert [len(card[key]) for key in ("sigma_floor_n", "sigma_rel")] == [3, 3]
    assert (model.ir_version, model.opset_import[0].version) == (8, 17)
    network = OnnxNetwork(folder / "network.onnx")
    for n in (1, 6):
        assert network.force_n(np.zeros((n, 9))).shape == (n, 3)


def test_no_closure_is_no_force(built: Built, folder: Path) -> None:
    """The unloaded foot reads exactly zero newtons."""
    del built
    assert (OnnxNetwork(folder / "network.onnx").force_n(np.zeros((1, 9))) == 0.0).all()


def test_a_build_is_the_same_release_as_itself(built: Built, folder: Path) -> None:
    """Compared with itself nothing differs; the shapes of the report hold."""
    del built
    assert all(row.same and row.found == 0.0 for row in compare(folder, folder))


def test_a_network_of_another_response_is_refused(built: Built, folder: Path, tmp_path: Path) -> None:
    """The card's hash ties the two files together."""
    del built
    for name in ("network.onnx", "response.npz"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    other = FootResponse.load(tmp_path / "response.npz")
    other.coefficients[0] *= 1.01
    other.save(tmp_path / "response.npz")
    with pytest.raises(ModelError, match="not trained on"):
        open_models(tmp_path)


def test_evaluate_prints_the_figures_as_json(built: Built, folder: Path) -> None:
    """What CI and the report read: the figures that the project lives by, through the released file."""
    result = CliRunner().invoke(lab, ["evaluate", "--models", str(folder), "--json"])
    assert result.exit_code == 0, result.output
    figures = json.loads(result.output)
    assert figures["table"] == {name: asdict(row) for name, row in built.table.items()}
    assert figures["direction_deg"] == built.table["paper_network"].direction_deg
    assert figures["paper_direction_deg"] == 2.4


@pytest.mark.parametrize("content", [None, b"", b"not a model"])
def test_a_bad_network_is_one_clear_error(tmp_path: Path, content: bytes | None) -> None:
    """Missing, empty or foreign: the error names the file and the command."""
    path = tmp_path / "network.onnx"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ModelError, match=r"network\.onnx.*footsense lab build"):
        OnnxNetwork(path)


def test_without_the_extra_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    """A robot's install has no workshop: the command says so and names the extra."""
    monkeypatch.setattr("footsense.cli.lab.importlib.util.find_spec", lambda _: None)
    result = CliRunner().invoke(lab, ["evaluate"])
    assert isinstance(result.exception, FootsenseError)
    assert "pip install 'footsense[lab]', or in a checkout" in str(result.exception)


@pytest.mark.parametrize("folder", ["/etc/passwd/x", "/dev/null/a/b", "/proc/models"])
def test_a_folder_that_cannot_be_made_is_told_before_the_solve(folder: str) -> None:
    """One line, at once."""
    result = CliRunner().invoke(lab, ["build", "--output", folder])
    assert isinstance(result.exception, FootsenseError)
    assert str(result.exception).startswith(f"{folder}: ")
    assert str(result.exception).endswith("choose another --output")
