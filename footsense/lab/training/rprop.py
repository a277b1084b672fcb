"""RPROP: each weight has a step of its own, which only the sign of its gradient changes.

    same sign as before    the step grows by 1.2, the weight moves by it against the gradient
    sign has changed       the step shrinks to a half, the weight takes its last move back and forgets the sign
    no sign before or now  the step stays, the weight moves by it against the gradient

As the size of the gradient plays no part, weights far from the output learn as fast as those near it.

Source:
    M. Riedmiller and H. Braun, "A Direct Adaptive Method for Faster Backpropagation Learning: The RPROP
    Algorithm", IEEE Int. Conf. Neural Networks, San Francisco, 1993: the paper's reference [12].
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

#: Growth and shrinkage of a step [1].
GROW, SHRINK = 1.2, 0.5
#: First, smallest and largest step, in the unit of the weights.
FIRST_STEP, LEAST_STEP, LARGEST_STEP = 0.1, 1e-6, 50.0


class RpropMemory(NamedTuple):
    """What is remembered of the last epoch, each part nested and shaped like the weights.

    Attributes:
        size: Sizes of the steps, above 0.
        gradient: The gradient, 0 where a move was taken back.
        move: What was added to the weights.
    """

    size: Any
    gradient: Any
    move: Any


def rprop_start(weights: Any) -> RpropMemory:
    """Return the memory before the first epoch of weights in any nesting."""
    zero = jax.tree.map(jnp.zeros_like, weights)
    return RpropMemory(jax.tree.map(lambda w: jnp.full_like(w, FIRST_STEP), weights), zero, zero)


def _one(w: Any, gradient: Any, size: Any, last_gradient: Any, last_move: Any) -> tuple[Any, ...]:
    """Return one array's weights, sizes, remembered gradients and moves after an epoch."""
    agreement = jnp.sign(gradient) * jnp.sign(last_gradient)
    factor = jnp.where(agreement > 0.0, GROW, jnp.where(agreement < 0.0, SHRINK, 1.0))
    size = jnp.clip(size * factor, LEAST_STEP, LARGEST_STEP)
    gone_too_far = agreement < 0.0
    move = jnp.where(gone_too_far, -last_move, -jnp.sign(gradient) * size)
    return w + move, size, jnp.where(gone_too_far, 0.0, gradient), move


def rprop_step(weights: Any, gradient: Any, memory: RpropMemory) -> tuple[Any, RpropMemory]:
    """Return weights and memory after one epoch, the gradient being nested and shaped like the weights."""
    after = jax.tree.map(_one, weights, gradient, *memory)
    weights, *parts = jax.tree.transpose(jax.tree.structure(weights), jax.tree.structure((0,) * 4), after)
    return weights, RpropMemory(*parts)
