"""Neural network, run by ONNX Runtime; no other file imports that library.

One call for all legs, one thread, no spinning: a spinning worker would take a core from the rest of the robot, and
a second thread costs more than this network's microseconds.
"""

from collections.abc import Sequence
from operator import methodcaller
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime as ort

from footsense.errors import ModelError
from footsense.estimation.steady_windows import steady_windows
from footsense.foot.files.checksum_trailer import verified_sha256
from footsense.foot.files.network_card import INPUTS, METADATA_KEY, OUTPUTS, Signal, read_card
from footsense.ports import LoadEstimate, Window

#: Largest file that is read [bytes]; the released network has 80 thousand.
MAX_FILE_BYTES = 1 << 24

#: Shares of the trained range of the inputs at which a network is tested before use [1].
_TEST_CLOSURE_LEVELS_REL = (0.0, 0.25, 0.5, 0.75, 1.0)


class Network:
    """Loaded neural network for a fixed number of feet (rows).

    Args:
        path: ONNX file with a card inside.
        n_rows: Rows of every call.

    Attributes:
        card: Card of the network.
        sha256: Hash of the file without its checksum trailer, which identifies the network in recordings.

    Raises:
        ModelError: The file is missing, damaged, or no ONNX network; its card does not fit; or it gives no force inside
            its trained range.
    """

    def __init__(self, path: Path, n_rows: int) -> None:
        content = _read_file(path)
        self.sha256 = verified_sha256(content, str(path))
        options = ort.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.execution_mode = ort.ExecutionMode.ORT_SEQUENTIAL
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        # Only fatal messages: errors come as exceptions, and warnings do not belong in the robot's journal.
        options.log_severity_level = 4
        try:
            self._session = ort.InferenceSession(
                content, options, providers=["CPUExecutionProvider"], enable_fallback=0
            )
            text = self._session.get_modelmeta().custom_metadata_map.get(METADATA_KEY)
            # Here, as a name that is no UTF-8 raises when it is read.
            inputs, outputs = (
                [(value.name, value.type, value.shape) for value in values]
                for values in (self._session.get_inputs(), self._session.get_outputs())
            )
        except Exception as error:  # the library raises a dozen types without a common base
            raise ModelError(f"{path}: not a readable ONNX network ({_error_line(error)})") from error
        # Shapes first: read_card would only say that a card of another shape does not fit.
        if text is not None:
            _check_shapes(path, "input", inputs, INPUTS)
            _check_shapes(path, "output", outputs, OUTPUTS)
        self.card = read_card(text, str(path))
        # Bound to the session: a call copies and allocates nothing.
        self._binding = self._session.io_binding()
        self._in = [np.zeros((n_rows, signal.width), np.float32) for signal in INPUTS]
        self._out = [np.zeros((n_rows, signal.width), np.float32) for signal in OUTPUTS]
        for signal, array in zip(INPUTS, self._in, strict=True):
            self._binding.bind_ortvalue_input(signal.name, ort.OrtValue.ortvalue_from_numpy(array))
        for signal, array in zip(OUTPUTS, self._out, strict=True):
            self._binding.bind_ortvalue_output(signal.name, ort.OrtValue.ortvalue_from_numpy(array))
        self._run_test_inference(path)

    def estimate(self, window: Window) -> LoadEstimate:
        """Return the estimated load of every row of the window."""
        for array, values in zip(self._in, window, strict=True):
            array[...] = values.reshape(array.shape)
        self._session.run_with_iobinding(self._binding)
        return LoadEstimate(*map(methodcaller("astype", np.float64), self._out))

    def _run_test_inference(self, path: Path) -> None:
        """Run the network once unloaded (which allocates its memory) and over the trained range, as a check.

        Raises:
            ModelError: The network cannot be run for so many rows, or gives a value that is not finite.
        """
        low, high = np.array(self.card.closure_rel_min), np.array(self.card.closure_rel_max)
        n_rows = len(self._in[0])
        for closure_rel in (
            np.zeros_like(low),
            *(low + share * (high - low) for share in _TEST_CLOSURE_LEVELS_REL),
        ):
            try:
                load = self.estimate(steady_windows(np.tile(closure_rel, (n_rows, 1))))
            except Exception as error:  # as above
                raise ModelError(f"{path}: cannot be run for {n_rows} legs ({_error_line(error)})") from error
            if not all(np.isfinite(part).all() for part in load):
                raise ModelError(
                    f"{path}: gives {load.force_n[0].tolist()} N, sigma {load.sigma_n[0].tolist()} N inside its "
                    "trained range; its weights are corrupt"
                )


def _read_file(path: Path) -> bytes:
    """Return the content of a network file.

    Raises:
        ModelError: The file is missing, cannot be read, or is too large.
    """
    try:
        size = path.stat().st_size
        if size > MAX_FILE_BYTES:
            raise ModelError(
                f"{path}: has {size} bytes, at most {MAX_FILE_BYTES} are read; not a network of feet"
            )
        if not (path.is_file() or path.is_dir()):
            raise ModelError(f"{path}: not a file; name the network itself")
        return path.read_bytes()
    except FileNotFoundError as error:
        raise ModelError(f"{path}: no such network ({error.strerror})") from error
    except IsADirectoryError as error:
        raise ModelError(f"{path}: not a file, but a directory; name the network in it") from error
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror}") from error


def _check_shapes(
    path: Path, kind: str, values: Sequence[tuple[str, str, Sequence[Any]]], needed: Sequence[Signal]
) -> None:
    """Raise an error unless names, types and shapes of the inputs or outputs are the expected ones.

    Raises:
        ModelError: They are others than the daemon's.
    """
    found = [(name, dtype, shape[1:]) for name, dtype, shape in values]
    if found != [(signal.name, "tensor(float)", [signal.width]) for signal in needed]:
        shown = ", ".join(f"{name} [{', '.join(map(str, shape))}] {dtype}" for name, dtype, shape in values)
        wanted = ", ".join(f"{signal.name} [n, {signal.width}]" for signal in needed)
        raise ModelError(f"{path}: its {kind}s are {shown or 'missing'}; the daemon needs float32 {wanted}")


def _error_line(error: Exception) -> str:
    """Return the first line of a library error's message, or the name of its type."""
    return str(error).strip().partition("\n")[0] or type(error).__name__
