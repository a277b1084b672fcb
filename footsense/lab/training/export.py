"""Write the network as ONNX with its card inside, and check that ONNX Runtime computes the same.

One file carries weights and card (`metadata_props`, key `footsense_card`), so the two cannot drift apart. The file
holds each weight once; Gather puts it in its eight places when the runtime loads the file, which folds all of it into
plain matrices: a call multiplies and adds, nothing else.
"""

import json
from pathlib import Path
from typing import Any

import jax
import numpy as np
import onnx
import onnxruntime
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from footsense.errors import ModelError
from footsense.foot.files.network_card import METADATA_KEY
from footsense.lab.symmetry import SYMMETRIES
from footsense.lab.training.network import (
    N_SYMMETRIES,
    SEEN,
    SOFT_REL,
    Weights,
    linear_basis,
    relative_index,
    seen_index,
)

Vector = NDArray[np.float64]

#: The format of onnxruntime 1.18; newer ones gain nothing for ten matrix products.
IR_VERSION, OPSET = 8, 17

_node = helper.make_node


def _constants(weights: Weights) -> dict[str, NDArray[Any]]:
    """Return the weights, each once, and their places; floats are float32 in the file, indices int64."""
    c = weights.channels
    turns = np.stack(SYMMETRIES).transpose(0, 2, 1)  # a row vector times this is the turned vector
    named = {name: np.asarray(part, np.float64) for name, part in weights._asdict().items()}
    return {
        **named,
        "sigma_axes": np.array([0, 0, 1]),
        "seen_at": seen_index().ravel(),
        "relative_at": relative_index().ravel(),
        "turns": turns,
        "sizes": np.abs(turns),
        "linear_basis": linear_basis().reshape(5, 27),
        "mean": np.full((9, 1), 1.0 / 9.0),
        "soft": np.full(1, SOFT_REL**2),
        "eight": np.array([N_SYMMETRIES]),
        "w1_as": np.array([c, N_SYMMETRIES, SEEN]),
        "w1_flat": np.array([SEEN, N_SYMMETRIES * c]),
        "w2_by": np.array([c, N_SYMMETRIES, c]),
        "w2_as": np.array([c, N_SYMMETRIES, N_SYMMETRIES, c]),
        "w2_flat": np.array([N_SYMMETRIES * c, N_SYMMETRIES * c]),
        "out_flat": np.array([N_SYMMETRIES * c, 3]),
        "linear_as": np.array([9, 3]),
    }


def _placing() -> list[onnx.NodeProto]:
    """Return the ONNX nodes that expand shared weights into full matrices, as `network.expand` does."""
    return [
        _node("Gather", ["w1", "seen_at"], ["w1_met"], axis=1),
        _node("Reshape", ["w1_met", "w1_as"], ["w1_units"]),
        _node("Transpose", ["w1_units"], ["w1_turned"], perm=[2, 1, 0]),
        _node("Reshape", ["w1_turned", "w1_flat"], ["W1"]),
        _node("Tile", ["b1", "eight"], ["B1"]),
        _node("Reshape", ["w2", "w2_by"], ["w2_relative"]),
        _node("Gather", ["w2_relative", "relative_at"], ["w2_met"], axis=1),
        _node("Reshape", ["w2_met", "w2_as"], ["w2_units"]),
        _node("Transpose", ["w2_units"], ["w2_turned"], perm=[2, 3, 1, 0]),
        _node("Reshape", ["w2_turned", "w2_flat"], ["W2"]),
        _node("Tile", ["b2", "eight"], ["B2"]),
        _node("MatMul", ["force", "turns"], ["force_turned"]),
        _node("Reshape", ["force_turned", "out_flat"], ["F"]),
        _node("MatMul", ["sigma", "sizes"], ["sigma_turned"]),
        _node("Reshape", ["sigma_turned", "out_flat"], ["S"]),
        _node("Gather", ["sigma_offset", "sigma_axes"], ["Q"], axis=0),
        _node("MatMul", ["linear", "linear_basis"], ["linear_row"]),
        _node("Reshape", ["linear_row", "linear_as"], ["L"]),
    ]


