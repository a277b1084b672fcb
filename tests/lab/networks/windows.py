"""Windows of feet in motion, and the symmetry of what a network makes of them."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from footsense.estimation.missing_elements import MISSING_SETS
from footsense.lab.symmetry import SYMMETRIES, element_permutation
from footsense.lab.training.gait_windows import readings_since_table
from footsense.ports import LoadEstimate, Window

STEP_S, NOMINAL_SEND_DELAY_S = 2.7e-3, 3.2e-3


def some_windows(n: int = 40, seed: int = 1) -> Window:
    """Return windows of feet in motion, in every phase of a scan and with every set of missing elements."""
    rng = np.random.default_rng(seed)
    since = readings_since_table()[0, np.arange(n) % 9][:, None] + 9 * np.arange(3)[:, None]
    age_s = (
        NOMINAL_SEND_DELAY_S
        + STEP_S * (1.0 + 4.0 * rng.random((n, 1, 1)) * (rng.random((n, 1, 1)) < 0.3)) * since
    )
    return Window(
        rng.uniform(-0.05, 0.8, (n, 1, 9)) + rng.normal(0.0, 0.1, (n, 3, 9)),
        age_s,
        MISSING_SETS[np.arange(n) % len(MISSING_SETS)],
    )


def turned(window: Window, image: NDArray[np.intp]) -> Window:
    """Return the windows of the foot turned by a symmetry that moves element e to image[e]."""
    image_of = np.argsort(image)
    return Window(*(part[..., image_of] for part in window))  # type: ignore[arg-type]


def assert_symmetric(estimate: Callable[[Window], LoadEstimate], atol: float) -> None:
    """Check that a turned or mirrored foot has turned or mirrored loads, and sigmas that follow."""
    window = some_windows()
    load = estimate(window)
    assert all(np.ptp(part, axis=0).min() > 0.01 for part in load)
    for symmetry in SYMMETRIES:
        again = estimate(turned(window, element_permutation(symmetry)))
        plane = np.kron(np.eye(2), symmetry[:2, :2])
        for found, known, turn in (
            (again.force_n, load.force_n, symmetry),
            (again.sigma_n, load.sigma_n, np.abs(symmetry)),
            (again.contact_point_and_friction, load.contact_point_and_friction, plane),
            (again.contact_sigma, load.contact_sigma, np.abs(plane)),
        ):
            np.testing.assert_allclose(found, known @ turn.T, rtol=atol, atol=atol)
