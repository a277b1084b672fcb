"""Cards and small networks that fit the daemon, to be changed in one way."""

import json
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import onnx
from onnx import TensorProto, helper

from footsense.foot.network_card import FORMAT, INPUTS, METADATA_KEY, OUTPUTS, add_checksum
from footsense.frames import Vector

FLOAT, DOUBLE = TensorProto.FLOAT, TensorProto.DOUBLE

MOMENTS = np.eye(9) + 0.5


#: A card that fits.
CARD: dict[str, Any] = {
    "format": FORMAT,
    "foot_type": "aoyagi-3x3",
    "inputs": [msgspec.structs.asdict(signal) for signal in INPUTS],
    "outputs": [msgspec.structs.asdict(signal) for signal in OUTPUTS],
    "gap_um": 20.0,
    "film_um": 17.0,
    "film_eps_r": 2.7,
    "electrode_area_mm2": 16.0,
    "closure_rel_min": [-0.05] * 9,
    "closure_rel_max": [0.8] * 9,
    "moments": MOMENTS.tolist(),
    "response_sha256": "f" * 64,
}


#: Name, width and type of each input or output.
Values = list[tuple[str, int, int]]
ALL_IN: Values = [(signal.name, signal.width, FLOAT) for signal in INPUTS]
ALL_OUT: Values = [(signal.name, signal.width, FLOAT) for signal in OUTPUTS]
#: Numbers in a row of all inputs, and of all outputs.
N_IN, N_OUT = (sum(signal.width for signal in signals) for signals in (INPUTS, OUTPUTS))


def card(**changes: Any) -> str:
    """Return a card that fits but for the changes; what is changed to None is left out."""
    return json.dumps({key: value for key, value in {**CARD, **changes}.items() if value is not None})


def signals(kind: str, at: int, **changes: Any) -> list[dict[str, Any]]:
    """Return the `inputs` or `outputs` of a fitting card with one of them changed."""
    changed = [dict(signal) for signal in CARD[kind]]
    changed[at] |= changes
    return changed


def network_file(
    folder: Path,
    text: str | None,
    *,
    inputs: Values = ALL_IN,
    outputs: Values = ALL_OUT,
    weights: Vector | None = None,
) -> Path:
    """Write network.onnx with this card or none: its outputs, one behind the other, are its inputs times `weights`.

    Args:
        folder: Where to.
        text: The card.
        inputs: Inputs.
        outputs: Outputs.
        weights: Shape (numbers of all inputs, of all outputs); zero without.
    """
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

    return network_of_nodes(folder / "network.onnx", text, nodes, tensors, inputs=inputs, outputs=outputs)


def network_of_nodes(
    path: Path,
    text: str | None,
    nodes: list[onnx.NodeProto],
    tensors: list[onnx.TensorProto],
    *,
    inputs: Values = ALL_IN,
    outputs: Values = ALL_OUT,
) -> Path:
    """Write a network of these nodes and constants, with this card or none and its checksum."""

    def declared(values: Values) -> list[onnx.ValueInfoProto]:
        return [helper.make_tensor_value_info(name, kind, ["n", width]) for name, width, kind in values]

    graph = helper.make_graph(nodes, "n", declared(inputs), declared(outputs), tensors)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    if text is not None:
        helper.set_model_props(model, {METADATA_KEY: text})
    path.write_bytes(add_checksum(model.SerializeToString()))
    return path
