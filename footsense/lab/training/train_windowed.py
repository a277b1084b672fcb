"""Training of the windowed network by Muon on random windows of gaits and of steady loads, from one seed.

Every batch draws its windows, its noise and its missing elements. A share of the windows is of steady loads, drawn
from the wide loads of `load_cases`, whose readings differ by noise alone. Beside the force, contact point and friction
ratio are learnt where the foot carries a load. Muon orthogonalises the step of each matrix (the rest goes by Adam), so
that weak patterns are learnt as fast as strong ones; the rate follows a one-cycle schedule.

The loss is the likelihood of the error under the network's sigma, so that cases which noise or a missing row makes
ambiguous do not dominate it; tempered, and with a share of the plain squared error over the squared force, so that
they still count. Inputs of the hidden layers are whitened while training, because the patterns that distinguish
friction from inclination are a hundred times weaker than those of the force; the whitening is then folded into the
first layer. The linear path starts at the least-squares estimator.

Source:
    Seitzer et al., On the pitfalls of heteroscedastic uncertainty estimation with probabilistic neural networks, ICLR
    2022, for the tempering.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from numpy.typing import NDArray

from footsense.estimation.missing_elements import MISSING_SETS, Imputation
from footsense.foot.capacitor import EPS0_PF_UM_PER_MM2, Capacitor
from footsense.frames import ELEMENTS, ROWS, Vector
from footsense.lab.training.descent import descend
from footsense.lab.training.gait_readings import (
    AD7147_STAGE_S,
    PACE_REL,
    STEP_S,
    GaitReadings,
    nominal_send_delay_s,
)
from footsense.lab.training.gait_windows import (
    complete_window_ends,
    contact_and_normal_force,
    readings_since,
    readings_since_table,
)
from footsense.lab.training.load_cases import BASELINE_NOISE_PF, NOISE_PF, LeaningCases
from footsense.lab.training.windowed_network import (
    FEATURES_PER_ELEMENT,
    FEATURES_PER_FOOT,
    READINGS_PER_ELEMENT,
    Features,
    Weights,
    element_input_index,
    features,
    linear_basis,
    random_weights,
    run,
)
from footsense.progress import progress_bar

#: Share of the windows with something missing, and of those of steady loads.
_WINDOWS_WITH_MISSING_SHARE, _STEADY_WINDOWS_SHARE = 0.25, 0.2
#: How often each set of `MISSING_SETS` is missing, over the others: a column is a converter that does not answer.
_MISSING_SET_WEIGHTS = np.repeat([0.0, 1.0, 1.0, 3.0], [1, ELEMENTS, ROWS, ROWS])
#: Share of the steady windows that are read at any pace and in any order, and of those with friction: few of the loads
#: have much, and they are the hard ones. Friction ratio from which a load counts as one [1].
_PACED_SHARE, _FRICTION_SHARE, _FRICTION_REL = 0.4, 0.4, 0.1
#: Weight of the squared error over the squared force beside the likelihood; were it larger, sudden steps, which nothing
#: can tell, would dominate.
_SQUARED_ERROR_WEIGHT = 10.0
#: Force below which errors count absolutely [N], of a full load of 2 N.
_MIN_FORCE_N = 0.3
#: Weight of contact point and friction ratio, and normal force from which they are learnt [N].
_CONTACT_WEIGHT, _LOADED_N = 0.25, 0.02
#: Shares of the windows in the air, just after lift-off and long after, that are used.
_JUST_LIFTED_SHARE, _AIR_SHARE = 0.4, 0.15
#: Weight of what an error exceeds so many of its sigmas by: errors have longer tails than a normal distribution, and a
#: controller trusts sigma in them.
_TAIL_WEIGHT, _TAIL_SIGMAS = 2.0, 3.0
#: Weight of the angle between a force and the true one [1/rad], and of the error of the size over that; force from
#: which they count, and size of the forces that have no direction [N]. With 12 in place of 3 the mean angle over random
#: gaits and robots is 5 % less; with 60, and fewer steady windows, 11 %.
_ANGLE_WEIGHT, _SIZE_OVER_ANGLE_WEIGHT, _DIRECTION_N, _SMALL_N = 60.0, 0.2, 0.1, 1e-3
#: Tempering of the likelihood by a case's own sigma, the beta of Seitzer et al.: 0 is the likelihood, which neglects
#: hard cases; 1 is the squared error, which they dominate.
_LIKELIHOOD_TEMPERING_BETA = 0.25
#: Variance along an axis below which inputs count as constant.
_LEAST_VARIANCE = 3e-8
#: Steps that are compiled into one call.
_STEPS_PER_CALL = 500


@dataclass(frozen=True, slots=True, kw_only=True)
class WindowTrainingSettings:
    """Training settings of a windowed network.

    Attributes:
        channels: Channels of each of the two hidden layers, eight units each.
        steps: Steps, a multiple of those of a call.
        batch: Windows in a step.
        rate: Highest learning rate.
        seed: Seed of start weights, batches, noise and masks.
    """

    channels: int = 40
    steps: int = 200_000
    batch: int = 1024
    rate: float = 5e-3
    seed: int = 20090304

    def card(self) -> dict[str, Any]:
        """Return the training settings as JSON values for the network's card."""
        return {"optimiser": "muon, cosine one-cycle", "min_force_n": _MIN_FORCE_N, **asdict(self)}


