"""A foot type's network in arrays of any library: ONNX Runtime has numpy's alone, and cannot be traced.

The weights come from the ONNX file, whose graph `lab/training/windowed_network.onnxtxt` names them. What the file
shares among the symmetries of a foot is expanded once; the second layer stays in its irreducible parts. Ages and period
of the readings are known before a batch, and no element is missing, so both are part of the offsets.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnx.numpy_helper
from numpy.typing import NDArray

from footsense.errors import ModelError
from footsense.foot.network_card import verified_sha256
from footsense.frames import ELEMENTS
from footsense.regular_file import read_regular

#: An array of numpy, JAX, torch or another library of the array API, and its module.
Array = Any
ArrayModule = Any

#: Symmetries of the square, and features of each element.
_SYMMETRIES, _PLANES = 8, 6


def _weights(path: Path) -> dict[str, NDArray[Any]]:
    """Return the tensors of an ONNX file by name."""
    content = read_regular(path)
    verified_sha256(content, str(path))
    stored = onnx.load_from_string(content).graph.initializer
    return {tensor.name: onnx.numpy_helper.to_array(tensor) for tensor in stored}


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
            stored = _weights(path)
            c = len(stored["b1"])
            w1 = stored["w1"][:, stored["seen_at"].reshape(_SYMMETRIES, -1)].transpose(1, 2, 0)
            w2 = (stored["w2_steps"] * stored["w2_step"]).reshape(c, _SYMMETRIES, c)
            w2_vectors = (stored["vectors_by_symmetry"] @ w2).reshape(c, 2, 2, c).transpose(2, 3, 1, 0)
            basis = stored["linear_basis"].reshape(-1, ELEMENTS, 3)
            level, moving = (np.tensordot(part, basis, 1) for part in np.split(stored["linear"], 2))
            to_force, to_sigma = (
                (stored[layer] @ stored[turns]).reshape(_SYMMETRIES, c, -1)[..., :3]
                for layer, turns in (("out", "turns"), ("sigma", "sizes"))
            )
            # The features of missing elements are zero, that of the period is constant.
            b1 = stored["b1"] + w1[:, -1:] * math.log(period_s * float(stored["per_period"][0]))
            of_foot = {
                "w1": w1[:, [*range(_PLANES * ELEMENTS), -2]].transpose(0, 2, 1).reshape(_SYMMETRIES * c, -1),
                "b1": b1.reshape(-1, 1),
                "to_parts": stored["to_parts"],
                "w2_scalars": (stored["scalars_by_symmetry"] @ w2).transpose(1, 0, 2),
                "w2_vectors": w2_vectors.reshape(2 * c, 2 * c).T,
                "b2": np.tile(stored["b2"], _SYMMETRIES)[:, None],
                "to_units": stored["to_units"],
                "outputs": np.concatenate([to_force * stored["force_unit"], to_sigma], axis=2)
                .reshape(_SYMMETRIES * c, -1)
                .T,
                "sigma_offset": stored["sigma_offset"][stored["sigma_axes"][:3], None],
                "straight": np.concatenate([level, moving]).T * stored["force_unit"],
            }
            self._soft = float(stored["soft"][0])
            self._largest, self._force_unit = float(stored["highest"]), float(stored["force_unit"])
            self._ln_sigma = float(stored["ln_lowest"]), float(stored["ln_highest"])
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
