"""Steps of gradient descent, compiled into one call: of the paper's networks and of the windowed network alike."""

from collections.abc import Callable
from typing import Any

import jax
import optax


def descend(
    rule: optax.GradientTransformation,
    loss: Callable[[Any, Any], jax.Array],
    draw: Callable[[Any], Any],
    carry: tuple[Any, Any],
    keys: Any,
) -> tuple[tuple[Any, Any], jax.Array]:
    """Return weights and the rule's state after a number of steps, and the loss that each step started from.

    Args:
        rule: The optimiser.
        loss: Loss of some weights on some cases.
        draw: Returns the cases of a step, from its key.
        carry: Weights and the rule's state before.
        keys: A key for each step.
    """

    def step(carry: tuple[Any, Any], key: Any) -> tuple[tuple[Any, Any], jax.Array]:
        """Return the state after one step, and the loss that it started from."""
        weights, state = carry
        before, gradient = jax.value_and_grad(loss)(weights, draw(key))
        change, state = rule.update(gradient, state, weights)
        return (optax.apply_updates(weights, change), state), before

    after: tuple[tuple[Any, Any], jax.Array] = jax.lax.scan(step, carry, keys)
    return after
