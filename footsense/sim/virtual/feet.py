"""Thousands of feet at once, for whoever trains a controller: contact forces in, what the service would publish out.

The chain of the service in arrays, without a bus: every conversion reads the next element of all feet under the load at
its middle, with the converter's noise; after every 18 of board `ad7147`, or four of `fdc1004`, the network estimates
the forces of the time of sending from the last three readings of each element, which are published. Network, response
table and limits of a usable force are the service's.

Left out: rubber's memory and temperature; faults but for breaks of a cable; the way over CAN (up to 3 ms of frames for
six legs, unless `Variation.delay_s` has it); what a closed gap does to the elements beside it; elements that contradict
the others, so that only overload makes a foot `DEGRADED`. The error of a baseline is constant, where the service's
follows the swing.
"""

import math
import os
import sys
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from array_api_compat import array_namespace, device, is_jax_array, is_numpy_array
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from footsense.foot.parameters import ForceUncertainty
from footsense.sim.virtual.foot_model import FootModel
from footsense.sim.virtual.network import Array
from footsense.sim.virtual.scan import Board
from footsense.sim.virtual.state import FeetState, VirtualForces
from footsense.sim.virtual.variation import AS_DESIGNED, Variation

#: Longest time between two steps [s].
_MAX_STEP_S = 1.0
#: Feet that a processor computes together: few, so that their arrays stay in its cache.
_BLOCK = 1024
#: A freed array of this size makes glibc keep the memory of all smaller ones (M_MMAP_THRESHOLD, manual page mallopt):
#: without it a step of numpy takes 1.6 times as long [byte].
_KEPT_BY_MALLOC = 31 << 20