class Batch(NamedTuple):
    """Training batch of n windows with true loads.

    Attributes:
        features: Input features of the network.
        force_n: True forces [N], shape (n, 3).
        contact_point_and_friction: True contact point, stereographic, and friction ratio [1], shape (n, 4).
        loaded: One where the two are learnt, shape (n, 1).
    """

    features: Features
    force_n: Any
    contact_point_and_friction: Any
    loaded: Any


def _training_constants(
    gaits: GaitReadings, steady_loads: LeaningCases, design: Capacitor, imputation: Imputation
) -> dict[str, Any]:
    """Return the training data as JAX arrays: gaits, steady loads, masks, noise."""
    contact, pressing_n = contact_and_normal_force(
        gaits.true_force_at_sending_n.astype(np.float64), gaits.true_normal_at_sending.astype(np.float64)
    )
    steady_contact, _ = contact_and_normal_force(steady_loads.force_n, steady_loads.normal)
    rng = np.random.default_rng(1)
    carries, window = pressing_n > 0.0, READINGS_PER_ELEMENT * ELEMENTS
    load = np.concatenate([np.zeros((len(carries), window), int), carries.cumsum(axis=1)], axis=1)
    lately = load[:, window:] > load[:, :-window]
    drawn = rng.random(carries.shape)
    share = np.where(carries, 1.0, np.where(lately, _JUST_LIFTED_SHARE, _AIR_SHARE))
    where = np.flatnonzero((complete_window_ends(gaits) & (drawn < share)).ravel())
    plates_um = EPS0_PF_UM_PER_MM2 * design.electrode_area_mm2
    of_friction = np.linalg.norm(steady_contact[:, 2:], axis=1) > _FRICTION_REL
    arrays = {
        "closure_rel": gaits.closure_rel.ravel(),
        "force_n": gaits.true_force_at_sending_n.reshape(-1, 3),
        "contact_point_and_friction": contact.reshape(-1, 4),
        "loaded": (pressing_n.ravel() > _LOADED_N)[:, None].astype(float),
        "send_delay_s": gaits.send_delay_s.ravel(),
        "step_s": gaits.step_s,
        "conversion_order_index": gaits.conversion_order_index,
        "window_indices": where,
        "readings_since": readings_since_table(),
        "steady_closure_rel": steady_loads.closure_um / design.gap_um,
        "steady_force_n": steady_loads.force_n,
        "steady_contact_point_and_friction": steady_contact,
        "steady_friction_indices": np.flatnonzero(of_friction),
        "imputation_matrices": np.stack([imputation.matrix(mask) for mask in MISSING_SETS]),
        "missing_masks": MISSING_SETS.astype(float),
        "noise_rel": np.array([NOISE_PF, BASELINE_NOISE_PF]) * design.gap_um / plates_um,
        "film_thickness_rel": np.array(design.film_equivalent_um / design.gap_um),
    }
    # In single precision, and whole numbers in 32 bits.
    return {name: jnp.asarray(array) for name, array in arrays.items()}


