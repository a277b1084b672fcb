"""The windowed network: from the last three readings of every element, with their ages, to force and contact.

The foot is read one element after the other, so its readings are never of one time. The network sees, of each
element e, its last three readings v0, v1, v2 (closure over gap, newest first, missing ones imputed) and their ages
a0, a1, a2 at the time for which the load is asked. With the period T = mean of a1 - a0, A = a0 / T and

    d1 = (v0 - v1) T / (a1 - a0),   d2 = d1 - (v1 - v2) T / (a2 - a1),   x = v0 + A d1

it sees per element u = (v0, d1, A d1, d2, A d2, A^2 d2) / r, with r the root mean square of v0 and x over the foot,
and beside them the mask of missing elements, r and ln T. Two hidden layers of tanh follow:

    f = L x + M (x - v0) + (s / r) V h2,     s = |x|^2 / number of elements
    sigma_f = r exp(Q h2 + q),    contact point and friction ratio: C h2,    their sigma: exp(R h2 + c)

No load gives exactly no force. The eight symmetries of the square are built in: a hidden channel is eight
units, one for each symmetry, that share their weights. Unit g applies them to the inputs mapped by the inverse of
symmetry g; units of the second layer see those of the first by their relative symmetry. That map is computed on the
irreducible parts of the symmetries, four scalars and twice a vector of the plane, a fifth of the products.

Source:
    Cohen and Welling, Group equivariant convolutional networks, ICML 2016, section 6 (regular representation).
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from footsense.frames import ELEMENTS, Vector
from footsense.lab.symmetry import SYMMETRIES, element_permutation
from footsense.ports import LoadEstimate, Window

#: Size e below which a pattern means little [1 of the gap]: 40 nm of 20 um.
PATTERN_SOFTENING_REL = 2e-3
#: Symmetries of the square.
N_SYMMETRIES = len(SYMMETRIES)
#: Readings of an element in a window.
READINGS_PER_ELEMENT = 3
#: Features of an element and of the foot: six of its readings, its mask; size, period.
FEATURES_PER_ELEMENT, FEATURES_PER_FOOT = 7, 2
#: Outputs: force, contact point, friction ratio.
N_OUTPUTS = 7
#: Row of `Weights.sigma_offset` of each output: axes that the square exchanges share one.
SIGMA_ROW_OF_OUTPUT = np.array([0, 0, 1, 2, 2, 3, 3])
#: Largest feature of an element [1]: a step of the load is not larger, a corrupt reading is.
MAX_FEATURE = 4.0
#: Period of a scan that has the feature 0 [s].
ZERO_FEATURE_SCAN_PERIOD_S = 0.02445
#: Bounds of ln sigma over its scale.
LN_SIGMA_BOUNDS = (-8.0, 3.0)
#: Least time between two readings of an element [s]; a foot's first reading stands for those before it.
MIN_READING_INTERVAL_S = 1e-4


class Weights(NamedTuple):
    """Trained weights of the windowed network, with `c` channels in each hidden layer.

    Its outputs are force, contact point and friction ratio.

    Attributes:
        linear: Linear paths [N], a weight for each map of `linear_basis`, of the paths L, then M.
        w1: First hidden layer, shape (c, inputs).
        b1: Offsets of the first layer, shape (c,).
        w2: Second hidden layer by relative symmetry, shape (c, 8 c), the symmetry slow.
        b2: Offsets of the second layer, shape (c,).
        out: Output layer, shape (c, outputs).
        sigma: Output layer of ln sigma, shape (c, outputs).
        sigma_offset: Offsets of ln sigma of the force sideways, along z, of contact point and of friction ratio, shape
            (4,): axes that the square exchanges share one.
    """

    linear: Any
    w1: Any
    b1: Any
    w2: Any
    b2: Any
    out: Any
    sigma: Any
    sigma_offset: Any

    @property
    def n_weights(self) -> int:
        """Number of trained weights."""
        return sum(int(part.size) for part in self)

    @property
    def channels(self) -> int:
        """Number of channels in a hidden layer."""
        return int(self.b1.size)


def element_input_index() -> NDArray[np.intp]:
    """Return for each unit and input the index of the shared weight, shape (8, inputs)."""
    inverse = np.argsort(np.stack([element_permutation(g) for g in SYMMETRIES]), axis=1)
    planes = [ELEMENTS * plane + inverse for plane in range(FEATURES_PER_ELEMENT)]
    scalars = np.tile(ELEMENTS * FEATURES_PER_ELEMENT + np.arange(FEATURES_PER_FOOT), (N_SYMMETRIES, 1))
    return np.concatenate([*planes, scalars], axis=1).astype(np.intp)


def irreducible_parts() -> tuple[Vector, Vector, Vector]:
    """Return the irreducible representations of the square's symmetries, and the transform to their parts.

    Returns:
        The four scalar ones, shape (4, 8); that of vectors in the plane, row b and column k of each matrix, shape
        (2, 2, 8); and the orthonormal transform of eight units to four scalar parts and four entries (a, k) of the
        vector ones, shape (8, 8).
    """
    plane = np.stack(SYMMETRIES)[:, :2, :2]
    turns, swaps = np.linalg.det(plane).round(), 2.0 * np.abs(plane[:, 0, 0]) - 1.0
    scalars = np.stack([np.ones(N_SYMMETRIES), turns, swaps, turns * swaps])
    vectors = plane.transpose(1, 2, 0)
    rows = np.concatenate([scalars, np.sqrt(2.0) * vectors.reshape(4, N_SYMMETRIES)])
    return scalars, vectors, rows / np.sqrt(N_SYMMETRIES)


def linear_basis() -> NDArray[np.float64]:
    """Return the basis of linear maps from closures to force with the square's symmetry, (maps, elements, 3).

    Elements that the symmetries exchange share their weights. First come the maps to fz, one for each group of such
    elements, then those to fx and fy: none of the central element, one of each other group.
    """
    images = np.stack([element_permutation(g) for g in SYMMETRIES])
    fz_maps: list[NDArray[np.float64]] = []
    fxy_maps: list[NDArray[np.float64]] = []
    for first in np.unique(images.min(axis=0)):
        basis = np.zeros((3, ELEMENTS, 3))
        basis[2, images[:, first], 2] = 1.0
        fz_maps.append(basis[2])
        # fx and fy from one element, turned in all directions.
        for g, image in zip(SYMMETRIES, images, strict=True):
            basis[:2, image[first]] += 0.5 * g[:, :2].T
        one, other = basis[:2]
        fxy_maps.extend([one] if np.array_equal(one, other) else [one, other])
    return np.stack([*fz_maps, *(part for part in fxy_maps if part.any())])


def random_weights(key: jax.Array, c: int) -> Weights:
    """Return random initial weights; the linear path starts at zero, as a correction to least squares."""
    n_inputs = FEATURES_PER_ELEMENT * ELEMENTS + FEATURES_PER_FOOT
    k1, k2, k3, k4 = jax.random.split(key, 4)
    return Weights(
        linear=jnp.zeros(2 * len(linear_basis())),
        w1=jax.random.normal(k1, (c, n_inputs)) / np.sqrt(12.0),
        b1=0.5 * jax.random.normal(k2, (c,)),
        w2=jax.random.normal(k3, (c, 8 * c)) / np.sqrt(8.0 * c),
        b2=jnp.zeros(c),
        out=0.3 * jax.random.normal(k4, (c, 7)) / np.sqrt(8.0 * c),
        sigma=jnp.zeros((c, 7)),
        sigma_offset=jnp.array([-3.0, -4.0, -2.5, -2.0]),
    )


def mean_closure_product_matrix(closure_rel: Vector) -> Vector:
    """Return second moments of closures over their rms, averaged over symmetries, shape (elements, elements)."""
    size = np.sqrt(np.mean(closure_rel**2, axis=-1, keepdims=True) + PATTERN_SOFTENING_REL**2)
    pattern = closure_rel / size
    plain = pattern.T @ pattern / len(pattern)
    maps = [element_permutation(g) for g in SYMMETRIES]
    even: Vector = np.mean([plain[np.ix_(m, m)] for m in maps], axis=0) + 1e-7 * np.eye(ELEMENTS)
    return even


class Features(NamedTuple):
    """Input features of the network for n windows.

    Attributes:
        hidden_inputs: Inputs of the first hidden layer, shape (n, SEEN).
        extrapolated_closure_rel: Readings moved to the asked time along their slope [1], shape (n, elements).
        newest_closure_rel: Newest readings [1], shape (n, elements).
        closure_rms_rel: Root mean square of the closures [1], shape (n, 1).
    """

    hidden_inputs: Any
    extrapolated_closure_rel: Any
    newest_closure_rel: Any
    closure_rms_rel: Any


def output_symmetries() -> NDArray[np.float64]:
    """Return the matrix of each symmetry on the outputs (one 3D, two 2D vectors), shape (8, 7, 7)."""
    turns = np.zeros((N_SYMMETRIES, N_OUTPUTS, N_OUTPUTS))
    for turn, symmetry in zip(turns, SYMMETRIES, strict=True):
        turn[:3, :3] = symmetry
        turn[3:5, 3:5] = turn[5:, 5:] = symmetry[:2, :2]
    return turns


def features(closure_rel: Any, age_s: Any, missing: Any, module: Any = jnp) -> Features:
    """Return the network's input features of n windows.

    Args:
        closure_rel: Closures over the gap, newest first, missing ones imputed [1], shape (n, 3, elements).
        age_s: Ages of the readings [s], shape (n, 3, elements).
        missing: One for each element that is missing, else zero, shape (n, elements).
        module: `jax.numpy` or `numpy`.
    """
    v0, v1, v2 = (closure_rel[:, k] for k in range(READINGS_PER_ELEMENT))
    first_s = module.maximum(age_s[:, 1] - age_s[:, 0], MIN_READING_INTERVAL_S)
    second_s = module.maximum(age_s[:, 2] - age_s[:, 1], MIN_READING_INTERVAL_S)
    period_s = first_s.mean(axis=-1, keepdims=True)
    age = age_s[:, 0] / period_s
    d1 = (v0 - v1) * (period_s / first_s)
    d2 = d1 - (v1 - v2) * (period_s / second_s)
    now = v0 + age * d1
    size = module.sqrt((v0 * v0 + now * now).mean(axis=-1, keepdims=True) / 2.0 + PATTERN_SOFTENING_REL**2)
    planes = module.concatenate([v0, d1, age * d1, d2, age * d2, age * age * d2], axis=-1) / size
    planes = module.minimum(module.maximum(planes, -MAX_FEATURE), MAX_FEATURE)
    scalars = [size, module.log(period_s / ZERO_FEATURE_SCAN_PERIOD_S)]
    return Features(module.concatenate([planes, missing, *scalars], axis=-1), now, v0, size)


def run(weights: Weights, inputs: Features) -> LoadEstimate:
    """Return the network's estimates of n windows, as JAX arrays: unit g * c + i is channel i under symmetry g."""
    turns, basis = output_symmetries(), linear_basis()
    closure_to_force = jnp.tensordot(weights.linear[: len(basis)], basis, 1)
    closure_change_to_force = jnp.tensordot(weights.linear[len(basis) :], basis, 1)
    w1 = weights.w1[:, element_input_index()]  # (c, 8, inputs)
    w1 = jnp.transpose(w1, (2, 1, 0)).reshape(w1.shape[-1], -1)
    first = jnp.tanh(inputs.hidden_inputs @ w1 + jnp.tile(weights.b1, N_SYMMETRIES))
    mapped = _mapped_by_relative_symmetry(weights.w2.reshape(-1, N_SYMMETRIES, weights.channels), first)
    second = jnp.tanh(mapped + jnp.tile(weights.b2, N_SYMMETRIES))
    out = second @ jnp.einsum("gab,cb->gca", turns, weights.out).reshape(-1, N_OUTPUTS)
    to_sigma = jnp.einsum("gab,cb->gca", np.abs(turns), weights.sigma).reshape(-1, N_OUTPUTS)
    ln_sigma = second @ to_sigma + weights.sigma_offset[SIGMA_ROW_OF_OUTPUT]
    sigma = jnp.exp(jnp.clip(ln_sigma, *LN_SIGMA_BOUNDS))
    now, newest, size = inputs.extrapolated_closure_rel, inputs.newest_closure_rel, inputs.closure_rms_rel
    curved = jnp.mean(now**2, axis=-1, keepdims=True) / size * out[:, :3]
    return LoadEstimate(
        force_n=now @ closure_to_force + (now - newest) @ closure_change_to_force + curved,
        sigma_n=size * sigma[:, :3],
        contact_point_and_friction=out[:, 3:],
        contact_sigma=sigma[:, 3:],
    )


