"""The windowed network: from the last three readings of every element, with their ages, to force and contact.

The foot is read one element after the other, so its readings are never of one time. The network sees, of each
element e, its last three readings v0, v1, v2 (closure over gap, newest first, missing ones imputed) and their ages
a0, a1, a2 at the time for which the load is asked. With the period T = mean of a1 - a0, A = a0 / T and

    d1 = (v0 - v1) T / (a1 - a0),   d2 = d1 - (v1 - v2) T / (a2 - a1),   x = v0 + A d1

it sees per element u = (v0, d1, A d1, d2, A d2, A^2 d2) / r, with r the root mean square of v0 and x over the foot,
and beside them the mask of missing elements, r and ln T. Two hidden layers of tanh follow:

    f = L x + M (x - v0) + (s / r) V h2,     s = |x|^2 / number of elements
    sigma_f = r exp(Q h2 + q),    contact point and friction ratio: C h2,    their sigma: exp(R h2 + c)

No load gives exactly no force. The eight symmetries of the square are built in as in `symmetric_layers.py`: a hidden
channel is eight units, one for each symmetry, that share their weights.

Source:
    Cohen and Welling, Group equivariant convolutional networks, ICML 2016, section 6 (regular representation).
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from footsense.lab.symmetry import SYMMETRIES
from footsense.lab.training.symmetric_layers import (
    N_SYMMETRIES,
    PATTERN_SOFTENING_REL,
    Weights,
    expand_hidden,
    hidden_input_index,
    linear_basis,
)
from footsense.ports import LoadEstimate, Window

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


class LayerMatrices(NamedTuple):
    """Full weight matrices of the network, expanded from the shared weights: a layer is x @ w + b."""

    closure_to_force: Any
    closure_change_to_force: Any
    w1: Any
    b1: Any
    w2: Any
    b2: Any
    out: Any
    sigma: Any
    sigma_offset: Any


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


def element_input_index() -> NDArray[np.intp]:
    """Return for each unit and input the index of the shared weight, shape (8, inputs)."""
    return hidden_input_index(FEATURES_PER_ELEMENT, FEATURES_PER_FOOT)


def output_symmetries() -> NDArray[np.float64]:
    """Return the matrix of each symmetry on the outputs (one 3D, two 2D vectors), shape (8, 7, 7)."""
    turns = np.zeros((N_SYMMETRIES, N_OUTPUTS, N_OUTPUTS))
    for turn, symmetry in zip(turns, SYMMETRIES, strict=True):
        turn[:3, :3] = symmetry
        turn[3:5, 3:5] = turn[5:, 5:] = symmetry[:2, :2]
    return turns


def expand_over_symmetries(weights: Weights) -> LayerMatrices:
    """Return the full weight matrices of the shared weights: unit g * c + i is channel i under symmetry g."""
    turns, basis = output_symmetries(), linear_basis()
    return LayerMatrices(
        closure_to_force=jnp.tensordot(weights.linear[: len(basis)], basis, 1),
        closure_change_to_force=jnp.tensordot(weights.linear[len(basis) :], basis, 1),
        **expand_hidden(weights, FEATURES_PER_ELEMENT, FEATURES_PER_FOOT),
        out=jnp.einsum("gab,cb->gca", turns, weights.out).reshape(-1, N_OUTPUTS),
        sigma=jnp.einsum("gab,cb->gca", np.abs(turns), weights.sigma).reshape(-1, N_OUTPUTS),
        sigma_offset=weights.sigma_offset[SIGMA_ROW_OF_OUTPUT],
    )


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


def run(matrices: LayerMatrices, inputs: Features) -> LoadEstimate:
    """Return the network's estimates of n windows, as JAX arrays."""
    first = jnp.tanh(inputs.hidden_inputs @ matrices.w1 + matrices.b1)
    second = jnp.tanh(first @ matrices.w2 + matrices.b2)
    out = second @ matrices.out
    sigma = jnp.exp(jnp.clip(second @ matrices.sigma + matrices.sigma_offset, *LN_SIGMA_BOUNDS))
    curved = (
        jnp.mean(inputs.extrapolated_closure_rel**2, axis=-1, keepdims=True)
        / inputs.closure_rms_rel
        * out[:, :3]
    )
    return LoadEstimate(
        force_n=inputs.extrapolated_closure_rel @ matrices.closure_to_force
        + (inputs.extrapolated_closure_rel - inputs.newest_closure_rel) @ matrices.closure_change_to_force
        + curved,
        sigma_n=inputs.closure_rms_rel * sigma[:, :3],
        contact_point_and_friction=out[:, 3:],
        contact_sigma=sigma[:, 3:],
    )


def predict(weights: Weights, window: Window) -> LoadEstimate:
    """Return the network's load estimates for n windows, in float32 arithmetic."""
    load = jax.jit(_run_weights)(weights, *(np.asarray(part, np.float32) for part in window))
    return LoadEstimate(*(np.asarray(part, dtype=np.float64) for part in load))


def _run_weights(weights: Weights, closure_rel: Any, age_s: Any, missing: Any) -> LoadEstimate:
    return run(expand_over_symmetries(weights), features(closure_rel, age_s, missing))
