"""Training of the network: Muon on random batches, one-cycle schedule, all random draws from one seed.

Muon orthogonalises the step of each matrix (the rest goes by Adam), so that weak patterns are learnt as fast as strong
ones. Every batch draws its own noise and its own missing elements.

The loss is the likelihood of the error under the network's sigma, so that cases which noise or a missing row makes
ambiguous do not dominate it; tempered, and with a share of the plain squared error over the squared force, so that
they still count. Inputs of the hidden layers are whitened while training, because the patterns that distinguish
friction from inclination are a hundred times weaker than those of the force; the whitening is then folded into W1. The
linear path starts at the least-squares read-out.

Source:
    Seitzer et al., On the pitfalls of heteroscedastic uncertainty estimation with probabilistic neural networks, ICLR
    2022, for the tempering.
"""

from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from numpy.typing import NDArray

from footsense.estimation.faults.imputation import Imputation
from footsense.foot.capacitor import EPS0_PF_UM_PER_MM2, CapacitorDesign
from footsense.lab.symmetry import SYMMETRIES, element_map
from footsense.lab.training.load_cases import BASELINE_NOISE_PF, NOISE_PF, Cases
from footsense.lab.training.snapshot.network import N_INPUTS, Weights, expand, hidden_input, linear_basis, run

Vector = NDArray[np.float64]

