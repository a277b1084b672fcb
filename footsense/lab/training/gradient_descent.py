"""Back-propagation as it was before RPROP: every weight moves along its gradient, at one fixed learning rate.

    move = momentum * last move - rate * gradient

Source:
    D. E. Rumelhart, G. E. Hinton and R. J. Williams, "Learning representations by back-propagating errors",
    Nature 323, 1986, equations 8 and 9.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray


class DescentMemory(NamedTuple):
    """The rule's two numbers, and what is remembered of the last epoch.

    Attributes:
        rate: Learning rate, in squared weights over loss.
        momentum: Share of the last move that is made again [1]; 0 is plain back-propagation.
        move: What was added to the weights, nested and shaped like them.
    """

    rate: Any
    momentum: Any
    move: Any


def descent_start(
    weights: Any, rate: float | NDArray[np.float64], momentum: float | NDArray[np.float64] = 0.0
) -> DescentMemory:
    """Return the memory before the first epoch; of stacked networks with a rate and momentum each, shape (n,)."""
    return DescentMemory(
        jnp.asarray(rate, jnp.float32),
        jnp.asarray(momentum, jnp.float32),
        jax.tree.map(jnp.zeros_like, weights),
    )


def descent_step(weights: Any, gradient: Any, memory: DescentMemory) -> tuple[Any, DescentMemory]:
    """Return weights and memory after one epoch, the gradient being nested and shaped like the weights."""
    move = jax.tree.map(lambda last, g: memory.momentum * last - memory.rate * g, memory.move, gradient)
    return jax.tree.map(jnp.add, weights, move), memory._replace(move=move)
