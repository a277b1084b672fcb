"""What is kept of feet in a batch, between two steps and within one, and what they publish."""

import sys
from typing import NamedTuple

from array_api_compat import is_jax_array

from footsense.sim.virtual.network import Array
from footsense.sim.virtual.response import Conversions, StepLoads, StepReadings
from footsense.sim.virtual.variation import FootDraw


class VirtualForces(NamedTuple):
    """The last published force of each of n feet, as a controller has it at the time of a step.

    Attributes:
        force_n: Ground reaction on the foot, foot frame [N], shape (n, 3); NaN unless usable.
        sigma_n: Standard deviation of each component [N], shape (n, 3); NaN unless usable.
        state: State of each foot, shape (n,), uint8 of `State`.
        usable: Whether its force may be used, shape (n,).
        age_s: Age of the newest reading at the time of the step [s], shape (n,): that of six legs on average.
    """

    force_n: Array
    sigma_n: Array
    state: Array
    usable: Array
    age_s: Array


class FeetState(NamedTuple):
    """State of n feet between two steps; what begins with n is of each foot, the rest of their common clock.

    Attributes:
        read_pf: The last readings of each foot, newest last [pF], shape (n, history).
        closed: Whether a cell was closed at each of them, same shape.
        leans: Whether the contact was beyond the response table, same shape.
        force_n: Contact force at the last step [N], shape (n, 3).
        normal: Its normal, same shape.
        n_conversions: Conversions since the last reset, shape (n,), int32.
        absent_ns: Time from now until the last broken cable is found again [ns], shape (n,), int32.
        episode: Resets of each foot, shape (n,), int32.
        seed_key: Key of a foot for all episodes, shape (n,), int32.
        draw: What each foot is in this episode.
        number: Number of the newest conversion, shape (1,), int32.
        since_ns: Time since its middle [ns], shape (1,), int32.
        n_steps: Steps, shape (1,), int32.
    """

    read_pf: Array
    closed: Array
    leans: Array
    force_n: Array
    normal: Array
    n_conversions: Array
    absent_ns: Array
    episode: Array
    seed_key: Array
    draw: FootDraw
    number: Array
    since_ns: Array
    n_steps: Array


class Step(NamedTuple):
    """A step that is not finished: the state after it without readings, and what its conversions read.

    Attributes:
        after: That state.
        loads: Loads over the step.
        conversions: Its conversions.
        readings: What they read.
        touches: Those readings that closed cells of other elements change, shape (n, k).
        is_whole: Whether the oldest conversion is of this step, else it is the newest of the step before, shape (1,).
    """

    after: FeetState
    loads: StepLoads
    conversions: Conversions
    readings: StepReadings
    touches: Array
    is_whole: Array


def of_rows(part: Array, rows: Array) -> Array:
    """Return some rows, a slice or a mask, of what each foot has; all of what all feet share."""
    if part is None or part.shape[0] == 1:
        return part
    return part[rows, ...] if isinstance(rows, slice) else part[rows]


def of_feet(state: FeetState, rows: slice) -> FeetState:
    """Return the state of some of the feet."""
    parts = state._asdict()
    draw = FootDraw(*(of_rows(part, rows) for part in parts.pop("draw")))
    return FeetState(**{name: of_rows(part, rows) for name, part in parts.items()}, draw=draw)


def is_traced(array: Array) -> bool:
    """Return whether JAX traces a function of an array, whose values are not known."""
    return is_jax_array(array) and isinstance(array, sys.modules["jax"].core.Tracer)
