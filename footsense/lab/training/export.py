"""ONNX export of the windowed network with its card, and the network run by ONNX Runtime.

One file carries weights and card (`metadata_props`, key `footsense_card`), so the two cannot drift apart. The file
holds each weight once, those of the second layer in 16 bits; when the runtime loads it, the graph's first operators
make the matrices of them, which it folds. The features of the readings are a part of the graph: a call takes readings
and ages as they stand.
The operators are written in ONNX's textual syntax, in `windowed_network.onnxtxt`.
"""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np
import onnx
import onnx.parser
import onnxruntime
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from footsense.errors import ModelError
from footsense.estimation.network import steady_windows
from footsense.foot.network_card import INPUTS, METADATA_KEY, OUTPUTS
from footsense.frames import ELEMENTS, Vector
from footsense.lab.training.windowed_network import (
    LN_SIGMA_BOUNDS,
    MAX_FEATURE,
    MIN_READING_INTERVAL_S,
    N_OUTPUTS,
    N_SYMMETRIES,
    PATTERN_SOFTENING_REL,
    READINGS_PER_ELEMENT,
    SIGMA_ROW_OF_OUTPUT,
    ZERO_FEATURE_SCAN_PERIOD_S,
    Weights,
    element_input_index,
    irreducible_parts,
    linear_basis,
    output_symmetries,
)
from footsense.ports import LoadEstimate, Window
from footsense.regular_file import read_regular

#: The format of onnxruntime 1.18; newer ones gain nothing for ten matrix products.
IR_VERSION, OPSET = 8, 17
#: Steps of 16 bits in the largest weight of a unit.
_MOST_STEPS = 32767


def _steps_of_second_layer(w2: Any) -> tuple[NDArray[np.int16], Vector]:
    """Return the weights of the second layer, nine tenths of all, as whole steps, (c, 8 c), and the steps, (c, 1)."""
    exact = np.asarray(w2, np.float64)
    largest = np.maximum(np.abs(exact).max(axis=1, keepdims=True), 1e-30)
    step: Vector = (largest / _MOST_STEPS).astype(np.float32)
    return np.rint(exact / step).astype(np.int16), step


def _stored(value: NDArray[Any]) -> NDArray[Any]:
    """Return a value in a type of the graph: float32, int64, or int16 as it is."""
    if value.dtype == np.int16:
        return value
    return value.astype(np.int64 if np.issubdtype(value.dtype, np.integer) else np.float32)


def as_stored(weights: Weights) -> Weights:
    """Return the weights as a file holds them: those of the second layer in 16 bits."""
    steps, step = _steps_of_second_layer(weights.w2)
    return weights._replace(w2=steps.astype(np.float32) * step)


def _initialisers(weights: Weights, force_unit: float) -> dict[str, NDArray[Any]]:
    """Return the ONNX initialisers: weights, and the indices that expand them into full matrices."""
    c, basis = weights.channels, linear_basis()
    n_inputs = weights.w1.shape[1]
    turns = output_symmetries().transpose(0, 2, 1)  # a row vector times this is the turned vector
    named = {name: np.asarray(part, np.float64) for name, part in weights._asdict().items()}
    del named["w2"]
    w2_steps, w2_step = _steps_of_second_layer(weights.w2)
    scalars, vectors, parts = irreducible_parts()
    one, none = np.eye(ELEMENTS), np.zeros((ELEMENTS, ELEMENTS))
    level, slope = np.hsplit(np.eye(2 * len(basis)), 2)
    return {
        **named,
        "w2_steps": w2_steps,
        "w2_step": w2_step,
        "sigma_axes": SIGMA_ROW_OF_OUTPUT,
        "seen_at": element_input_index().ravel(),
        "scalars_by_symmetry": scalars,
        "vectors_by_symmetry": vectors.reshape(4, N_SYMMETRIES),
        "to_parts": parts,
        "to_units": parts.T,
        "turns": turns,
        "sizes": np.abs(turns),
        "linear_basis": basis.reshape(len(basis), -1),
        "level_of": level.T,
        "slope_of": slope.T,
        "linear_as": np.array([ELEMENTS, 3]),
        "eight": np.array([N_SYMMETRIES]),
        "w1_as": np.array([c, N_SYMMETRIES, n_inputs]),
        "w1_flat": np.array([n_inputs, N_SYMMETRIES * c]),
        "w2_by": np.array([c, N_SYMMETRIES, c]),
        "w2_vectors_as": np.array([c, 2, 2, c]),
        "w2_vectors_flat": np.array([2 * c, 2 * c]),
        "units_as": np.array([-1, N_SYMMETRIES, c]),
        "units_flat": np.array([-1, N_SYMMETRIES * c]),
        "vectors_as": np.array([-1, 4, c]),
        "vectors_flat": np.array([-1, 2 * c]),
        "four_four": np.array([4, 4]),
        "out_flat": np.array([N_SYMMETRIES * c, N_OUTPUTS]),
        # Newest minus the one before, and that minus the oldest.
        "changes_of": np.block([[one, none], [-one, one], [none, -one]]),
        "each_nine": np.array([ELEMENTS, ELEMENTS]),
        "all_three": np.full(READINGS_PER_ELEMENT, ELEMENTS),
        "mean_of_first": np.concatenate([np.full((ELEMENTS, 1), 1.0 / ELEMENTS), np.zeros((ELEMENTS, 1))]),
        "mean": np.full((ELEMENTS, 1), 1.0 / ELEMENTS),
        "both_means": np.full((2 * ELEMENTS, 1), 0.5 / ELEMENTS),
        "least_s": np.array(-MIN_READING_INTERVAL_S),
        "per_period": np.array([1.0 / ZERO_FEATURE_SCAN_PERIOD_S]),
        "soft": np.array([PATTERN_SOFTENING_REL**2]),
        "lowest": np.array(-MAX_FEATURE),
        "highest": np.array(MAX_FEATURE),
        "ln_lowest": np.array(LN_SIGMA_BOUNDS[0]),
        "ln_highest": np.array(LN_SIGMA_BOUNDS[1]),
        "three_four": np.array([3, 4]),
        "force_unit": np.array(force_unit),
    }