def _gait_windows(data: dict[str, Any], times_per_gait: int, key: jax.Array, n: int) -> tuple[Any, ...]:
    """Return closures and ages, (n, 3, elements), and true loads of random windows from gaits."""
    at = data["window_indices"][jax.random.randint(key, (n,), 0, len(data["window_indices"]))]
    gait, time = at // times_per_gait, at % times_per_gait
    since = readings_since(data["readings_since"], data["conversion_order_index"][gait], time)
    closure_rel = data["closure_rel"][at[:, None, None] - since]
    age_s = since * data["step_s"][gait][:, None, None] + data["send_delay_s"][at][:, None, None]
    return closure_rel, age_s, data["force_n"][at], data["contact_point_and_friction"][at], data["loaded"][at]


def _steady_windows(data: dict[str, Any], key: jax.Array, n: int) -> tuple[Any, ...]:
    """Return random windows of steady loads, with true loads."""
    k1, k2, k3, k4, k5, k6, k7 = jax.random.split(key, 7)
    n_rough, n_paced = round(_FRICTION_SHARE * n), round(_PACED_SHARE * n)
    rough = data["steady_friction_indices"][
        jax.random.randint(k1, (n_rough,), 0, len(data["steady_friction_indices"]))
    ]
    at = jnp.concatenate([rough, jax.random.randint(k5, (n - n_rough,), 0, len(data["steady_closure_rel"]))])
    exact = data["steady_closure_rel"][at][:, None]
    steep = (1.0 + data["film_thickness_rel"] - exact) ** 2
    noise = data["noise_rel"][0] * jax.random.normal(k2, (n, READINGS_PER_ELEMENT, ELEMENTS))
    offset = data["noise_rel"][1] * jax.random.normal(k3, (n, 1, ELEMENTS))
    phase = jax.random.randint(k4, (n,), 0, ELEMENTS)
    place = jax.random.permutation(k6, n)
    paced, fast = place < n_paced, place < (n + n_paced) // 2
    low, high = np.log(PACE_REL)
    drawn = jax.random.uniform(k7, (2, n))
    step_s = jnp.where(fast, AD7147_STAGE_S, STEP_S)
    step_s = jnp.where(paced, STEP_S * jnp.exp(low + (high - low) * drawn[0]), step_s)[:, None, None]
    order = jnp.where(paced, (drawn[1] * len(data["readings_since"])).astype(int), 0)
    since = readings_since(data["readings_since"], order, phase)
    closure_rel = exact + steep * noise + (1.0 + data["film_thickness_rel"]) ** 2 * offset
    return (
        closure_rel,
        since * step_s + nominal_send_delay_s(step_s),
        data["steady_force_n"][at],
        data["steady_contact_point_and_friction"][at],
        jnp.ones((n, 1)),
    )


def _random_windows_batch(data: dict[str, Any], times_per_gait: int, n: int, key: jax.Array) -> Batch:
    """Return a random batch of training windows, of gaits and of steady loads, with missing elements."""
    k1, k2, k3, k4 = jax.random.split(key, 4)
    n_rest = round(_STEADY_WINDOWS_SHARE * n)
    parts = zip(
        _gait_windows(data, times_per_gait, k1, n - n_rest), _steady_windows(data, k2, n_rest), strict=True
    )
    closure_rel, age_s, force_n, contact, loaded = (jnp.concatenate(pair) for pair in parts)
    shares = _MISSING_SET_WEIGHTS / _MISSING_SET_WEIGHTS.sum()
    which = jax.random.choice(k3, len(shares), (n,), p=jnp.asarray(shares, jnp.float32))
    which = jnp.where(jax.random.uniform(k4, (n,)) < _WINDOWS_WITH_MISSING_SHARE, which, 0)
    closure_rel = jnp.einsum("nab,nsb->nsa", data["imputation_matrices"][which], closure_rel)
    return Batch(features(closure_rel, age_s, data["missing_masks"][which]), force_n, contact, loaded)


