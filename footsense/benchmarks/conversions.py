"""Simulated readings of feet with the service's conversion timing, noise and steps, and the forces made of them.

Bus and chips enter by three numbers, which `firmware_interface/` has in closed form: the time between two conversions,
the time from the middle of a conversion to the sending of its force, and the noise and step of the converter. All feet
are converted at the same times, as the legs of a robot are.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_interface.chips import fdc1004
from firmware_interface.schedule import scan_lower_bounds
from footsense.estimation.network import READINGS, ReadingWindow, steady_windows
from footsense.foot.network_card import TrainedInputs
from footsense.foot.specimen import Specimen
from footsense.frames import ELEMENTS, LEGS, Stamps, Vector
from footsense.ports import LoadEstimator, Window
from footsense.sim.loads.ground_load import GroundContact

#: Load of one foot at a time [ns].
FootLoad = Callable[[int], GroundContact]

#: Bus clock [Hz], and cost of a transaction on the host [ns]: planning value of a Raspberry Pi 4.
BUS_HZ, HOST_COST_NS = 400_000, 40_000
#: Scans that a tare averages.
_N_TARE_SCANS = 8
#: Conversions before the first one that ends a whole window, counted from the end of the first scan.
_CONVERSIONS_TO_FILL_WINDOW = (READINGS - 1) * ELEMENTS
#: At 400 S/s the noise exceeds the lower register of a result, which is then not read.
_SINGLE_REGISTER_RATE_SPS = 400


class ConversionTiming(NamedTuple):
    """Period of the conversions, and delay from a conversion to the sending of its force [ns].

    Attributes:
        step_ns: From one conversion to the next [ns].
        send_delay_ns: From the middle of a conversion to the sending of the force that ends with it [ns].
    """

    step_ns: int
    send_delay_ns: int


def conversion_timing(rate_sps: int) -> ConversionTiming:
    """Return the conversion timing of six legs on one I2C bus.

    The step is a ninth of the shortest scan. A force is sent after half a conversion, the tolerance of the slowest
    chip, and the transactions of a step: start of the next conversion, poll of the ready bits, read-out of all legs.

    Args:
        rate_sps: Conversions per second: 100, 200 or 400.

    Example:
        >>> conversion_timing(400)
        ConversionTiming(step_ns=2716733, send_delay_ns=3234933)
    """
    conversion_ns = fdc1004.RATES[rate_sps].conversion_ns
    limits = scan_lower_bounds(
        n_legs=len(LEGS),
        conversion_ns=conversion_ns,
        bus_hz=BUS_HZ,
        host_cost_ns=HOST_COST_NS,
        n_result_reads=1 if rate_sps == _SINGLE_REGISTER_RATE_SPS else 2,
    )
    wait_ns = round(conversion_ns * (0.5 + fdc1004.CLOCK_TOLERANCE_REL))
    return ConversionTiming(
        limits.scan_period_bound_ns // ELEMENTS, wait_ns + limits.readout_bound_ns // ELEMENTS
    )


def latest_conversion_indices(order: Sequence[int], n: int) -> NDArray[np.intp]:
    """Return the index of each element's latest conversion after each of `n` conversions, shape (n, elements).

    Args:
        order: Elements in the order of the scan.
        n: Conversions.

    Returns:
        Numbers, shape (conversions, 9), from the end of the first scan on.
    """
    now = np.arange(ELEMENTS - 1, n)[:, None]
    return now - (now - np.argsort(order)) % ELEMENTS


def quantized_capacitance_pf(capacitance_pf: Vector, rate_sps: int, rng: np.random.Generator) -> Vector:
    """Return capacitances with the converter's noise and quantisation added [pF], same shape."""
    noisy_pf = capacitance_pf + fdc1004.RATES[rate_sps].noise_ff * 1e-3 * rng.standard_normal(
        capacitance_pf.shape
    )
    codes_per_pf = fdc1004.CODES_PER_PF / ((1 << 8) if rate_sps == _SINGLE_REGISTER_RATE_SPS else 1)
    quantized_pf: Vector = np.floor(noisy_pf * codes_per_pf) / codes_per_pf
    return quantized_pf


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SimulatedReadings:
    """Simulated readings of some feet, one row per conversion.

    Attributes:
        order: Elements in the order of the scan.
        t_ns: Middle of each conversion [ns], shape (conversions,).
        sent_ns: Time at which a force that ends with it is sent [ns], same shape.
        plate_distance_rel: Distance of the plates over the gap [1], shape (conversions, feet).
        unloaded_plate_distance_rel: The same at the tare [1], shape (feet, 9).
    """

    order: tuple[int, ...]
    t_ns: Stamps
    sent_ns: Stamps
    plate_distance_rel: Vector
    unloaded_plate_distance_rel: Vector

    def latest_by_element(self) -> tuple[Vector, Stamps]:
        """Return each element's latest reading and its time, after each conversion from the first full scan on.

        Returns:
            Distances [1] and time stamps [ns], shape (conversions, feet, 9) each.
        """
        numbers = latest_conversion_indices(self.order, len(self.t_ns))
        plate_distance_rel = self.plate_distance_rel[numbers].swapaxes(1, 2)
        return plate_distance_rel, np.broadcast_to(self.t_ns[numbers][:, None], plate_distance_rel.shape)


