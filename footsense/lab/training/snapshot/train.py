"""Training of the snapshot network on steady load cases."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from footsense.estimation.missing_elements import MISSING_SETS, Imputation
from footsense.foot.capacitor import EPS0_PF_UM_PER_MM2, CapacitorDesign
from footsense.frames import ELEMENTS, Vector
from footsense.lab.symmetry import SYMMETRIES, element_permutation
from footsense.lab.training.fit import (
    TrainingSettings,
    fit,
    fit_linear_start,
    force_likelihood_loss,
    whitening_transform,
)
from footsense.lab.training.load_cases import BASELINE_NOISE_PF, NOISE_PF, Cases
from footsense.lab.training.snapshot.network import (
    FEATURES_PER_ELEMENT,
    FEATURES_PER_FOOT,
    Weights,
    expand_over_symmetries,
    hidden_layer_input,
    run,
)
from footsense.lab.training.symmetric_layers import hidden_input_index, linear_basis

#: Share of the training cases with something missing.
_CASES_WITH_MISSING_SHARE = 0.15
#: Weight of the squared error over the squared force beside the likelihood.
_SQUARED_ERROR_WEIGHT = 100.0
#: Steps that are compiled into one call.
_STEPS_PER_CALL = 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class SnapshotTrainingSettings(TrainingSettings):
    """Training settings of a snapshot network.

    Attributes:
        noise_rel: Noise of the training inputs over the converter's [1].
        masked: Whether elements may be missing.
    """

    channels: int = 14
    steps: int = 120_000
    batch: int = 512
    rate: float = 1e-2
    noise_rel: float = 1.0
    masked: bool = True


def mean_closure_product_matrix(closure_rel: Vector) -> Vector:
    """Return second moments of closures over their rms, averaged over symmetries, shape (elements, elements)."""
    pattern = hidden_layer_input(closure_rel)[:, :ELEMENTS]
    plain = pattern.T @ pattern / len(pattern)
    maps = [element_permutation(g) for g in SYMMETRIES]
    even: Vector = np.mean([plain[np.ix_(m, m)] for m in maps], axis=0) + 1e-7 * np.eye(ELEMENTS)
    return even


def _random_weights(key: jax.Array, c: int) -> Weights:
    """Return random initial weights; the linear path starts at zero, as a correction to least squares."""
    k1, k2, k3, k4 = jax.random.split(key, 4)
    n_inputs = FEATURES_PER_ELEMENT * ELEMENTS + FEATURES_PER_FOOT
    return Weights(
        linear=jnp.zeros(len(linear_basis())),
        w1=jax.random.normal(k1, (c, n_inputs)) / np.sqrt(10.0),
        b1=0.5 * jax.random.normal(k2, (c,)),
        w2=jax.random.normal(k3, (c, 8 * c)) / np.sqrt(8.0 * c),
        b2=jnp.zeros(c),
        out=0.3 * jax.random.normal(k4, (c, 3)) / np.sqrt(8.0 * c),
        sigma=jnp.zeros((c, 3)),
        sigma_offset=jnp.array([-3.0, -4.0]),
    )


class _TrainingConstants(NamedTuple):
    """Constants of a training run: load cases, masks of missing elements and noise."""

    closure_rel: jax.Array
    force_n: jax.Array
    imputation_matrices: jax.Array
    missing_masks: jax.Array
    closure_noise_rel: float
    film_thickness_rel: float


def _training_constants(
    cases: Cases, design: CapacitorDesign, settings: SnapshotTrainingSettings, imputation: Imputation
) -> _TrainingConstants:
    """Return load cases, noise and missing-element masks as JAX arrays."""
    plates_um = EPS0_PF_UM_PER_MM2 * design.electrode_area_mm2
    noise_pf = np.hypot(NOISE_PF, BASELINE_NOISE_PF) * settings.noise_rel
    return _TrainingConstants(
        closure_rel=jnp.asarray(cases.closure_um / design.gap_um, jnp.float32),
        force_n=jnp.asarray(cases.force_n, jnp.float32),
        imputation_matrices=jnp.asarray(
            np.stack([imputation.matrix(mask) for mask in MISSING_SETS]), jnp.float32
        ),
        missing_masks=jnp.asarray(MISSING_SETS, jnp.float32),
        # A noise of the capacitance is one of the distance by distance^2 / (eps0 A); all over the gap.
        closure_noise_rel=float(noise_pf * design.gap_um / plates_um),
        film_thickness_rel=design.film_equivalent_um / design.gap_um,
    )


def _random_batch(
    data: _TrainingConstants, settings: SnapshotTrainingSettings, key: jax.Array
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Return noisy closures with missing ones imputed, masks and true forces of a random batch."""
    k1, k2, k3, k4 = jax.random.split(key, 4)
    chosen = jax.random.randint(k1, (settings.batch,), 0, len(data.force_n))
    exact = data.closure_rel[chosen]
    noisy = exact + data.closure_noise_rel * (1.0 + data.film_thickness_rel - exact) ** 2 * jax.random.normal(
        k2, exact.shape
    )
    if not settings.masked:
        return noisy, jnp.zeros_like(noisy), data.force_n[chosen]
    which = jax.random.randint(k3, (settings.batch,), 1, len(data.missing_masks))
    which = jnp.where(jax.random.uniform(k4, which.shape) < _CASES_WITH_MISSING_SHARE, which, 0)
    return (
        jnp.einsum("nab,nb->na", data.imputation_matrices[which], noisy),
        data.missing_masks[which],
        data.force_n[chosen],
    )


