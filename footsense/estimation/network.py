"""The neural network in ONNX Runtime; the only file that imports the library.

One call for all legs, one thread, no spinning: a spinning worker would take a core from the rest of the robot, and
a second thread costs more than this network's microseconds.
"""

from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime as ort

from footsense.errors import ModelError
from footsense.foot.files.checksum_trailer import verified_sha256
from footsense.foot.files.network_card import METADATA_KEY, Signal, read_card
from footsense.frames import ELEMENTS, Mask, Vector

_AXES = 3

#: Largest file that is read [bytes]; the released network has 18 thousand.
MAX_BYTES = 1 << 24

#: Shares of the trained range of the inputs at which a network is tested before use [1].
_TESTED_REL = (0.0, 0.25, 0.5, 0.75, 1.0)


class Network:
    """A network that is ready to run for a fixed number of rows.

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
        content = _content(path)
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
            inputs, outputs = self._session.get_inputs(), self._session.get_outputs()
        except Exception as error:  # the library raises a dozen types without a common base
            raise ModelError(f"{path}: not a readable ONNX network ({_error_line(error)})") from error
        # Shapes first: read_card would only say that a card of another shape does not fit.
        if text is not None:
            _check_shapes(path, "input", inputs, ELEMENTS)
            _check_shapes(path, "output", outputs, _AXES)
        card = self.card = read_card(text, str(path))
        _check_names(path, inputs, [card.input, card.mask])
        _check_names(path, outputs, [card.output, card.sigma])
        # Bound to the session: a call copies and allocates nothing.
        self._closure_rel = np.zeros((n_rows, ELEMENTS), np.float32)
        self._missing = np.zeros((n_rows, ELEMENTS), np.float32)
        self._force_n = np.zeros((n_rows, _AXES), np.float32)
        self._sigma_n = np.zeros((n_rows, _AXES), np.float32)
        self._binding = self._session.io_binding()
        for signal, array in ((card.input, self._closure_rel), (card.mask, self._missing)):
            self._binding.bind_ortvalue_input(signal.name, ort.OrtValue.ortvalue_from_numpy(array))
        for signal, array in ((card.output, self._force_n), (card.sigma, self._sigma_n)):
            self._binding.bind_ortvalue_output(signal.name, ort.OrtValue.ortvalue_from_numpy(array))
        self._test(path)

    def estimate(self, closure_rel: Vector, missing: Mask) -> tuple[Vector, Vector]:
        """Return force and sigma of every row [N], shape (rows, 3) each.

        Args:
            closure_rel: Closures over the gap, missing ones imputed [1], shape (rows, 9).
            missing: The imputed ones, shape (rows, 9).
        """
        self._closure_rel[...] = closure_rel
        self._missing[...] = missing
        self._session.run_with_iobinding(self._binding)
        return self._force_n.astype(np.float64), self._sigma_n.astype(np.float64)

    def _test(self, path: Path) -> None:
        """Estimate once unloaded, which also plans the memory, and through the trained range.

        Raises:
            ModelError: The network cannot be run for so many rows, or gives a value that is not finite.
        """
        low, high = np.array(self.card.closure_rel_min), np.array(self.card.closure_rel_max)
        n_rows, none_missing = len(self._missing), np.zeros(self._missing.shape, bool)
        for closure_rel in (np.zeros(ELEMENTS), *(low + share * (high - low) for share in _TESTED_REL)):
            try:
                force_n, sigma_n = self.estimate(np.tile(closure_rel, (n_rows, 1)), none_missing)
            except Exception as error:  # as above
                raise ModelError(f"{path}: cannot be run for {n_rows} legs ({_error_line(error)})") from error
            if not (np.isfinite(force_n).all() and np.isfinite(sigma_n).all()):
                raise ModelError(
                    f"{path}: gives {force_n[0].tolist()} N, sigma {sigma_n[0].tolist()} N inside its trained range; "
                    "its weights are corrupt"
                )


def _content(path: Path) -> bytes:
    """Return the bytes of a network's file.

    Raises:
        ModelError: The file is missing, cannot be read, or is too large.
    """
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise ModelError(f"{path}: has {size} bytes, at most {MAX_BYTES} are read; not a network of feet")
        if not (path.is_file() or path.is_dir()):
            raise ModelError(f"{path}: not a file; name the network itself")
        return path.read_bytes()
    except FileNotFoundError as error:
        raise ModelError(f"{path}: no such network ({error.strerror})") from error
    except IsADirectoryError as error:
        raise ModelError(f"{path}: not a file, but a directory; name the network in it") from error
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror}") from error


def _check_shapes(path: Path, kind: str, values: list[Any], width: int) -> None:
    """Check the number, the type and the shape of the inputs or outputs.

    Raises:
        ModelError: There are not two, or one is of another type or shape.
    """
    found = " and ".join(f"{value.type} of shape {value.shape}" for value in values)
    fits = all(value.type == "tensor(float)" and value.shape[1:] == [width] for value in values)
    if len(values) != 2 or not fits:
        raise ModelError(
            f"{path}: its {kind}s are {found or 'missing'}, the daemon needs two, float32 of shape [n, {width}]"
        )


def _check_names(path: Path, values: list[Any], signals: list[Signal]) -> None:
    """Check that the inputs or outputs have the names of the card.

    Raises:
        ModelError: They have others.
    """
    found, named = [value.name for value in values], [signal.name for signal in signals]
    if found != named:
        raise ModelError(f"{path}: the card names {named}, which the network does not have; it has {found}")


def _error_line(error: Exception) -> str:
    """Return the first line of the library's message, or the name of its type."""
    return str(error).strip().partition("\n")[0] or type(error).__name__