def _whitening_transform(
    hidden_inputs: Vector, index: NDArray[np.intp], place: NDArray[np.intp]
) -> tuple[jax.Array, jax.Array]:
    """Return whitening matrix (inputs, inputs) and mean (inputs,) of the hidden layer's inputs, symmetrised.

    Args:
        hidden_inputs: Inputs of the first hidden layer, shape (n, inputs).
        index: Result of `element_input_index`, shape (8, inputs).
        place: The inputs to whiten: all but the masks.
    """
    covariance = np.cov(hidden_inputs.T)
    covariance = np.mean([covariance[np.ix_(row, row)] for row in index], axis=0)
    mean = np.mean([hidden_inputs.mean(axis=0)[row] for row in index], axis=0)
    variance, axes = np.linalg.eigh(covariance[np.ix_(place, place)])
    whiten, shift = np.eye(len(mean)), np.zeros(len(mean))
    whiten[np.ix_(place, place)] = (axes / np.sqrt(np.maximum(variance, _LEAST_VARIANCE))) @ axes.T
    shift[place] = mean[place]
    return jnp.asarray(whiten, jnp.float32), jnp.asarray(shift, jnp.float32)


def _fit_linear_start(inputs: Sequence[Vector], force_n: Vector) -> jax.Array:
    """Return start weights of the network's linear paths [N], by weighted least squares.

    Args:
        inputs: Closures over the gap [1], shape (n, elements) each.
        force_n: Forces [N], shape (n, 3).
    """
    weight = 1.0 / np.sqrt((force_n**2).sum(axis=1, keepdims=True) + _MIN_FORCE_N**2)
    basis = linear_basis()
    columns = [np.einsum("ne,beo->nob", part * weight, basis) for part in inputs]
    flat = np.concatenate(columns, axis=2).reshape(-1, len(basis) * len(columns))
    solution = np.linalg.lstsq(flat, (force_n * weight).ravel(), rcond=None)
    return jnp.asarray(solution[0], jnp.float32)


def _force_likelihood_loss(force_n: Any, sigma_n: Any, true_n: Any) -> Any:
    """Return the training loss of forces: tempered negative log-likelihood plus relative squared error.

    Args:
        force_n: Estimated forces [N], shape (n, 3).
        sigma_n: Their stated sigma [N], same shape.
        true_n: True forces [N], same shape.
    """
    square = (force_n - true_n) ** 2
    scale = jnp.sqrt(jnp.sum(true_n**2, axis=-1, keepdims=True) + _MIN_FORCE_N**2)
    weight = jax.lax.stop_gradient(sigma_n / scale) ** (2.0 * _LIKELIHOOD_TEMPERING_BETA)
    likelihood = jnp.log(sigma_n) + 0.5 * square / sigma_n**2
    beyond = jnp.maximum(jnp.sqrt(square + 1e-12) / sigma_n - _TAIL_SIGMAS, 0.0)
    return (
        jnp.mean(weight * likelihood)
        + _SQUARED_ERROR_WEIGHT * jnp.mean(square / scale**2)
        + _TAIL_WEIGHT * jnp.mean(beyond)
    )


def _mean_angle_and_size_error(force_n: Any, true_n: Any) -> Any:
    """Return the mean angle between forces and true ones [rad], and a share of their relative error; of loads."""
    size_n, true_size_n = (
        jnp.sqrt(jnp.sum(one**2, axis=-1, keepdims=True) + _SMALL_N**2) for one in (force_n, true_n)
    )
    apart = jnp.sqrt(jnp.sum((force_n / size_n - true_n / true_size_n) ** 2, axis=-1) + 1e-6)
    apart += _SIZE_OVER_ANGLE_WEIGHT * jnp.abs(size_n / true_size_n - 1.0)[:, 0]
    return jnp.mean(jnp.where(true_size_n[:, 0] > _DIRECTION_N, apart, 0.0))


