"""A network of other inputs and outputs is refused, whichever of them differs; one that fits gets what it is given."""

from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from footsense.daemon.foot_types import released_path
from footsense.errors import ModelError
from footsense.estimation.network import Network
from footsense.estimation.rest import REST_AGE_S, at_rest
from footsense.foot.files.checksum_trailer import add_checksum
from footsense.foot.files.network_card import INPUTS, METADATA_KEY, OUTPUTS
from footsense.frames import Vector
from footsense.ports import Window

FLOAT, DOUBLE = TensorProto.FLOAT, TensorProto.DOUBLE
TYPES = {FLOAT: "tensor(float)", DOUBLE: "tensor(double)"}

#: Name, width and type of inputs or outputs.
Values = list[tuple[str, int, int]]
ALL_IN: Values = [(signal.name, signal.width, FLOAT) for signal in INPUTS]
ALL_OUT: Values = [(signal.name, signal.width, FLOAT) for signal in OUTPUTS]


def network_file(folder: Path, inputs: Values, outputs: Values, weights: Vector | None = None) -> Path:
    """Write a network with the released card whose outputs, one behind the other, are its inputs times `weights`."""
    released = onnx.load(str(released_path("network.onnx")))
    [card] = [entry.value for entry in released.metadata_props if entry.key == METADATA_KEY]
    n_in, n_out = (sum(width for _, width, _ in values) for values in (inputs, outputs))
    weights = np.zeros((n_in, n_out)) if weights is None else weights
    widths = [width for _, width, _ in outputs]
    nodes = [
        *(helper.make_node("Cast", [name], [f"{name}_in"], to=FLOAT) for name, _, _ in inputs),
        helper.make_node("Concat", [f"{name}_in" for name, _, _ in inputs], ["all_in"], axis=1),
        helper.make_node("MatMul", ["all_in", "weights"], ["all_out"]),
        helper.make_node("Split", ["all_out", "widths"], [f"{name}_out" for name, _, _ in outputs], axis=1),
        *(helper.make_node("Cast", [f"{name}_out"], [name], to=kind) for name, _, kind in outputs),
    ]
    tensors = [
        helper.make_tensor("weights", FLOAT, weights.shape, weights.ravel()),
        helper.make_tensor("widths", TensorProto.INT64, [len(widths)], widths),
    ]

    def declared(values: Values) -> list[onnx.ValueInfoProto]:
        return [helper.make_tensor_value_info(name, kind, ["n", width]) for name, width, kind in values]

    graph = helper.make_graph(nodes, "n", declared(inputs), declared(outputs), tensors)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, {METADATA_KEY: card})
    path = folder / "network.onnx"
    path.write_bytes(add_checksum(model.SerializeToString()))
    return path


def test_readings_ages_and_mask_go_in_and_every_output_comes_out(tmp_path: Path) -> None:
    """Newest reading first, each by its elements; four outputs, of a row from that row alone."""
    weights = np.zeros((63, 14))
    # force: element 1 now, two readings ago, and of the age of element 5 one reading ago; sigma: the mask of 0, 4, 8.
    weights[[1, 18 + 2, 27 + 9 + 5, 54, 58, 62], range(6)] = 1.0
    weights[range(10, 18), range(6, 14)] = 1.0  # contact: elements 1 to 8 one reading ago
    network = Network(network_file(tmp_path, ALL_IN, ALL_OUT, weights), 3)
    rng = np.random.default_rng(1)
    for _ in range(2):
        closure_rel, age_s = rng.random((2, 3, 3, 9))
        missing = rng.random((3, 9)) < 0.5
        load = network.estimate(Window(closure_rel, age_s, missing))
        expected_n = np.stack([closure_rel[:, 0, 1], closure_rel[:, 2, 2], age_s[:, 1, 5]], axis=1)
        np.testing.assert_allclose(load.force_n, expected_n, rtol=1e-6)
        np.testing.assert_array_equal(load.sigma_n, missing[:, [0, 4, 8]])
        np.testing.assert_allclose(load.contact, closure_rel[:, 1, 1:5], rtol=1e-6)
        np.testing.assert_allclose(load.contact_sigma, closure_rel[:, 1, 5:], rtol=1e-6)
        assert {part.dtype for part in load} == {np.dtype(np.float64)}


