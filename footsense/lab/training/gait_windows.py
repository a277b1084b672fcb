"""Input windows of the network (the last three readings of every element) from the readings of gaits."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_interface.conversion_order import CONVERSION_ORDERS
from footsense.estimation.missing_elements import MAX_OVERLOADED
from footsense.foot.specimen import ContactLoads
from footsense.frames import ELEMENTS, Vector
from footsense.lab.training.gait_readings import GaitReadings, conversion_elements
from footsense.lab.training.windowed_network import READINGS_PER_ELEMENT
from footsense.ports import Window

#: Readings before the first window of a gait, beyond those of the window.
_EXTRA_WARM_UP_READINGS = 3


def readings_since_table() -> NDArray[np.intp]:
    """Return how many readings ago each element's newest was, by order and last reading, (orders, 9, 9)."""
    place = np.argsort(
        [conversion_elements(order, ELEMENTS) for order in range(len(CONVERSION_ORDERS))], axis=1
    )
    return (np.arange(ELEMENTS)[None, :, None] - place[:, None, :]) % ELEMENTS


def readings_since(table: Any, order: Any, last_reading: Any) -> Any:
    """Return how many readings ago each one of n windows was, shape (n, 3, elements), newest first.

    Args:
        table: Table of `readings_since_table`; an array of JAX in compiled code.
        order: Index into `CONVERSION_ORDERS` of each window, shape (n,).
        last_reading: Number of the last reading of each window in its gait, shape (n,).
    """
    older = ELEMENTS * np.arange(READINGS_PER_ELEMENT)[:, None]
    return table[order, last_reading % ELEMENTS][:, None] + older


def contact_and_normal_force(force_n: Vector, normal: Vector) -> tuple[Vector, Vector]:
    """Return contact point and friction ratio, shape (..., 4), and normal force [N], (...), from force and normal."""
    pressing_n = (force_n * normal).sum(axis=-1)
    point = normal[..., :2] / (1.0 + normal[..., 2:])
    safe_n = np.where(pressing_n > 0.0, pressing_n, 1.0)[..., None]
    ratio = np.where(pressing_n[..., None] > 0.0, force_n / safe_n - normal, 0.0)[..., :2]
    return np.concatenate([point, ratio], axis=-1), pressing_n


def complete_window_ends(gaits: GaitReadings) -> NDArray[np.bool_]:
    """Return the mask of readings that end a complete window for which there is a force, shape (m, n).

    At most `MAX_OVERLOADED` of its newest readings are beyond the converter's range.
    """
    warm_up = READINGS_PER_ELEMENT * ELEMENTS + _EXTRA_WARM_UP_READINGS
    beyond = (~gaits.in_range).cumsum(axis=1)
    whole = np.zeros(beyond.shape, bool)
    whole[:, warm_up:] = beyond[:, warm_up:] - beyond[:, warm_up - ELEMENTS : -ELEMENTS] <= MAX_OVERLOADED
    return whole


def windows_of(gaits: GaitReadings) -> tuple[Window, ContactLoads]:
    """Return all complete windows of simulated gaits, ordered by gait and time, with their true loads."""
    gait, time = np.nonzero(complete_window_ends(gaits))
    since = readings_since(readings_since_table(), gaits.conversion_order_index[gait], time)
    window = Window(
        gaits.closure_rel[gait[:, None, None], time[:, None, None] - since].astype(np.float64),
        since * gaits.step_s[gait][:, None, None] + gaits.send_delay_s[gait, time][:, None, None],
        np.zeros((len(gait), ELEMENTS), bool),
    )
    normal, force_n = gaits.true_normal_at_sending[gait, time], gaits.true_force_at_sending_n[gait, time]
    return window, ContactLoads(normal.astype(np.float64), force_n.astype(np.float64))
