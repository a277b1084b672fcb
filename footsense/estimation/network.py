"""The neural network in ONNX Runtime; the only file that knows the library.

One call for all legs, one thread, no spinning: a spinning worker would take a core from the rest of the robot, and
a second thread costs more than this network's microseconds.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import onnxruntime as ort
from numpy.typing import NDArray

from footsense.errors import ModelError
from footsense.foot.checksum_trailer import unsealed_sha256
from footsense.foot.network_card import METADATA_KEY, Card, read_card
from footsense.frames import ELEMENTS

_AXES = 3

#: Largest file that is read [bytes]; the released network has 18 thousand.
MAX_BYTES = 1 << 24

#: Where between the trained limits of its inputs a network is tried before it is used [1].
_TRIED_REL = (0.0, 0.25, 0.5, 0.75, 1.0)


class Network:
    """A network that is ready to run for a fixed number of rows.

    Args:
        path: ONNX file with a card inside.
        n_rows: Rows of every call.

    Attributes:
        card: What the network was made for.
        sha256: Hash of the file without its seal, which names this very network in recordings.

    Raises:
        ModelError: The file is no network or not whole, its card does not fit, or it gives no force where it was
            trained.
    """

    def __init__(self, path: Path, n_rows: int) -> None:
        content = _content(path)
        self.sha256 = unsealed_sha256(content, str(path))
        options = ort.SessionOptions()
        options.intra_op_num_threads = 1
        options.inter_op_num_threads = 1
        options.execution_mode = ort.ExecutionMode.ORT_SEQUENTIAL
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        options.log_severity_level = (
            4  # its errors come as exceptions; its warnings are not for the robot's journal
        )
        try:
            self._session = ort.InferenceSession(
                content, options, providers=["CPUExecutionProvider"], enable_fallback=0
            )
            text = self._session.get_modelmeta().custom_metadata_map.get(METADATA_KEY)
            inputs, outputs = _ports(self._session.get_inputs()), _ports(self._session.get_outputs())
        except Exception as error:  # the library raises a dozen types that share no base of their own
            raise ModelError(f"{path}: not a readable ONNX network ({_one_line(error)})") from error
        # The shapes come first: a card that describes another shape would only be said not to fit.
        if text is not None:
            _check_shapes(path, "input", inputs, ELEMENTS)
            _check_shapes(path, "output", outputs, _AXES)
        self.card: Card = read_card(text, str(path))
        _check_names(path, inputs, [self.card.input.name, self.card.mask.name])
        _check_names(path, outputs, [self.card.output.name, self.card.sigma.name])
        # The values alias these arrays: a call copies nothing and allocates nothing.
        self._closure_rel = np.zeros((n_rows, ELEMENTS), np.float32)
        self._missing = np.zeros((n_rows, ELEMENTS), np.float32)
        self._force_n = np.zeros((n_rows, _AXES), np.float32)
        self._sigma_n = np.zeros((n_rows, _AXES), np.float32)
        self._binding = self._session.io_binding()
        for signal, array in ((self.card.input, self._closure_rel), (self.card.mask, self._missing)):
            self._binding.bind_ortvalue_input(signal.name, ort.OrtValue.ortvalue_from_numpy(array))
        for signal, array in ((self.card.output, self._force_n), (self.card.sigma, self._sigma_n)):
            self._binding.bind_ortvalue_output(signal.name, ort.OrtValue.ortvalue_from_numpy(array))
        self._try_out(path)

    def estimate(
        self, closure_rel: NDArray[np.float64], missing: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return force and sigma of every row [N], shape (rows, 3) each.

        Args:
            closure_rel: Closures over the gap, missing ones filled in [1], shape (rows, 9).
            missing: Which those are, shape (rows, 9).
        """
        self._closure_rel[...] = closure_rel
        self._missing[...] = missing
        self._session.run_with_iobinding(self._binding)
        return self._force_n.astype(np.float64), self._sigma_n.astype(np.float64)

    def _try_out(self, path: Path) -> None:
        """Estimate once at rest, which also plans the memory, and through the trained range.

        Raises:
            ModelError: The network cannot be run for so many legs, or gives no number.
        """
        low, high = np.array(self.card.closure_rel_min), np.array(self.card.closure_rel_max)
        none_missing = np.zeros(self._missing.shape, bool)
        for closure_rel in (np.zeros(ELEMENTS), *(low + share * (high - low) for share in _TRIED_REL)):
            try:
                rows = np.broadcast_to(closure_rel, self._closure_rel.shape)
                force_n, sigma_n = self.estimate(rows, none_missing)
            except Exception as error:  # as above
                n_rows = len(self._closure_rel)
                raise ModelError(f"{path}: cannot be run for {n_rows} legs ({_one_line(error)})") from error
            if not (np.isfinite(force_n).all() and np.isfinite(sigma_n).all()):
                raise ModelError(
                    f"{path}: gives {force_n[0].tolist()} N, sigma {sigma_n[0].tolist()} N inside its trained range; "
                    "its weights are corrupt"
                )


def _content(path: Path) -> bytes:
    """Return the bytes of a network's file.

    Raises:
        ModelError: There is no such file, or it cannot be read, or is larger than any network.
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


class _Port(NamedTuple):
    """What the runtime says of an input or output."""

    name: str
    type: str
    shape: list[Any]


def _ports(values: list[Any]) -> list[_Port]:
    return [_Port(value.name, value.type, value.shape) for value in values]


def _check_shapes(path: Path, what: str, values: list[_Port], width: int) -> None:
    """Check the two inputs or outputs.

    Raises:
        ModelError: There are not two, or one is of another type or shape.
    """
    found = " and ".join(f"{value.type} of shape {value.shape}" for value in values)
    fits = all(value.type == "tensor(float)" and value.shape[1:] == [width] for value in values)
    if len(values) != 2 or not fits:
        raise ModelError(
            f"{path}: its {what}s are {found or 'missing'}, the daemon needs two, float32 of shape [n, {width}]"
        )


def _check_names(path: Path, values: list[_Port], named: list[str]) -> None:
    """Check that the card speaks of this network.

    Raises:
        ModelError: It does not.
    """
    found = [value.name for value in values]
    if found != named:
        raise ModelError(f"{path}: the card names {named}, which the network does not have; it has {found}")


def _one_line(error: Exception) -> str:
    """Return the reason that the library gives, without what follows it, if there is one."""
    return str(error).strip().partition("\n")[0] or type(error).__name__