def train(
    cases: Cases,
    design: CapacitorDesign,
    settings: SnapshotTrainingSettings,
    imputation: Imputation | None = None,
) -> Weights:
    """Train the snapshot network on load cases; return its weights.

    Args:
        cases: Loads and exact closures; symmetric copies are not needed.
        design: The capacitors, for the noise.
        settings: Sizes, steps and seed.
        imputation: Imputation of missing elements; from the cases if None.

    Returns:
        The weights, float32.
    """
    closure_rel = cases.closure_um / design.gap_um
    imputation = imputation or Imputation(mean_closure_product_matrix(closure_rel))
    task = _training_constants(cases, design, settings, imputation)
    place = np.r_[0:ELEMENTS, FEATURES_PER_ELEMENT * ELEMENTS]
    index = hidden_input_index(FEATURES_PER_ELEMENT, FEATURES_PER_FOOT)
    whiten, mean = whitening_transform(hidden_layer_input(closure_rel), index, place, 1e-8)
    linear = fit_linear_start((closure_rel,), cases.force_n, settings.min_force_n)

    def fold_whitening(free: Weights) -> Weights:
        """Return the weights with the input whitening folded into the first layer."""
        w1 = free.w1 @ whiten
        return free._replace(linear=linear + free.linear, w1=w1, b1=free.b1 - w1 @ mean)

    def loss(free: Weights, batch: tuple[jax.Array, jax.Array, jax.Array]) -> jax.Array:
        """Return the training loss of a batch."""
        closures, missing, true_n = batch
        force_n, sigma_n = run(expand_over_symmetries(fold_whitening(free)), closures, missing)
        return force_likelihood_loss(force_n, sigma_n, true_n, settings.min_force_n, _SQUARED_ERROR_WEIGHT)

    def random_batch(task: _TrainingConstants, key: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Return a random training batch."""
        return _random_batch(task, settings, key)

    def first_weights(key: jax.Array, c: int) -> Weights:
        """Return random initial weights."""
        return _random_weights(key, c)

    return fold_whitening(fit(first_weights, loss, random_batch, task, settings, _STEPS_PER_CALL))


def predict(
    weights: Weights, closure_rel: Vector, missing: NDArray[np.bool_] | None = None
) -> tuple[Vector, Vector]:
    """Return the estimated forces and their sigma [N], shape (n, 3) each, in float32 arithmetic.

    Args:
        weights: The network.
        closure_rel: Closures over the gap, missing ones filled in, shape (n, elements).
        missing: Mask of the missing ones, shape (n, elements); none if None.
    """
    mask = np.zeros(closure_rel.shape) if missing is None else missing
    force, sigma = jax.jit(_run_weights)(
        weights, np.asarray(closure_rel, np.float32), np.asarray(mask, np.float32)
    )
    return np.asarray(force, dtype=np.float64), np.asarray(sigma, dtype=np.float64)


def _run_weights(weights: Weights, closure_rel: Any, missing: Any) -> tuple[jax.Array, jax.Array]:
    return run(expand_over_symmetries(weights), closure_rel, missing)