class VirtualFeet:
    """Feet under given contact forces, in a batch, with the lag, noise and gaps of what the service publishes.

    Args:
        n_feet: Number of feet.
        foot_type: A released foot type, or a folder with a slash in its name.
        board: Electronics of a foot, as in a robot file.
        cable_breaks_per_s: Mean rate at which the cable of a foot breaks for 20 ms; a foot is then without force for
            28 ms, with board `fdc1004` for 78 ms [1/s].
        uncertainty: What the service does not know of the feet, in sigma alone; None for what it does not of feet that
            nobody has calibrated, with tolerances and gains of the variation.
        variation: How the feet differ from the design and from episode to episode.
        seed: Seed of everything random, or one for each environment, shape (environments,), whose feet lie side by
            side: foot j of the k of environment i is number i * k + j.
        like: An array of the library, and on the device, of the arrays of all steps: numpy, JAX, torch; None for numpy.

    Raises:
        ModelError: The models of the foot type are missing or damaged.
        ValueError: An argument is out of range, or the feet cannot be shared among the environments.

    Example:
        >>> feet = VirtualFeet(2)
        >>> up = np.array([[0.0, 0.0, 1.0]] * 2)
        >>> for t_s in np.arange(0.0, 0.2, 0.01):
        ...     published = feet.step(t_s, up * [[0.8], [0.4]], up)
        >>> published.usable.tolist(), published.force_n[:, 2].round(1).tolist()
        ([True, True], [0.8, 0.4])
    """

    def __init__(
        self,
        n_feet: int,
        foot_type: str = "aoyagi-3x3",
        *,
        board: Board = "ad7147",
        cable_breaks_per_s: float = 0.0,
        uncertainty: ForceUncertainty | None = None,
        variation: Variation = AS_DESIGNED,
        seed: int | NDArray[np.int_] = 0,
        like: Array = None,
    ) -> None:
        like = np.zeros(1) if like is None else like
        self._xp = array_namespace(like)
        self._model = model = FootModel(
            foot_type,
            board=board,
            cable_breaks_per_s=cable_breaks_per_s,
            uncertainty=uncertainty,
            variation=variation,
            xp=self._xp,
            device=device(like),
        )
        least_s, most_s = variation.delay_s
        self._delay_varies = least_s != most_s
        # Conversion 0 is a step after time 0; a force is there so long after the conversion before its first.
        self._force_ns = model.scan.conversions_per_force * model.scan.step_ns
        self._sent_after_ns = model.scan.send_delay_ns + round(1e9 * most_s)
        self._shape, keys = (n_feet, 3), model.keys(n_feet, seed)
        n_rows = _BLOCK if "cpu" in str(device(like)).lower() else n_feet
        self._blocks = [slice(start, min(start + n_rows, n_feet)) for start in range(0, n_feet, n_rows)]
        self._states = [model.begin(keys[block]) for block in self._blocks]
        self._advance, self._publish = model.advance, model.published
        if is_jax_array(like):
            jit = sys.modules["jax"].jit  # the caller's: the project does not need it
            self._advance, self._publish = jit(model.advance, static_argnums=2), jit(model.published)
        np.empty(_KEPT_BY_MALLOC, np.uint8)
        self._threads, self._blas = ThreadPoolExecutor(os.cpu_count()), ThreadpoolController()
        # Products of a block are too small for threads of their own.
        self._blas_threads = 1 if is_numpy_array(like) else None
        self._start_s, self._t_s, self._t_ns = 0.0, -math.inf, 0
        self._newest: int | None = None
        self._published = self._joined(map(self._publish, self._states))

    def _joined(self, blocks: Iterable[VirtualForces]) -> VirtualForces:
        return VirtualForces(*map(self._xp.concat, zip(*blocks, strict=True)))

    def reset(self, feet: Array) -> None:
        """Lift feet off the ground, tared and drawn anew, for a new episode; they have no force until the next is sent.

        Args:
            feet: Which, a mask of bool, shape (n,).

        Raises:
            ValueError: It is no such mask.
        """
        feet = self._xp.asarray(feet, device=device(self._states[0].force_n))
        if feet.shape != self._shape[:1] or not self._xp.isdtype(feet.dtype, "bool"):
            raise ValueError(
                f"reset: a mask of bool of the {self._shape[0]} feet; got {feet.dtype}, shape {tuple(feet.shape)}"
            )
        self._states = [
            self._model.reset(state, feet[block]) if self._xp.any(feet[block]) else state
            for state, block in zip(self._states, self._blocks, strict=True)
        ]
        self._newest = None

    def step(self, t_s: float, force_n: Array, normal: Array) -> VirtualForces:
        """Return the forces published last by a time, of feet whose contact forces change linearly between the steps.

        Args:
            t_s: Time of the step, after the one before by at most 1 s [s].
            force_n: Ground reaction on each foot in its frame (x forward, y left, z along the leg towards the body)
                [N], shape (n, 3); zero in the air.
            normal: Unit normal of the ground, into the foot, same frame and shape; anything for a foot in the air. One
                that leans farther than the response table reaches gives no force.

        Raises:
            ValueError: The time does not advance or by too much, a shape, type or library is another, or at a loaded
                foot the normal is no unit vector or the force points against it.
        """
        xp, model = self._xp, self._model
        if array_namespace(force_n, normal) is not xp:
            raise ValueError(f"these feet take arrays of {xp.__name__}; `like` is one of another library")
        if not force_n.shape == normal.shape == self._shape:
            raise ValueError(f"{self._shape[0]} feet got forces {force_n.shape} and normals {normal.shape}")
        if not xp.isdtype(force_n.dtype, "real floating"):
            raise ValueError(f"forces of floating point, got {force_n.dtype}")
        is_unit = xp.abs(xp.sum(normal * normal, axis=1) - 1.0) < 1e-3
        if not xp.all(is_unit | xp.all(force_n == 0.0, axis=1)):
            raise ValueError("the normal of the ground at a loaded foot has to be a unit vector")
        if xp.any(xp.sum(force_n * normal, axis=1) < -1e-3 * xp.max(xp.abs(force_n), axis=1)):
            raise ValueError("a force points against its normal: both have to be the ground's, into the foot")
        if math.isinf(self._t_s):
            self._start_s = t_s
        elif not 0.0 < t_s - self._t_s <= _MAX_STEP_S:
            raise ValueError(
                f"a step at {t_s} s does not follow the one at {self._t_s} s within {_MAX_STEP_S:g} s"
            )
        t_ns = round(1e9 * (t_s - self._start_s)) + model.scan.step_ns
        step_ns = t_ns - self._t_ns
        self._t_s, self._t_ns = t_s, t_ns
        length, n = xp.asarray([step_ns], dtype=xp.int32, device=device(force_n)), model.conversions(step_ns)
        # The number of the force that all feet have now, if all have the same.
        newest = (t_ns - self._sent_after_ns) // self._force_ns
        is_new = self._delay_varies or newest != self._newest

        def stepped(state: FeetState, block: slice) -> tuple[FeetState, VirtualForces | None]:
            state = self._advance(state, length, n, force_n[block, :], normal[block, :])
            return state, self._publish(state) if is_new else None

        with self._blas.limit(limits=self._blas_threads):
            blocks = [*self._threads.map(stepped, self._states, self._blocks)]
        self._states = [state for state, _ in blocks]
        if is_new:
            self._published = self._joined(forces for _, forces in blocks if forces is not None)
            self._newest = newest
        else:
            self._published = self._published._replace(age_s=self._published.age_s + 1e-9 * step_ns)
        force_n, sigma_n = (xp.astype(part, force_n.dtype) for part in self._published[:2])
        return self._published._replace(force_n=force_n, sigma_n=sigma_n)
