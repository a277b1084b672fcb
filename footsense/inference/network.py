"""The neural network in ONNX Runtime; the only file that knows the library.

One call for all legs, one thread, no spinning: a spinning worker would take a core from the rest of the robot, and
a second thread costs more than this network's microseconds.
"""

import hashlib
from pathlib import Path

import numpy as np
import onnxruntime as ort
from numpy.typing import NDArray

from footsense.errors import ModelError
from footsense.frames import ELEMENTS
from footsense.inference.card import METADATA_KEY, Card, read_card

_AXES = 3


class Network:
    """A network that is ready to run for a fixed number of rows.

    Args:
        path: ONNX file with a card inside.
        n_rows: Rows of every call.

    Attributes:
        card: What the network was made for.
        sha256: Hash of the file, which names this very network in recordings.
    """

    def __init__(self, path: Path, n_rows: int) -> None:
        try:
            content = path.read_bytes()
        except OSError as error:
            raise ModelError(f"{path}: no such network ({error.strerror})") from error
        self.sha256 = hashlib.sha256(content).hexdigest()
        options = ort.SessionOptions()
        options.intra_op_num_threads = 1
        options.inter_op_num_threads = 1
        options.execution_mode = ort.ExecutionMode.ORT_SEQUENTIAL
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        options.log_severity_level = (
            4  # its errors come as exceptions; its warnings are not for the robot's journal
        )
        try:
            self._session = ort.InferenceSession(content, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # the library raises a dozen types that share no base of their own
            raise ModelError(f"{path}: not a readable ONNX network") from error
        self.card: Card = read_card(
            self._session.get_modelmeta().custom_metadata_map.get(METADATA_KEY), str(path)
        )
        self._check_shapes(path)
        # The values alias these arrays: a call copies nothing and allocates nothing.
        self._closure_rel = np.zeros((n_rows, ELEMENTS), np.float32)
        self._force_n = np.zeros((n_rows, _AXES), np.float32)
        self._binding = self._session.io_binding()
        self._binding.bind_ortvalue_input(
            self.card.input.name, ort.OrtValue.ortvalue_from_numpy(self._closure_rel)
        )
        self._binding.bind_ortvalue_output(
            self.card.output.name, ort.OrtValue.ortvalue_from_numpy(self._force_n)
        )
        self.estimate(np.zeros((n_rows, ELEMENTS)))  # the first call plans memory: not in the loop

    def estimate(self, closure_rel: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the force of every row [N], shape (rows, 3), for closures over the gap [1], shape (rows, 9)."""
        self._closure_rel[...] = closure_rel
        self._session.run_with_iobinding(self._binding)
        return self._force_n.astype(np.float64)

    def _check_shapes(self, path: Path) -> None:
        for values, signal, width in (
            (self._session.get_inputs(), self.card.input, ELEMENTS),
            (self._session.get_outputs(), self.card.output, _AXES),
        ):
            value = next((value for value in values if value.name == signal.name), None)
            if value is None:
                raise ModelError(f"{path}: the card names {signal.name!r}, which the network does not have")
            if value.type != "tensor(float)" or len(value.shape) != 2 or value.shape[1] != width:
                raise ModelError(
                    f"{path}: {signal.name} is {value.type} of shape {value.shape}, "
                    f"the daemon needs float32 of shape [n, {width}]"
                )
