"""Write the network as ONNX with its card inside, and check that ONNX Runtime computes the same.

One file carries weights and card (`metadata_props`, key `footsense_card`), so the two cannot drift apart.
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
from footsense.inference.card import METADATA_KEY
from footsense.lab.network import SOFT_REL, Weights

#: What onnxruntime 1.18 reads: newer files gain nothing for ten matrix products.
IR_VERSION, OPSET = 8, 17


def onnx_model(weights: Weights, card: dict[str, Any]) -> onnx.ModelProto:
    """Return the formulas of `network` as a graph: `closure_rel` [n, 9] to `force_n` [n, 3], float32."""
    constants = {
        "mean": np.full((9, 1), 1.0 / 9.0),
        "soft": np.full(1, SOFT_REL**2),
        "linear": np.asarray(weights.linear).T,
        "w1": np.asarray(weights.w1).T,
        "b1": np.asarray(weights.b1),
        "w2": np.asarray(weights.w2).T,
        "b2": np.asarray(weights.b2),
        "w3": np.asarray(weights.w3).T,
        "b3": np.asarray(weights.b3),
    }
    node = helper.make_node
    nodes = [
        node("Mul", ["closure_rel", "closure_rel"], ["squares"]),
        node("MatMul", ["squares", "mean"], ["square"]),
        node("Add", ["square", "soft"], ["softened"]),
        node("Sqrt", ["softened"], ["size"]),
        node("Div", ["closure_rel", "size"], ["pattern"]),
        node("Concat", ["pattern", "size"], ["seen"], axis=1),
        node("Gemm", ["seen", "w1", "b1"], ["sum1"]),
        node("Tanh", ["sum1"], ["hidden1"]),
        node("Gemm", ["hidden1", "w2", "b2"], ["sum2"]),
        node("Tanh", ["sum2"], ["hidden2"]),
        node("Gemm", ["hidden2", "w3", "b3"], ["shape"]),
        node("Div", ["square", "size"], ["scale"]),
        node("Mul", ["shape", "scale"], ["curved"]),
        node("MatMul", ["closure_rel", "linear"], ["straight"]),
        node("Add", ["straight", "curved"], ["force_n"]),
    ]
    graph = helper.make_graph(
        nodes,
        "footsense",
        [helper.make_tensor_value_info("closure_rel", TensorProto.FLOAT, ["n", 9])],
        [helper.make_tensor_value_info("force_n", TensorProto.FLOAT, ["n", 3])],
        [numpy_helper.from_array(np.asarray(value, np.float32), name) for name, value in constants.items()],
    )
    model = helper.make_model(
        graph,
        opset_imports=[helper.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
        producer_name="footsense lab",
    )
    helper.set_model_props(model, {METADATA_KEY: json.dumps(card, sort_keys=True)})
    onnx.checker.check_model(model)
    return model


class OnnxNetwork:
    """A released network as the lab judges it: through ONNX Runtime, from the file's bytes.

    Attributes:
        card: The card inside.
    """

    def __init__(self, path: Path) -> None:
        """Open a network.

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

    def force_n(self, closure_rel: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return forces [N], shape (n, 3), of closures over the gap, shape (n, 9)."""
        (force,) = self._session.run(["force_n"], {"closure_rel": closure_rel.astype(np.float32)})
        return np.asarray(force, dtype=np.float64)


def library_versions() -> dict[str, str]:
    """Return the versions of the libraries that the network was made with."""
    return {"jax": jax.__version__, "numpy": np.__version__, "onnx": onnx.__version__}
