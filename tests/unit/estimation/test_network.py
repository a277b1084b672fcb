"""A network of another shape is refused, whichever of its inputs and outputs differs."""

import json
from pathlib import Path

import onnx
import pytest
from onnx import TensorProto, helper

from footsense.daemon.foot_types import released_path
from footsense.errors import ModelError
from footsense.estimation.network import Network
from footsense.foot.files.checksum_trailer import add_checksum
from footsense.foot.files.network_card import METADATA_KEY

FLOAT, DOUBLE = TensorProto.FLOAT, TensorProto.DOUBLE
TYPES = {FLOAT: "tensor(float)", DOUBLE: "tensor(double)"}
BOTH_IN, BOTH_OUT = [(9, FLOAT)] * 2, [(3, FLOAT)] * 2

Values = list[tuple[int, int]]  # width, type


def network_file(folder: Path, inputs: Values, outputs: Values) -> Path:
    """Write a network of zero weights with the released card, and inputs and outputs of these widths and types."""
    released = onnx.load(str(released_path("network.onnx")))
    [card] = [entry.value for entry in released.metadata_props if entry.key == METADATA_KEY]
    described = json.loads(card)
    names_in = [described[key]["name"] for key in ("input", "mask")] + ["third_in"]
    names_out = [described[key]["name"] for key in ("output", "sigma")] + ["third_out"]
    nodes, weights = [], []
    for (width, kind), name in zip(outputs, names_out, strict=False):
        nodes += [
            helper.make_node("Cast", [names_in[0]], [f"{name}_in"], to=FLOAT),
            helper.make_node("MatMul", [f"{name}_in", f"{name}_weights"], [f"{name}_out"]),
            helper.make_node("Cast", [f"{name}_out"], [name], to=kind),
        ]
        n_in = inputs[0][0]
        weights.append(helper.make_tensor(f"{name}_weights", FLOAT, [n_in, width], [0.0] * n_in * width))

    def declared(values: Values, names: list[str]) -> list[onnx.ValueInfoProto]:
        return [
            helper.make_tensor_value_info(name, kind, ["n", width])
            for (width, kind), name in zip(values, names, strict=False)
        ]

    graph = helper.make_graph(nodes, "n", declared(inputs, names_in), declared(outputs, names_out), weights)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, {METADATA_KEY: card})
    path = folder / "network.onnx"
    path.write_bytes(add_checksum(model.SerializeToString()))
    return path


def test_a_network_that_fits_is_taken(tmp_path: Path) -> None:
    """What the other test changes is right as it is."""
    Network(network_file(tmp_path, BOTH_IN, BOTH_OUT), 12)


@pytest.mark.parametrize("wrong", [(8, FLOAT), (9, DOUBLE), None, (9, FLOAT)])
@pytest.mark.parametrize("at", [0, 1])
@pytest.mark.parametrize("kind", ["input", "output"])
def test_two_inputs_of_nine_and_two_outputs_of_three_float32(
    tmp_path: Path, kind: str, at: int, wrong: tuple[int, int] | None
) -> None:
    """One of another width or type, one that is missing, and one too many: refused with what there is."""
    width = 9 if kind == "input" else 3
    values: Values = [(width, FLOAT)] * 2
    if wrong is None:
        del values[at]
    elif wrong == (9, FLOAT):
        values.insert(at, (width, FLOAT))
    else:
        values[at] = wrong if wrong[1] == FLOAT else (width, DOUBLE)
    path = network_file(tmp_path, *((values, BOTH_OUT) if kind == "input" else (BOTH_IN, values)))
    with pytest.raises(ModelError) as caught:
        Network(path, 12)
    found = " and ".join(f"{TYPES[each]} of shape ['n', {n}]" for n, each in values)
    needed = f"the daemon needs two, float32 of shape [n, {width}]"
    assert str(caught.value) == f"{path}: its {kind}s are {found}, {needed}"