def test_an_estimate_is_not_overwritten_by_the_next(tmp_path: Path) -> None:
    """The buffers stay with the runtime; a frame may be kept."""
    network = Network(network_file(tmp_path, ALL_IN, ALL_OUT, np.ones((63, 14))), 1)
    first = network.estimate(at_rest(np.full((1, 9), 0.5)))
    kept_n = first.force_n.copy()
    network.estimate(at_rest(np.zeros((1, 9))))
    np.testing.assert_array_equal(first.force_n, kept_n)


def test_other_inputs_than_its_own_are_not_taken(tmp_path: Path) -> None:
    """A window of other feet or another number of readings is an error at once."""
    network = Network(network_file(tmp_path, ALL_IN, ALL_OUT), 2)
    window = at_rest(np.zeros((2, 9)))
    with pytest.raises(ValueError, match="reshape"):
        network.estimate(window._replace(closure_rel=window.closure_rel[:, :2]))
    with pytest.raises(ValueError, match=r"reshape|broadcast"):
        network.estimate(at_rest(np.zeros((3, 9))))


@pytest.mark.parametrize("wrong", ["width", "type", "name", "missing", "extra"])
@pytest.mark.parametrize("at", [0, -1])
@pytest.mark.parametrize("kind", ["input", "output"])
def test_another_input_or_output_is_refused_with_what_there_is(
    tmp_path: Path, kind: str, at: int, wrong: str
) -> None:
    """One of another width, type or name, one that is missing, and one too many."""
    needed = ALL_IN if kind == "input" else ALL_OUT
    values = list(needed)
    name, width, _ = values[at]
    if wrong == "missing":
        del values[at]
    elif wrong == "extra":
        values.append((f"{name}_2", width, FLOAT))
    else:
        values[at] = {
            "width": (name, width - 1, FLOAT),
            "type": (name, width, DOUBLE),
            "name": (f"{name}_2", width, FLOAT),
        }[wrong]
    path = network_file(tmp_path, *((values, ALL_OUT) if kind == "input" else (ALL_IN, values)))
    with pytest.raises(ModelError) as caught:
        Network(path, 12)
    found = ", ".join(f"{name} [n, {width}] {TYPES[each]}" for name, width, each in values)
    wanted = ", ".join(f"{name} [n, {width}]" for name, width, _ in needed)
    assert str(caught.value) == f"{path}: its {kind}s are {found}; the daemon needs float32 {wanted}"


def test_the_former_kind_of_network_is_refused_by_its_inputs(tmp_path: Path) -> None:
    """One scan and its mask to force and sigma, as networks were before format 3."""
    former = [("closure_rel", 9, FLOAT), ("missing", 9, FLOAT)]
    with pytest.raises(
        ModelError, match=r"closure_rel \[n, 9\] tensor\(float\), missing .*closure_rel \[n, 27\]"
    ):
        Network(network_file(tmp_path, former, ALL_OUT[:2]), 6)


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_weights_that_are_no_numbers_are_found_at_start(tmp_path: Path, number: float) -> None:
    """Before any force is sent: the network is tried over its trained range, contact and its sigma included."""
    weights = np.zeros((63, 14))
    weights[40, 13] = number  # the last output alone
    with pytest.raises(ModelError, match="inside its trained range; its weights are corrupt"):
        Network(network_file(tmp_path, ALL_IN, ALL_OUT, weights), 2)


def test_the_released_network_reads_an_unloaded_foot_as_nothing() -> None:
    """Exactly, at any age and whatever is missing."""
    network = Network(released_path("network.onnx"), 4)
    missing = np.zeros((4, 9), bool)
    missing[1, 4] = missing[2, :3] = True
    age_s = REST_AGE_S * np.array([1.0, 0.3, 3.0, 1.0])[:, None, None]
    load = network.estimate(Window(np.zeros((4, 3, 9)), age_s, missing))
    assert not load.force_n.any()
    assert (load.sigma_n > 0.0).all()