def _mapped_by_relative_symmetry(w2: Any, units: Any) -> Any:
    """Return the units of the first layer, shape (n, 8 c), times the weights by relative symmetry, shape (c, 8, c).

    A map that the symmetries leave alone maps irreducible parts among their equals: twelve products of c x c weights in
    place of the 64 of the full matrix.
    """
    scalars_by, vectors_by, to_parts = (part.astype(np.float32) for part in irreducible_parts())
    c = w2.shape[0]
    w2_scalars = jnp.einsum("fg,ogi->fio", scalars_by, w2)
    w2_vectors = jnp.einsum("bkg,ogi->kibo", vectors_by, w2).reshape(2 * c, 2 * c)
    parts = jnp.einsum("fg,ngi->fni", to_parts, units.reshape(-1, N_SYMMETRIES, c))
    scalars = parts[:4] @ w2_scalars
    rows = parts[4:].reshape(2, 2, -1, c).transpose(0, 2, 1, 3).reshape(-1, 2 * c)
    vectors = (rows @ w2_vectors).reshape(2, -1, 2, c).transpose(0, 2, 1, 3).reshape(4, -1, c)
    mapped = jnp.einsum("fg,fni->ngi", to_parts, jnp.concatenate([scalars, vectors]))
    return mapped.reshape(-1, N_SYMMETRIES * c)


def predict(weights: Weights, window: Window) -> LoadEstimate:
    """Return the network's load estimates for n windows, in float32 arithmetic."""
    load = jax.jit(_run_weights)(weights, *(np.asarray(part, np.float32) for part in window))
    return LoadEstimate(*(np.asarray(part, dtype=np.float64) for part in load))


def _run_weights(weights: Weights, closure_rel: Any, age_s: Any, missing: Any) -> LoadEstimate:
    return run(weights, features(closure_rel, age_s, missing))
