"""What is kept of feet in a batch between two steps, and what they publish."""

from typing import NamedTuple

from footsense.sim.virtual.network import Array
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
    """State of n feet between two steps: the last axis is of the feet, but of their common clock.

    Attributes:
        change_pf: The last readings of each foot over its baseline, newest last [pF], shape (history, n); NaN under
            a load beyond the response table.
        force_n: Contact force at the last step [N], shape (3, n).
        normal: Its normal, same shape.
        n_conversions: Conversions since the last reset, shape (n,), int32.
        absent_ns: Time from now until the last broken cable is found again [ns], shape (n,), int32.
        key: Key of each foot for its seed, plus its episodes, shape (n,), int32.
        draw: What each foot is in this episode.
        number: Number of the newest conversion, shape (1,), int32.
        since_ns: Time since its middle [ns], shape (1,), int32.
        n_steps: Steps, shape (1,), int32.
    """

    change_pf: Array
    force_n: Array
    normal: Array
    n_conversions: Array
    absent_ns: Array
    key: Array
    draw: FootDraw
    number: Array
    since_ns: Array
    n_steps: Array