def train_windowed(
    gaits: GaitReadings,
    steady_loads: LeaningCases,
    design: Capacitor,
    settings: WindowTrainingSettings,
    imputation: Imputation,
    report: Callable[[str], object] = lambda _: None,
    start: Weights | None = None,
) -> Weights:
    """Train the windowed network on random gaits and steady loads; return its weights.

    Args:
        gaits: Readings of random gaits.
        steady_loads: Loads that stay constant over a window.
        design: The capacitors, for the noise of steady windows.
        settings: Sizes, steps and seed.
        imputation: Imputation of missing elements.
        report: Receives a line now and then.
        start: Weights of a similar foot's network to start from, of as many channels; None for random ones.

    Returns:
        The weights, float32.
    """
    data = _training_constants(gaits, steady_loads, design, imputation)
    times_per_gait = gaits.closure_rel.shape[1]
    draw = jax.jit(_random_windows_batch, static_argnums=(1, 2))
    first: Batch = jax.tree.map(
        lambda part: np.asarray(part, np.float64), draw(data, times_per_gait, 60_000, jax.random.PRNGKey(0))
    )
    seen, now, newest, _ = first.features
    unmasked, masked = (n * ELEMENTS for n in (FEATURES_PER_ELEMENT - 1, FEATURES_PER_ELEMENT))
    place = np.r_[0:unmasked, masked : masked + FEATURES_PER_FOOT]
    whiten, mean = _whitening_transform(seen[first.loaded[:, 0] > 0.0], element_input_index(), place)
    linear = _fit_linear_start((now, now - newest), first.force_n)

    def fold_whitening(free: Weights) -> Weights:
        """Return the weights with the input whitening folded into the first layer."""
        w1 = free.w1 @ whiten
        return free._replace(linear=linear + free.linear, w1=w1, b1=free.b1 - w1 @ mean)

    def loss(free: Weights, batch: Batch) -> jax.Array:
        """Return the training loss of a batch."""
        load = run(fold_whitening(free), batch.features)
        apart, sigma = load.contact_point_and_friction - batch.contact_point_and_friction, load.contact_sigma
        likelihood = batch.loaded * (jnp.log(sigma) + 0.5 * apart**2 / sigma**2)
        return (
            _force_likelihood_loss(load.force_n, load.sigma_n, batch.force_n)
            + _CONTACT_WEIGHT * jnp.mean(likelihood)
            + _ANGLE_WEIGHT * _mean_angle_and_size_error(load.force_n, batch.force_n)
        )

    def unfold_whitening(weights: Weights) -> Weights:
        """Return the weights before whitening is folded in: the inverse of `fold_whitening`."""
        w1 = jnp.asarray(
            np.asarray(weights.w1, np.float64) @ np.linalg.inv(np.asarray(whiten, np.float64)), jnp.float32
        )
        return weights._replace(linear=weights.linear - linear, w1=w1, b1=weights.b1 + weights.w1 @ mean)

    schedule = optax.cosine_onecycle_schedule(settings.steps, settings.rate, pct_start=0.1)
    optimiser = optax.contrib.muon(schedule)

    def train_chunk(carry: tuple[Weights, Any], key: jax.Array, data: dict[str, Any]) -> Any:
        """Return the state after several training steps, as one compiled call."""
        return descend(
            optimiser,
            loss,
            lambda key: _random_windows_batch(data, times_per_gait, settings.batch, key),
            carry,
            jax.random.split(key, _STEPS_PER_CALL),
        )

    key, *rounds = jax.random.split(jax.random.PRNGKey(settings.seed), 1 + settings.steps // _STEPS_PER_CALL)
    free = random_weights(key, settings.channels) if start is None else unfold_whitening(start)
    carry = (free, optimiser.init(free))
    compiled = jax.jit(train_chunk)
    with progress_bar("training", len(rounds)) as rounds_done:
        for number, key in enumerate(rounds, 1):
            carry, losses = compiled(carry, key, data)
            if number % 10 == 0 or number == len(rounds):
                report(f"step {number * _STEPS_PER_CALL}: loss {float(losses.mean()):.4f}")
                rounds_done(number)  # after the loss was waited for
    return fold_whitening(carry[0])