#: Masks of missing elements: none, one element, a row, a column; shape (16, 9).
MASKS: NDArray[np.bool_] = np.array(
    [np.zeros(9, bool)]
    + [np.arange(9) == e for e in range(9)]
    + [np.arange(9) // 3 == row for row in range(3)]
    + [np.arange(9) % 3 == column for column in range(3)]
)
#: Share of the training cases with something missing.
_MISSING_SHARE = 0.15
#: Tempering of the likelihood by a case's own sigma, the beta of Seitzer et al.: 0 is the likelihood, which neglects
#: hard cases; 1 is the squared error, which they dominate.
_TEMPERING = 0.25
#: Weight of the squared error over the squared force beside it.
_SQUARED_ERROR_WEIGHT = 100.0
#: Steps that are compiled into one call.
_STEPS_PER_CALL = 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class Protocol:
    """How a network is trained.

    Attributes:
        channels: Channels of each of the two hidden layers, eight units each.
        steps: Steps, a multiple of 1000.
        batch: Cases in a step.
        rate: Highest learning rate.
        min_force_n: Force below which errors count absolutely [N].
        noise_rel: Noise of the training inputs over the converter's [1].
        masked: Whether elements may be missing.
        seed: Seed of start weights, batches, noise and masks.
    """

    channels: int = 14
    steps: int = 120_000
    batch: int = 512
    rate: float = 1e-2
    min_force_n: float = 0.3
    noise_rel: float = 1.0
    masked: bool = True
    seed: int = 20090304

    def card(self) -> dict[str, Any]:
        """Return the protocol as JSON values."""
        return {"optimiser": "muon, cosine one-cycle", **asdict(self)}


def moments(closure_rel: Vector) -> Vector:
    """Return the second moments of the patterns of closures, with the square's symmetry, shape (9, 9)."""
    pattern = hidden_input(closure_rel)[:, :9]
    plain = pattern.T @ pattern / len(pattern)
    maps = [element_map(g) for g in SYMMETRIES]
    even: Vector = np.mean([plain[np.ix_(m, m)] for m in maps], axis=0) + 1e-7 * np.eye(9)
    return even


def linear_start(closure_rel: Vector, force_n: Vector, min_force_n: float) -> Vector:
    """Return the least-squares linear path [N], shape (5,), weighted like the loss."""
    weight = 1.0 / np.sqrt((force_n**2).sum(axis=1, keepdims=True) + min_force_n**2)
    columns = np.einsum("ne,beo->nob", closure_rel * weight, linear_basis())
    solution: Vector = np.linalg.lstsq(columns.reshape(-1, 5), (force_n * weight).ravel(), rcond=None)[0]
    return solution


def _random_weights(key: jax.Array, c: int) -> Weights:
    """Return random weights; the linear path is a correction to its start and begins at zero."""
    k1, k2, k3, k4 = jax.random.split(key, 4)
    return Weights(
        linear=jnp.zeros(5),
        w1=jax.random.normal(k1, (c, N_INPUTS)) / np.sqrt(10.0),
        b1=0.5 * jax.random.normal(k2, (c,)),
        w2=jax.random.normal(k3, (c, 8 * c)) / np.sqrt(8.0 * c),
        b2=jnp.zeros(c),
        force=0.3 * jax.random.normal(k4, (c, 3)) / np.sqrt(8.0 * c),
        sigma=jnp.zeros((c, 3)),
        sigma_offset=jnp.array([-3.0, -4.0]),
    )


def _whitening(closure_rel: Vector) -> tuple[jax.Array, jax.Array]:
    """Return the matrix (19, 19) and mean (19,) that make pattern and size white; both have the square's symmetry."""
    seen = hidden_input(closure_rel)
    maps = [np.append(element_map(g), 9) for g in SYMMETRIES]
    mean = np.mean([seen.mean(axis=0)[m] for m in maps], axis=0)
    covariance = np.cov(seen.T)
    covariance = np.mean([covariance[np.ix_(m, m)] for m in maps], axis=0)
    variance, axes = np.linalg.eigh(covariance)
    square_root = (axes / np.sqrt(np.maximum(variance, 1e-8))) @ axes.T
    place = np.r_[0:9, N_INPUTS - 1]
    whiten, shift = np.eye(N_INPUTS), np.zeros(N_INPUTS)
    whiten[np.ix_(place, place)], shift[place] = square_root, mean
    return jnp.asarray(whiten, jnp.float32), jnp.asarray(shift, jnp.float32)


class _Task(NamedTuple):
    """Constants of a training run: load cases, masks of missing elements and noise."""

    closure_rel: jax.Array
    force_n: jax.Array
    fill: jax.Array
    masks: jax.Array
    noise_rel: float
    film_rel: float


def _task(cases: Cases, design: CapacitorDesign, protocol: Protocol, imputation: Imputation) -> _Task:
    """Return the cases, their noise and their masks as JAX arrays."""
    plates_um = EPS0_PF_UM_PER_MM2 * design.electrode_area_mm2
    noise_pf = np.hypot(NOISE_PF, BASELINE_NOISE_PF) * protocol.noise_rel
    return _Task(
        closure_rel=jnp.asarray(cases.closure_um / design.gap_um, jnp.float32),
        force_n=jnp.asarray(cases.force_n, jnp.float32),
        fill=jnp.asarray(np.stack([imputation.matrix(mask) for mask in MASKS]), jnp.float32),
        masks=jnp.asarray(MASKS, jnp.float32),
        # A noise of the capacitance is one of the distance by distance^2 / (eps0 A); all over the gap.
        noise_rel=float(noise_pf * design.gap_um / plates_um),
        film_rel=design.film_equivalent_um / design.gap_um,
    )


def _random_batch(task: _Task, protocol: Protocol, key: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Return closures (noisy, filled), masks and forces of a random batch."""
    k1, k2, k3, k4 = jax.random.split(key, 4)
    chosen = jax.random.randint(k1, (protocol.batch,), 0, len(task.force_n))
    exact = task.closure_rel[chosen]
    noisy = exact + task.noise_rel * (1.0 + task.film_rel - exact) ** 2 * jax.random.normal(k2, exact.shape)
    if not protocol.masked:
        return noisy, jnp.zeros_like(noisy), task.force_n[chosen]
    which = jax.random.randint(k3, (protocol.batch,), 1, len(task.masks))
    which = jnp.where(jax.random.uniform(k4, which.shape) < _MISSING_SHARE, which, 0)
    return jnp.einsum("nab,nb->na", task.fill[which], noisy), task.masks[which], task.force_n[chosen]


def train(
    cases: Cases, design: CapacitorDesign, protocol: Protocol, imputation: Imputation | None = None
) -> Weights:
    """Train the equivariant network on random loads.

    Args:
        cases: Loads and exact closures; symmetric copies are not needed.
        design: The capacitors, for the noise.
        protocol: Sizes, steps and seed.
        imputation: Imputation of missing elements; from the cases if None.

    Returns:
        The weights, float32.
    """
    closure_rel = cases.closure_um / design.gap_um
    imputation = imputation or Imputation(moments(closure_rel))
    task = _task(cases, design, protocol, imputation)
    whiten, mean = _whitening(closure_rel)
    linear = jnp.asarray(linear_start(closure_rel, cases.force_n, protocol.min_force_n), jnp.float32)

    def fold_whitening(free: Weights) -> Weights:
        w1 = free.w1 @ whiten
        return free._replace(linear=linear + free.linear, w1=w1, b1=free.b1 - w1 @ mean)

    def loss(free: Weights, x: jax.Array, m: jax.Array, f: jax.Array) -> jax.Array:
        force, sigma = run(expand(fold_whitening(free)), x, m)
        square = (force - f) ** 2
        scale = jnp.sqrt(jnp.sum(f**2, axis=-1, keepdims=True) + protocol.min_force_n**2)
        weight = jax.lax.stop_gradient(sigma / scale) ** (2.0 * _TEMPERING)
        likelihood = jnp.log(sigma) + 0.5 * square / sigma**2
        return jnp.mean(weight * likelihood) + _SQUARED_ERROR_WEIGHT * jnp.mean(square / scale**2)

    schedule = optax.cosine_onecycle_schedule(protocol.steps, protocol.rate, pct_start=0.1)
    optimiser = optax.contrib.muon(schedule)

    def step(carry: tuple[Weights, Any], key: jax.Array) -> tuple[tuple[Weights, Any], None]:
        free, state = carry
        gradient = jax.grad(loss)(free, *_random_batch(task, protocol, key))
        change, state = optimiser.update(gradient, state, free)
        return (optax.apply_updates(free, change), state), None

    def train_chunk(carry: tuple[Weights, Any], key: jax.Array) -> tuple[Weights, Any]:
        after: tuple[Weights, Any] = jax.lax.scan(step, carry, jax.random.split(key, _STEPS_PER_CALL))[0]
        return after

    start, *rounds = jax.random.split(
        jax.random.PRNGKey(protocol.seed), 1 + protocol.steps // _STEPS_PER_CALL
    )
    free = _random_weights(start, protocol.channels)
    carry = (free, optimiser.init(free))
    compiled = jax.jit(train_chunk)
    for key in rounds:
        carry = compiled(carry, key)
    return fold_whitening(carry[0])


def predict(
    weights: Weights, closure_rel: Vector, missing: NDArray[np.bool_] | None = None
) -> tuple[Vector, Vector]:
    """Return the estimated forces and their sigma [N], shape (n, 3) each, in float32 arithmetic.

    Args:
        weights: The network.
        closure_rel: Closures over the gap, missing ones filled in, shape (n, 9).
        missing: Mask of the missing ones, shape (n, 9); none if None.
    """
    mask = jnp.zeros(closure_rel.shape) if missing is None else jnp.asarray(missing, jnp.float32)
    force, sigma = run(expand(weights), jnp.asarray(closure_rel, jnp.float32), mask)
    return np.asarray(force, dtype=np.float64), np.asarray(sigma, dtype=np.float64)