def _running() -> list[onnx.NodeProto]:
    """Return the nodes of `network.run`."""
    return [
        _node("Mul", ["closure_rel", "closure_rel"], ["squares"]),
        _node("MatMul", ["squares", "mean"], ["square"]),
        _node("Add", ["square", "soft"], ["softened"]),
        _node("Sqrt", ["softened"], ["size"]),
        _node("Div", ["closure_rel", "size"], ["pattern"]),
        _node("Concat", ["pattern", "missing", "size"], ["seen"], axis=1),
        _node("Gemm", ["seen", "W1", "B1"], ["sum1"]),
        _node("Tanh", ["sum1"], ["hidden1"]),
        _node("Gemm", ["hidden1", "W2", "B2"], ["sum2"]),
        _node("Tanh", ["sum2"], ["hidden2"]),
        _node("MatMul", ["hidden2", "F"], ["shape"]),
        _node("Div", ["square", "size"], ["scale"]),
        _node("Mul", ["shape", "scale"], ["curved"]),
        _node("MatMul", ["closure_rel", "L"], ["straight"]),
        _node("Add", ["straight", "curved"], ["force_n"]),
        _node("Gemm", ["hidden2", "S", "Q"], ["ln_sigma"]),
        _node("Exp", ["ln_sigma"], ["sigma_rel"]),
        _node("Mul", ["sigma_rel", "size"], ["sigma_n"]),
    ]


def onnx_model(weights: Weights, card: dict[str, Any]) -> onnx.ModelProto:
    """Return the network as a graph: `closure_rel`, `missing` [n, 9] to `force_n`, `sigma_n` [n, 3], float32."""
    constants = {
        name: value.astype(np.int64 if np.issubdtype(value.dtype, np.integer) else np.float32)
        for name, value in _constants(weights).items()
    }
    graph = helper.make_graph(
        _placing() + _running(),
        "footsense",
        [
            helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", 9])
            for name in ("closure_rel", "missing")
        ],
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", 3]) for name in ("force_n", "sigma_n")],
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


class OnnxNetwork:
    """A network file, run by ONNX Runtime.

    Attributes:
        card: The card inside.
    """

    def __init__(self, path: Path) -> None:
        """Load an ONNX network and the training card from the file's metadata.

        Raises:
            ModelError: The file is missing, no ONNX, or without a card.
        """
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        try:
            self._session = onnxruntime.InferenceSession(path.read_bytes(), options, ["CPUExecutionProvider"])
            self.card = json.loads(self._session.get_modelmeta().custom_metadata_map[METADATA_KEY])
        except Exception as error:  # the runtime's own exceptions share no documented base
            why = str(error).splitlines()[0]
            raise ModelError(
                f"{path} is no network with a card ({why}); rebuild it with `footsense lab build`"
            ) from error

    def estimate(
        self, closure_rel: Vector, missing: NDArray[np.bool_] | None = None
    ) -> tuple[Vector, Vector]:
        """Return force and sigma [N], shape (n, 3) each.

        Args:
            closure_rel: Closures over the gap, missing ones filled in [1], shape (n, 9).
            missing: Mask of the missing ones, shape (n, 9); none if None.
        """
        mask = np.zeros(closure_rel.shape) if missing is None else missing
        inputs = {"closure_rel": closure_rel.astype(np.float32), "missing": mask.astype(np.float32)}
        force, sigma = self._session.run(["force_n", "sigma_n"], inputs)
        return np.asarray(force, dtype=np.float64), np.asarray(sigma, dtype=np.float64)

    def force_n(self, closure_rel: Vector) -> Vector:
        """Return forces [N], shape (n, 3), of closures over the gap, shape (n, 9), none missing."""
        return self.estimate(closure_rel)[0]

    def sigma_n(self, closure_rel: Vector) -> Vector:
        """Return standard deviations [N], shape (n, 3), of closures over the gap, shape (n, 9), none missing."""
        return self.estimate(closure_rel)[1]


def library_versions() -> dict[str, str]:
    """Return the versions of the libraries behind the network."""
    return {"jax": jax.__version__, "numpy": np.__version__, "onnx": onnx.__version__}
