"""RPROP optimiser with weight backtracking, as an optax transformation.

Each weight has a step of its own, which only the sign of its gradient changes:

    same sign as before    the step grows by 1.2, the weight moves by it against the gradient
    sign has changed       the step shrinks to a half, the weight takes its last move back and forgets the sign
    no sign before or now  the step stays, the weight moves by it against the gradient

The size of the gradient has no influence, so weights far from the output learn as fast as those near it. Not
`optax.rprop`: see docs/adr/0013.

Source:
    M. Riedmiller and H. Braun, "A Direct Adaptive Method for Faster Backpropagation Learning: The RPROP
    Algorithm", IEEE Int. Conf. Neural Networks, San Francisco, 1993: reference [12] of Aoyagi et al.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax

#: Growth and shrinkage of a step [1].
STEP_GROWTH, STEP_SHRINKAGE = 1.2, 0.5
#: First, smallest and largest step, in the unit of the weights.
INITIAL_STEP, MIN_STEP, MAX_STEP = 0.1, 1e-6, 50.0


class RpropState(NamedTuple):
    """RPROP's optimiser state after an epoch; each field is shaped like the weights.

    Attributes:
        step_size: Sizes of the steps, above 0.
        gradient: The gradient, 0 where a move was taken back.
        weight_step: The last change of the weights.
    """

    step_size: Any
    gradient: Any
    weight_step: Any


def _initial_state(weights: Any) -> RpropState:
    """Return the optimiser state before the first epoch."""
    zero = jax.tree.map(jnp.zeros_like, weights)
    return RpropState(jax.tree.map(lambda w: jnp.full_like(w, INITIAL_STEP), weights), zero, zero)


def _update_array(gradient: Any, step_size: Any, previous_gradient: Any, last_weight_step: Any) -> RpropState:
    """Return the optimiser state of one weight array after an epoch."""
    agreement = jnp.sign(gradient) * jnp.sign(previous_gradient)
    factor = jnp.where(agreement > 0.0, STEP_GROWTH, jnp.where(agreement < 0.0, STEP_SHRINKAGE, 1.0))
    step_size = jnp.clip(step_size * factor, MIN_STEP, MAX_STEP)
    overshot = agreement < 0.0
    weight_step = jnp.where(overshot, -last_weight_step, -jnp.sign(gradient) * step_size)
    return RpropState(step_size, jnp.where(overshot, 0.0, gradient), weight_step)


def _update_all(gradient: Any, state: Any, weights: Any = None) -> tuple[Any, RpropState]:
    """Return the weight steps and the optimiser state of all weights after an epoch."""
    del weights
    after = jax.tree.map(_update_array, gradient, *state)
    state = jax.tree.transpose(jax.tree.structure(gradient), jax.tree.structure(RpropState(0, 0, 0)), after)
    return state.weight_step, state


RPROP = optax.GradientTransformation(_initial_state, _update_all)
