"""From loads to forces at the real pace: what the study `tradeoff` lets run.

The lab knows no bus and no chip. What the daemon makes of them is three numbers, which `firmware_interface/` has in
closed form: the time from one conversion to the next, the time from the middle of a conversion to the sending of its
force, and the converter's noise and step. All feet of a run are converted at the same times, as the legs of a robot
are; what makes forces of them is the daemon's own code.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_interface import fdc1004
from firmware_interface.can_frames import NODE_IDS
from firmware_interface.schedule import scan_limits
from footsense.estimation.alignment.element_by_element import ElementByElement
from footsense.estimation.alignment.scan_by_scan import ScanByScan
from footsense.estimation.pipeline import Reckoning
from footsense.foot.network_card import TrainedInputs
from footsense.foot.specimen import Foot
from footsense.frames import ELEMENTS
from footsense.ports import Estimator
from footsense.sim.loads.ground_load import Contact

Vector = NDArray[np.float64]
Stamps = NDArray[np.int64]
Mask = NDArray[np.bool_]

#: What one foot feels at a time [ns].
Felt = Callable[[int], Contact]

#: Orders of a scan by their names in the configuration.
ORDERS = {"raster": tuple(range(ELEMENTS)), "lo_shu": (5, 0, 7, 6, 4, 2, 1, 8, 3)}

#: One bus, its clock [Hz], and what the host adds to a transaction [ns]: a Raspberry Pi 4's planning value.
BUS_HZ, HOST_COST_NS = 400_000, 40_000
#: Scans that a tare averages.
_TARED_SCANS = 8


class Pace(NamedTuple):
    """When things happen.

    Attributes:
        step_ns: From one conversion to the next [ns].
        lead_ns: From the middle of a conversion to the sending of the force that it is part of [ns].
    """

    step_ns: int
    lead_ns: int


def pace(rate_sps: int) -> Pace:
    """Return the pace of six legs on one bus.

    The step is a ninth of the shortest scan. A force is sent when the scanner has waited for the slowest chip, which
    is half a conversion and the tolerance after its middle, and then has done what stands in a step at least: started
    the next one, asked whether all are done, and read the results of all legs.

    Args:
        rate_sps: Conversions per second: 100, 200 or 400.

    Example:
        >>> pace(400)
        Pace(step_ns=2716733, lead_ns=3234933)
    """
    conversion_ns = fdc1004.RATES[rate_sps].conversion_ns
    limits = scan_limits(
        n_legs=len(NODE_IDS),
        conversion_ns=conversion_ns,
        rate_hz=BUS_HZ,
        host_cost_ns=HOST_COST_NS,
        n_result_reads=_n_result_reads(rate_sps),
    )
    waits_ns = round(conversion_ns * (0.5 + fdc1004.CLOCK_TOLERANCE_REL))
    return Pace(limits.scan_ns // ELEMENTS, waits_ns + limits.readout_ns // ELEMENTS)


def _n_result_reads(rate_sps: int) -> int:
    """Return how many registers of a result are read: at 400 S/s noise hides what the lower one says."""
    return 1 if rate_sps == 400 else 2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Readings:
    """What the converters of some feet said, conversion by conversion.

    Attributes:
        order: Elements in the order of the scan.
        t_ns: Middle of each conversion [ns], shape (conversions,).
        sent_ns: When a force that ends with it is sent [ns], same shape.
        distance_rel: Distance of the plates over the gap [1], shape (conversions, feet).
        rest_rel: The same at the tare [1], shape (feet, 9).
        noise_rel: Standard deviation of one distance [1].
    """

    order: tuple[int, ...]
    t_ns: Stamps
    sent_ns: Stamps
    distance_rel: Vector
    rest_rel: Vector
    noise_rel: float

    def elements(self, back: int = 0) -> tuple[Vector, Stamps]:
        """Return readings of all elements and their stamps as they were known after each conversion.

        Args:
            back: Which: 0 the latest of each element, 1 the one before.

        Returns:
            Distances [1], shape (conversions, feet, 9), and stamps [ns], shape (conversions, 9); conversions before
            the first `back` + 1 scans are over have none, and begin at the first that has.
        """
        place = np.argsort(self.order)
        now = np.arange((back + 1) * ELEMENTS - 1, len(self.t_ns))[:, None]
        latest = now - (now - place) % ELEMENTS - back * ELEMENTS
        return self.distance_rel[latest].swapaxes(1, 2), self.t_ns[latest]


def felt_by(feet: Sequence[Felt], t_ns: Stamps) -> tuple[Vector, Vector]:
    """Return normals and forces [N] of some feet at some times [ns], shape (times, feet, 3) each."""
    contacts = [[foot(t) for foot in feet] for t in t_ns.tolist()]
    normal = np.array([[contact.normal for contact in row] for row in contacts])
    return normal, np.array([[contact.force_n for contact in row] for row in contacts])


def convert(
    foot: Foot, feet: Sequence[Felt], order: tuple[int, ...], rate_sps: int, until_ns: int, seed: int
) -> Readings:
    """Return what the converters say of some feet of one make from time 0 on.

    Args:
        foot: How they yield.
        feet: What each feels.
        order: Elements in the order of the scan.
        rate_sps: Conversions per second.
        until_ns: When the last scan may end [ns].
        seed: Of the noise.
    """
    step_ns, lead_ns = pace(rate_sps)
    n = (until_ns // (ELEMENTS * step_ns) + 1) * ELEMENTS
    t_ns = np.arange(1, n + 1, dtype=np.int64) * step_ns
    normal, force_n = felt_by(feet, t_ns)
    element = np.resize(order, n)
    all_pf = foot.capacitance_pf(normal.reshape(-1, 3), force_n.reshape(-1, 3)).reshape(
        n, len(feet), ELEMENTS
    )
    rng = np.random.default_rng(seed)
    noise_pf = fdc1004.RATES[rate_sps].noise_ff * 1e-3

    def converted_pf(capacitance_pf: Vector) -> Vector:
        seen_pf = capacitance_pf + noise_pf * rng.standard_normal(capacitance_pf.shape)
        unread = (
            1 if _n_result_reads(rate_sps) == 2 else 1 << 8
        )  # codes that the upper register does not tell
        told: Vector = np.floor(seen_pf * fdc1004.CODES_PER_PF / unread) * unread / fdc1004.CODES_PER_PF
        return told

    design = foot.response.design
    rest_pf = converted_pf(np.tile(foot.rest_pf, (_TARED_SCANS, len(feet), 1))).mean(axis=0)
    # dC / C = -d(distance) / distance.
    rest_um = design.plate_distance_um(np.array([design.rest_pf]))[0]
    seen_pf = converted_pf(np.take_along_axis(all_pf, element[:, None, None], axis=2)[..., 0])
    return Readings(
        order=order,
        t_ns=t_ns,
        sent_ns=t_ns + lead_ns,
        distance_rel=design.plate_distance_um(seen_pf) / design.gap_um,
        rest_rel=design.plate_distance_um(rest_pf) / design.gap_um,
        noise_rel=noise_pf / design.rest_pf * rest_um / design.gap_um,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Published:
    """Forces as a consumer gets them.

    Attributes:
        sent_ns: When each was sent [ns], shape (forces,).
        t_ns: How far its measurement reaches [ns], same shape.
        of_ns: The time that it speaks of [ns], same shape: `t_ns` where nothing is predicted, else `sent_ns`.
        force_n: Forces [N], shape (forces, feet, 3).
        sigma_n: Their standard deviations [N], same shape.
    """

    sent_ns: Stamps
    t_ns: Stamps
    of_ns: Stamps
    force_n: Vector
    sigma_n: Vector


def by_frame(readings: Readings, network: Estimator, card: TrainedInputs, n_averaged: int = 1) -> Published:
    """Return the forces of `publish: frame`: one for each scan."""
    reckoning = ScanByScan(network, len(readings.rest_rel), card.moments, n_averaged)
    return _reckoned(readings, reckoning, card, each=ELEMENTS)


def by_element(readings: Readings, network: Estimator, card: TrainedInputs) -> Published:
    """Return the forces of `publish: element`: one for each conversion."""
    step_ns = int(readings.t_ns[1] - readings.t_ns[0])
    reckoning = ElementByElement(
        network, len(readings.rest_rel), card.moments, readings.order, step_ns, readings.noise_rel
    )
    return _reckoned(readings, reckoning, card, each=1)


def _reckoned(readings: Readings, reckoning: Reckoning, card: TrainedInputs, each: int) -> Published:
    """Return the forces that the daemon makes of whole scans, or after each conversion."""
    n_feet = len(readings.rest_rel)
    nothing, everyone = np.zeros((n_feet, ELEMENTS), bool), np.ones(n_feet, bool)
    sent_ns = readings.sent_ns[ELEMENTS - 1 :: each]
    values, stamps = (part[::each] for part in readings.elements())
    t_ns, force_n, sigma_n = [], [], []
    for now_ns, known, known_ns in zip(sent_ns.tolist(), values, stamps, strict=True):
        moment = reckoning.align(known, np.tile(known_ns, (n_feet, 1)), now_ns, nothing)
        closure_rel = _trained(readings.rest_rel - moment.values, card)
        force, sigma = reckoning.estimate(closure_rel, readings.rest_rel, everyone, nothing)
        t_ns.append(int(moment.t_ns[0]))
        force_n.append(force)
        sigma_n.append(sigma)
    reaches_ns = np.array(t_ns)
    of_ns = sent_ns if each == 1 else reaches_ns
    return Published(sent_ns, reaches_ns, of_ns, np.array(force_n), np.array(sigma_n))


def as_read(readings: Readings, network: Estimator, card: TrainedInputs) -> Published:
    """Return the forces of whole scans whose elements are taken to be of one time, for comparison."""
    values, stamps = readings.elements()
    middle_ns = stamps[::ELEMENTS].mean(axis=1).astype(np.int64)
    force_n, sigma_n = _at_once(values[::ELEMENTS], readings, network, card)
    return Published(readings.sent_ns[ELEMENTS - 1 :: ELEMENTS], middle_ns, middle_ns, force_n, sigma_n)


def along(readings: Readings, network: Estimator, card: TrainedInputs, degree: int) -> Published:
    """Return the forces after each conversion if every element went on by itself, for comparison.

    Args:
        readings: What was read.
        network: What makes forces of closures.
        card: Its card.
        degree: 1: along the line through its last two readings; 2: along the parabola through its last three.
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
    return Published(sent_ns, readings.t_ns[first:], sent_ns, *_at_once(values, readings, network, card))


def _trained(closure_rel: Vector, card: TrainedInputs) -> Vector:
    """Return closures within what the network was taught, as the pipeline keeps them."""
    kept: Vector = np.clip(closure_rel, card.closure_rel_min, card.closure_rel_max)
    return kept


def _at_once(
    values: Vector, readings: Readings, network: Estimator, card: TrainedInputs
) -> tuple[Vector, Vector]:
    """Return the network's forces and sigmas [N], shape (forces, feet, 3), of distances, shape (forces, feet, 9)."""
    closure_rel = _trained(readings.rest_rel - values, card).reshape(-1, ELEMENTS)
    force_n, sigma_n = network.estimate(closure_rel, np.zeros(closure_rel.shape, bool))
    return force_n.reshape(*values.shape[:2], 3), sigma_n.reshape(*values.shape[:2], 3)