def _graph_nodes() -> Sequence[onnx.NodeProto]:
    """Return the operator nodes of the ONNX graph, read from `windowed_network.onnxtxt`."""
    operators = Path(__file__).with_name("windowed_network.onnxtxt").read_text(encoding="utf-8")
    nodes: Sequence[onnx.NodeProto] = onnx.parser.parse_graph(f"operators () => () {{\n{operators}}}").node
    for node in nodes:
        node.ClearField("domain")  # the parser sets the default one
    return nodes


def onnx_model(weights: Weights, card: dict[str, Any], force_unit: float = 1.0) -> onnx.ModelProto:
    """Return the network as an ONNX model: readings and ages in; force, contact and their sigma out (float32).

    Args:
        weights: The weights.
        card: Its card, as JSON values.
        force_unit: Unit of the forces that the weights were trained on [N].
    """
    constants = {name: _stored(value) for name, value in _initialisers(weights, force_unit).items()}
    inputs, outputs = (
        [helper.make_tensor_value_info(one.name, TensorProto.FLOAT, ["n", one.width]) for one in signals]
        for signals in (INPUTS, OUTPUTS)
    )
    graph = helper.make_graph(
        _graph_nodes(),
        "footsense",
        inputs,
        outputs,
        [numpy_helper.from_array(value, name) for name, value in constants.items()],
    )
    model = helper.make_model(
        graph,
        opset_imports=[helper.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
        producer_name="footsense lab",
    )
    helper.set_model_props(model, {METADATA_KEY: json.dumps(card, sort_keys=True)})
    onnx.checker.check_model(model, full_check=True)
    return model


def load_weights(path: Path) -> Weights:
    """Return the weights of a network file, as start weights of a training."""
    graph = onnx.load(path).graph
    stored = {one.name: numpy_helper.to_array(one) for one in graph.initializer}
    stored["w2"] = stored["w2_steps"].astype(np.float32) * stored["w2_step"]
    return Weights(*(np.asarray(stored[name], np.float32) for name in Weights._fields))


class OnnxNetwork:
    """A windowed network from an ONNX file, run by ONNX Runtime.

    Attributes:
        card: The card inside.
    """

    def __init__(self, path: Path) -> None:
        """Open an ONNX network and the card in its metadata.

        Raises:
            ModelError: The file is missing, no ONNX, or without a card.
        """
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        try:
            content = read_regular(path)
            self._session = onnxruntime.InferenceSession(content, options, ["CPUExecutionProvider"])
            self.card = json.loads(self._session.get_modelmeta().custom_metadata_map[METADATA_KEY])
        except Exception as error:  # the runtime's own exceptions share no documented base
            why = str(error).splitlines()[0]
            raise ModelError(
                f"{path} is no network with a card ({why}); rebuild it with `footsense lab build`"
            ) from error

    def estimate(self, window: Window) -> LoadEstimate:
        """Return the estimated loads of any number of windows."""
        inputs = {
            signal.name: np.asarray(part, np.float32).reshape(len(part), math.prod(part.shape[1:]))
            for signal, part in zip(INPUTS, window, strict=True)
        }
        outputs = self._session.run([signal.name for signal in OUTPUTS], inputs)
        return LoadEstimate(*(np.asarray(part, dtype=np.float64) for part in outputs))

    def force_n(self, closure_rel: Vector) -> Vector:
        """Return estimated forces [N], (n, 3), under steady loads, from closures over the gap, (n, elements)."""
        return self.estimate(steady_windows(closure_rel)).force_n


def library_versions() -> dict[str, str]:
    """Return the versions of the libraries that determine the trained network."""
    return {"jax": jax.__version__, "numpy": np.__version__, "onnx": onnx.__version__}