def true_normals_and_forces_n(feet: Sequence[FootLoad], t_ns: Stamps) -> tuple[Vector, Vector]:
    """Return true normals and forces [N] of some feet at some times [ns], shape (times, feet, 3) each."""
    contacts = [[foot(t) for foot in feet] for t in t_ns.tolist()]
    normal, force_n = (np.array([[contact[k] for contact in row] for row in contacts]) for k in (0, 1))
    return normal, force_n


def simulate_conversions(
    foot: Specimen, feet: Sequence[FootLoad], order: tuple[int, ...], rate_sps: int, until_ns: int, seed: int
) -> SimulatedReadings:
    """Return simulated readings of several feet of one type, from time 0 on.

    Args:
        foot: The make.
        feet: Load of each foot.
        order: Elements in the order of the scan.
        rate_sps: Conversions per second.
        until_ns: End of the last scan [ns].
        seed: Seed of the noise.
    """
    step_ns, send_delay_ns = conversion_timing(rate_sps)
    n = (until_ns // (ELEMENTS * step_ns) + 1) * ELEMENTS
    t_ns = np.arange(1, n + 1, dtype=np.int64) * step_ns
    normal, force_n = (part.reshape(-1, 3) for part in true_normals_and_forces_n(feet, t_ns))
    all_pf = foot.capacitance_pf(normal, force_n).reshape(n, len(feet), ELEMENTS)
    rng = np.random.default_rng(seed)
    baseline_pf = quantized_capacitance_pf(
        np.tile(foot.unloaded_pf, (_N_TARE_SCANS, len(feet), 1)), rate_sps, rng
    ).mean(axis=0)
    scanned = np.resize(order, n)[:, None, None]
    read_pf = quantized_capacitance_pf(np.take_along_axis(all_pf, scanned, axis=2)[..., 0], rate_sps, rng)
    design = foot.response.design
    return SimulatedReadings(
        order=order,
        t_ns=t_ns,
        sent_ns=t_ns + send_delay_ns,
        plate_distance_rel=design.plate_distance_um(read_pf) / design.gap_um,
        unloaded_plate_distance_rel=design.plate_distance_um(baseline_pf) / design.gap_um,
    )


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
        closure_rel.append(readings.unloaded_plate_distance_rel - last.plate_distance_rel)
        age_s.append((now_ns - last.t_ns) * 1e-9)
    closures_rel = np.concatenate(closure_rel[_CONVERSIONS_TO_FILL_WINDOW:], axis=1).swapaxes(0, 1)
    ages_s = np.concatenate(age_s[_CONVERSIONS_TO_FILL_WINDOW:], axis=1).swapaxes(0, 1)
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
    readings: SimulatedReadings, network: LoadEstimator, trained: TrainedInputs, degree: int | None = None
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
