"""Published forces from readings: by the daemon's method (network over the last readings), and by simpler methods."""

from typing import NamedTuple

import numpy as np

from footsense.benchmarks.latency_vs_error.chain import SimulatedReadings
from footsense.estimation.network import READINGS, ReadingWindow, steady_windows
from footsense.foot.files.network_card import TrainedInputs
from footsense.frames import ELEMENTS, Stamps, Vector
from footsense.ports import Estimator, Window

#: Conversions before the first one that ends a whole window, counted from the end of the first scan.
_CONVERSIONS_TO_FILL_WINDOW = (READINGS - 1) * ELEMENTS


class PublishedForces(NamedTuple):
    """Forces [N] with standard deviations [N] as sent, and their times.

    Attributes:
        sent_ns: Time of sending [ns], shape (forces,).
        newest_reading_ns: Time of the newest reading in each [ns], same shape.
        force_n: Forces [N], shape (forces, feet, 3).
        sigma_n: Standard deviations of the forces [N], same shape.
    """

    sent_ns: Stamps
    newest_reading_ns: Stamps
    force_n: Vector
    sigma_n: Vector

    def every_nth(self, n: int) -> "PublishedForces":
        """Return every n-th of the published forces."""
        return PublishedForces(
            self.sent_ns[::n], self.newest_reading_ns[::n], self.force_n[::n], self.sigma_n[::n]
        )


def conversion_windows(readings: SimulatedReadings) -> Window:
    """Return the network inputs of all feet after each conversion, from the third full scan on.

    One row for each conversion and foot, the foot fast; no element is missing.
    """
    n_feet = len(readings.unloaded_plate_distance_rel)
    kept = ReadingWindow(n_feet, ELEMENTS * int(readings.t_ns[1] - readings.t_ns[0]))
    closure_rel, age_s = [], []
    for plate_distance_rel, t_ns, now_ns in zip(
        *readings.latest_by_element(), readings.sent_ns[ELEMENTS - 1 :], strict=True
    ):
        last = kept.add(plate_distance_rel, t_ns)
        closure_rel.append(readings.unloaded_plate_distance_rel[:, None] - last.plate_distance_rel)
        age_s.append((now_ns - last.t_ns) * 1e-9)
    closures_rel = np.concatenate(closure_rel[_CONVERSIONS_TO_FILL_WINDOW:])
    ages_s = np.concatenate(age_s[_CONVERSIONS_TO_FILL_WINDOW:])
    return Window(closures_rel, ages_s, np.zeros(closures_rel[:, 0].shape, bool))


def extrapolate_closures(window: Window, degree: int) -> Vector:
    """Return each element's gap closure extrapolated to the present [1], shape (rows, 9).

    Args:
        window: The last readings.
        degree: 0 for the newest reading as it is, 1 for a line through two, 2 for a parabola through three.
    """
    readings = range(degree + 1)
    now_rel = np.zeros(window.missing.shape)
    for k in readings:
        weight = np.ones(window.missing.shape)
        for other in readings:
            if other != k:
                weight *= window.age_s[:, other] / (window.age_s[:, other] - window.age_s[:, k])
        now_rel += weight * window.closure_rel[:, k]
    return now_rel


def estimate_forces(
    readings: SimulatedReadings, network: Estimator, trained: TrainedInputs, degree: int | None = None
) -> PublishedForces:
    """Return the forces estimated after each conversion, from the third full scan on.

    Args:
        readings: The readings.
        network: The network.
        trained: Inputs that the network was trained for, to which closures are clipped.
        degree: None for the daemon's forces. For comparison, the closures of a foot at rest: extrapolated to the time
            of sending by polynomials of this degree.
    """
    window = conversion_windows(readings)
    if degree is not None:
        window = steady_windows(extrapolate_closures(window, degree))
    closure_rel = np.clip(window.closure_rel, trained.closure_rel_min, trained.closure_rel_max)
    load = network.estimate(window._replace(closure_rel=closure_rel))
    force_n, sigma_n = (
        part.reshape(-1, len(readings.unloaded_plate_distance_rel), 3)
        for part in (load.force_n, load.sigma_n)
    )
    first = READINGS * ELEMENTS - 1
    return PublishedForces(readings.sent_ns[first:], readings.t_ns[first:], force_n, sigma_n)
