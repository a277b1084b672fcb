"""Windows of gaits, as networks are judged on: the readings before the asked time, with their ages."""

import numpy as np
import pytest

from firmware_interface.conversion_order import CONVERSION_ORDERS
from footsense.lab.training.gait_readings import GaitReadings, conversion_elements
from footsense.lab.training.gait_windows import windows_of

pytestmark = pytest.mark.lab

STEP_S, NOMINAL_SEND_DELAY_S, N, BEYOND = 3e-3, 4e-3, 90, 50


def numbered(order: int, n_beyond: int = 1) -> GaitReadings:
    """Return one gait; its readings and hundredths of newtons are the numbers of the conversions, some beyond range."""
    numbers = np.arange(N)
    force_n = np.zeros((1, N, 3), np.float32)
    force_n[0, :, 2] = numbers / 100
    return GaitReadings(
        conversion_order_index=np.array([order]),
        step_s=np.array([STEP_S]),
        send_delay_s=np.full((1, N), NOMINAL_SEND_DELAY_S),
        closure_rel=numbers[None].astype(np.float32),
        in_range=((numbers < BEYOND) | (numbers >= BEYOND + n_beyond))[None],
        true_force_at_sending_n=force_n,
        true_normal_at_sending=np.tile(np.array([0.0, 0.0, 1.0], np.float32), (1, N, 1)),
    )


@pytest.mark.parametrize("order", range(len(CONVERSION_ORDERS)))
def test_a_window_holds_the_last_three_readings_of_every_element(order: int) -> None:
    """The newest first, each as old as the conversions since; the force is that of the asked time."""
    window, (_, force_n) = windows_of(numbered(order))
    now = window.closure_rel.max(axis=(1, 2))
    np.testing.assert_allclose(force_n[:, 2], now / 100, rtol=1e-6)
    np.testing.assert_allclose(
        window.age_s,
        (now[:, None, None] - window.closure_rel) * STEP_S + NOMINAL_SEND_DELAY_S,
        rtol=1e-6,
    )
    assert (np.diff(window.closure_rel, axis=1) == -9).all()
    numbers = window.closure_rel.astype(int)
    np.testing.assert_array_equal(
        conversion_elements(order, N)[numbers], np.broadcast_to(np.arange(9), numbers.shape)
    )


@pytest.mark.parametrize(
    ("n_beyond", "left_out"), [(3, []), (4, [BEYOND + 3, *range(BEYOND + 4, BEYOND + 9)])]
)
def test_windows_count_with_three_readings_beyond_the_range_at_most(
    n_beyond: int, left_out: list[int]
) -> None:
    """And none of the first scans."""
    now = windows_of(numbered(0, n_beyond))[0].closure_rel.max(axis=(1, 2))
    np.testing.assert_array_equal(now, [k for k in range(30, N) if k not in left_out])
