"""A foot type's network in arrays of any library: ONNX Runtime has numpy's alone, and cannot be traced.

The weights come from the ONNX file, whose graph `lab/training/windowed_network.onnxtxt` names them, and expands what
the symmetries of a foot share; the second layer stays in its irreducible parts. Ages and period
of the readings are known before a batch, and no element is missing, so both are part of the offsets.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnx.numpy_helper
from numpy.typing import NDArray
from onnx.reference import ReferenceEvaluator

from footsense.errors import ModelError
from footsense.foot.network_card import INPUTS, verified_sha256
from footsense.frames import ELEMENTS
from footsense.regular_file import read_regular

#: An array of numpy, JAX, torch or another library of the array API, and its module.
Array = Any
ArrayModule = Any

#: Symmetries of the square, and features of each element.
_SYMMETRIES, _PLANES = 8, 6


def _values(path: Path) -> dict[str, NDArray[Any]]:
    """Return all that a network's graph names, as of feet in the air: what does not depend on them is expanded."""
    content = read_regular(path)
    verified_sha256(content, str(path))
    model = onnx.load_from_string(content)
    feet = {signal.name: np.zeros((1, signal.width), np.float32) for signal in INPUTS}
    feet["age_s"] += np.arange(feet["age_s"].size)  # each older than the last
    stored = {tensor.name: onnx.numpy_helper.to_array(tensor) for tensor in model.graph.initializer}
    found: dict[str, NDArray[Any]] = ReferenceEvaluator(model).run(None, feet, intermediate=True)
    return stored | found


class BatchNetwork:
    """The network of a foot type in arrays of a library, for feet without missing elements.

    Args:
        path: Its ONNX file.
        period_s: Time between two readings of an element [s].
        xp: Module of the library, as `array-api-compat` gives it.
        device: Where its arrays are; None for the library's default.

    Attributes:
        weights: What it multiplies with, by name.

    Raises:
        ModelError: The file is damaged, or of a network of another kind.
    """

    def __init__(self, path: Path, period_s: float, xp: ArrayModule, device: Array = None) -> None:
        try:
            of = _values(path)
            c, w1, unit = len(of["b1"]), of["W1"].T, of["force_unit"]
            of_foot = {
                "w1": w1[:, [*range(_PLANES * ELEMENTS), -2]],
                # The features of missing elements are zero, that of the period is constant.
                "b1": of["B1"][:, None] + w1[:, -1:] * math.log(period_s * float(of["per_period"][0])),
                "to_parts": of["to_parts"],
                "w2_scalars": of["W2_scalars"].transpose(0, 2, 1),
                "w2_vectors": of["W2_vectors"].T,
                "b2": of["B2"][:, None],
                "to_units": of["to_units"],
                "outputs": np.concatenate([of["O"][:, :3] * unit, of["S"][:, :3]], axis=1).T,
                "sigma_offset": of["Q"][:3, None],
                "straight": np.concatenate([of["L"], of["M"]]).T * unit,
            }
            self._soft = float(of["soft"][0])
            self._largest, self._force_unit = float(of["highest"]), float(of["force_unit"])
            self._ln_sigma = float(of["ln_lowest"]), float(of["ln_highest"])
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise ModelError(
                f"{path}: no network for feet in a batch ({error!r}); `footsense lab build` makes one"
            ) from error
        self._xp, self._channels = xp, c
        self.weights = {
            name: xp.asarray(part.astype(np.float32), device=device) for name, part in of_foot.items()
        }

    def estimate(self, closure_rel: Array, age_rel: Array) -> tuple[Array, Array]:
        """Return force and sigma of n feet [N], shape (3, n) each.

        Args:
            closure_rel: The last three readings of each element, newest first [1], shape (27, n).
            age_rel: Age of the newest of them over the period [1], shape (9, n) or (9, 1).
        """
        xp, of, c, n = self._xp, self.weights, self._channels, closure_rel.shape[1]
        newest, before, oldest = (closure_rel[k * ELEMENTS : (k + 1) * ELEMENTS, :] for k in range(3))
        slope = newest - before
        bend = slope - (before - oldest)
        moved = age_rel * slope
        now = newest + moved
        now_square = xp.mean(now * now, axis=0, keepdims=True)
        size = xp.sqrt(0.5 * (xp.mean(newest * newest, axis=0, keepdims=True) + now_square) + self._soft)
        planes = xp.concat([newest, slope, moved, bend, age_rel * bend, age_rel * age_rel * bend], axis=0)
        planes = xp.clip(planes / size, -self._largest, self._largest)
        # Of all symmetries g, or parts, and channels i a row g * c + i.
        first = xp.tanh(of["w1"] @ xp.concat([planes, size], axis=0) + of["b1"])
        parts = of["to_parts"] @ xp.reshape(first, (_SYMMETRIES, -1))
        scalars = of["w2_scalars"] @ xp.reshape(parts[:4, :], (4, c, n))
        vectors = of["w2_vectors"] @ xp.reshape(parts[4:, :], (2, 2 * c, n))
        parts = xp.concat([xp.reshape(scalars, (4, -1)), xp.reshape(vectors, (4, -1))], axis=0)
        second = xp.tanh(xp.reshape(of["to_units"] @ parts, first.shape) + of["b2"])
        out = of["outputs"] @ second
        force_n = of["straight"] @ xp.concat([now, moved], axis=0) + out[:3, :] * (now_square / size)
        sigma_rel = xp.exp(xp.clip(out[3:, :] + of["sigma_offset"], *self._ln_sigma))
        return force_n, sigma_rel * (size * self._force_unit)
