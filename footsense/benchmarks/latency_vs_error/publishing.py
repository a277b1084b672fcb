"""Forces of readings, aligned and inferred by the daemon's own code, or by simpler methods for comparison."""

from dataclasses import dataclass

import numpy as np

from footsense.benchmarks.latency_vs_error.chain import Readings
from footsense.estimation.alignment.element_by_element import ElementByElement
from footsense.estimation.alignment.scan_by_scan import ScanByScan
from footsense.foot.files.network_card import TrainedInputs
from footsense.frames import ELEMENTS, Stamps, Vector
from footsense.ports import Estimator


@dataclass(frozen=True, slots=True, eq=False)
class PublishedForces:
    """Published forces [N] with standard deviations [N] and time stamps [ns].

    Attributes:
        sent_ns: Time of sending [ns], shape (forces,).
        newest_reading_ns: Time of the newest reading in each [ns], same shape.
        valid_ns: Time that each force is valid for [ns], same shape: `newest_reading_ns`, or `sent_ns` of a
            prediction.
        force_n: Forces [N], shape (forces, feet, 3).
        sigma_n: Their standard deviations [N], same shape.
    """

    sent_ns: Stamps
    newest_reading_ns: Stamps
    valid_ns: Stamps
    force_n: Vector
    sigma_n: Vector


def by_frame(
    readings: Readings, network: Estimator, card: TrainedInputs, n_averaged: int = 1
) -> PublishedForces:
    """Return the forces of `publish: frame`: one for each scan."""
    alignment = ScanByScan(network, len(readings.unloaded_rel), card.moments, n_averaged)
    return _aligned(readings, alignment, card, each=ELEMENTS)


def by_element(readings: Readings, network: Estimator, card: TrainedInputs) -> PublishedForces:
    """Return the forces of `publish: element`: one for each conversion."""
    step_ns = int(readings.t_ns[1] - readings.t_ns[0])
    alignment = ElementByElement(
        network, len(readings.unloaded_rel), card.moments, readings.order, step_ns, readings.noise_rel
    )
    return _aligned(readings, alignment, card, each=1)


def _aligned(
    readings: Readings, alignment: ScanByScan | ElementByElement, card: TrainedInputs, each: int
) -> PublishedForces:
    """Return the forces of the daemon after each conversion, or after each `each`-th."""
    n_feet = len(readings.unloaded_rel)
    nothing, everyone = np.zeros((n_feet, ELEMENTS), bool), np.ones(n_feet, bool)
    sent_ns = readings.sent_ns[ELEMENTS - 1 :: each]
    values, stamps = (part[::each] for part in readings.elements())
    t_ns, force_n, sigma_n = [], [], []
    for now_ns, distance_rel, stamps_ns in zip(sent_ns.tolist(), values, stamps, strict=True):
        sample = alignment.align(distance_rel, np.tile(stamps_ns, (n_feet, 1)), now_ns, nothing)
        closure_rel = _trained(readings.unloaded_rel - sample.distance_rel, card)
        force, sigma = alignment.estimate(closure_rel, readings.unloaded_rel, everyone, nothing)
        t_ns.append(int(sample.t_ns[0]))
        force_n.append(force)
        sigma_n.append(sigma)
    newest_ns = np.array(t_ns)
    valid_ns = sent_ns if each == 1 else newest_ns
    return PublishedForces(sent_ns, newest_ns, valid_ns, np.array(force_n), np.array(sigma_n))


def without_alignment(readings: Readings, network: Estimator, card: TrainedInputs) -> PublishedForces:
    """Return the forces of whole scans whose elements count as simultaneous, for comparison."""
    values, stamps = readings.elements()
    middle_ns = stamps[::ELEMENTS].mean(axis=1).astype(np.int64)
    force_n, sigma_n = _inferred(values[::ELEMENTS], readings, network, card)
    return PublishedForces(readings.sent_ns[ELEMENTS - 1 :: ELEMENTS], middle_ns, middle_ns, force_n, sigma_n)


def extrapolated(readings: Readings, network: Estimator, card: TrainedInputs, degree: int) -> PublishedForces:
    """Return the forces after each conversion with every element extrapolated by itself, for comparison.

    Args:
        readings: The readings.
        network: The network.
        card: The inputs that it was trained for.
        degree: 1: along the line through the last two readings; 2: along the parabola through the last three.
    """
    first = (degree + 1) * ELEMENTS - 1
    sent_ns = readings.sent_ns[first:]
    (y0, t0), (y1, t1), *older = (
        (values[-len(sent_ns) :], stamps[-len(sent_ns) :, None] * 1e-9)
        for values, stamps in map(readings.elements, range(degree + 1))
    )
    to_s = sent_ns[:, None, None] * 1e-9
    slope = (y0 - y1) / (t0 - t1)
    values = y0 + slope * (to_s - t0)
    for y2, t2 in older:
        bend = (slope - (y1 - y2) / (t1 - t2)) / (t0 - t2)
        values = values + bend * (to_s - t0) * (to_s - t1)
    return PublishedForces(
        sent_ns, readings.t_ns[first:], sent_ns, *_inferred(values, readings, network, card)
    )


def _trained(closure_rel: Vector, card: TrainedInputs) -> Vector:
    """Return relative closures [1] clipped to the training range, as in the estimation pipeline."""
    limited: Vector = np.clip(closure_rel, card.closure_rel_min, card.closure_rel_max)
    return limited


def _inferred(
    distance_rel: Vector, readings: Readings, network: Estimator, card: TrainedInputs
) -> tuple[Vector, Vector]:
    """Return forces and sigmas [N], shape (forces, feet, 3), of distances [1], shape (forces, feet, 9)."""
    closure_rel = _trained(readings.unloaded_rel - distance_rel, card).reshape(-1, ELEMENTS)
    force_n, sigma_n = network.estimate(closure_rel, np.zeros(closure_rel.shape, bool))
    return force_n.reshape(*distance_rel.shape[:2], 3), sigma_n.reshape(*distance_rel.shape[:2], 3)
