"""The service's estimation on the feet of a walking robot: readings of a log, run through the whole pipeline.

Every conversion reads the next element of all feet under the load at its middle; the pipeline gets what a read of the
bus brings as a frame, and what it says is kept beside what the feet felt at the time of sending. In swing the foot's
own mass pulls at the sensor, by the accelerations of the log.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_interface.chips import ad7147, fdc1004
from footsense.estimation.network import Network
from footsense.estimation.pipeline import Pipeline, pipeline_of
from footsense.estimation.settings import ContactLimits, EstimationLimits, MountedFeet
from footsense.foot.parameters import FootParameters, ForceUncertainty
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Specimen
from footsense.frames import (
    ELEMENTS,
    CapFrame,
    Codes,
    GaitEvent,
    LegMotion,
    Mask,
    Reading,
    StepPhase,
    Vector,
)
from footsense.lab.training.gait_readings import conversion_elements, equivalent_elastic_load
from footsense.lab.walkers.robots import GRAVITY_M_S2
from footsense.lab.walkers.simulate import WalkerLog
from footsense.sim.loads.load_log import RowsBetween
from footsense.sim.scene import Ad7147Effects

#: Time in the air before a log, in which the feet are tared, and time in which its first loads rise [s].
LEAD_IN_S, _RISE_S = 0.7, 0.1
#: Loads that are turned into capacitances at once, which limits memory.
_LOADS_PER_CALL = 2048


class WalkerLoads(NamedTuple):
    """Loads of the feet of a robot at n times, and what its sensors feel besides.

    Attributes:
        t_s: Times [s], shape (n,).
        force_n: Ground reactions [N], shape (n, legs, 3).
        normal: Contact normals, same shape; up in the air.
        slip_m_s: Velocity of the contact points along the ground [m/s], same shape.
        felt_n: Forces on the sensors [N], same shape: in swing with those of the foot's own mass.
        acceleration_m_s2: Acceleration along each leg, less that at rest with the leg upright [m/s2], shape (n, legs).
        friction: Coefficient of friction.
    """

    t_s: Vector
    force_n: Vector
    normal: Vector
    slip_m_s: Vector
    felt_n: Vector
    acceleration_m_s2: Vector
    friction: float

    @classmethod
    def of_still_feet(cls, t_s: Vector, force_n: Vector, normal: Vector) -> "WalkerLoads":
        """Return the loads of feet without mass that do not slide, on a ground of unknown friction."""
        still = np.zeros_like(force_n)
        return cls(t_s, force_n, normal, still, force_n, still[:, :, 2], np.nan)

    def at(self, t_s: Vector) -> "WalkerLoads":
        """Return the loads at other times [s], linearly interpolated."""
        rows = RowsBetween.of(self.t_s, t_s)
        force_n, slip_m_s, felt_n = map(rows.values, (self.force_n, self.slip_m_s, self.felt_n))
        normal = rows.normals(self.normal, self.force_n)
        return self._replace(
            t_s=t_s,
            force_n=force_n,
            normal=normal,
            slip_m_s=slip_m_s,
            felt_n=felt_n,
            acceleration_m_s2=rows.values(self.acceleration_m_s2),
        )


def walker_loads(log: WalkerLog, scale: float, ball_radius_mm: float) -> WalkerLoads:
    """Return the loads of a log after a lead-in in the air.

    Args:
        log: The log.
        scale: Factor on its forces [1].
        ball_radius_mm: Radius of the foot's ball [mm], for its mass.
    """
    n_before = round(LEAD_IN_S / (log.t_s[1] - log.t_s[0]))
    n_legs = len(log.legs)
    t_s = np.concatenate([np.linspace(0.0, LEAD_IN_S, n_before, endpoint=False), LEAD_IN_S + log.t_s])
    risen = np.clip(log.t_s / _RISE_S, 0.0, 1.0)[:, None, None]
    air = np.zeros((n_before, n_legs, 3))
    force_n = np.concatenate([air, scale * risen * log.force_n])
    felt_n = force_n + np.concatenate([air, log.inertial_n(ball_radius_mm)])
    up = np.tile([0.0, 0.0, 1.0], (n_before, n_legs, 1))
    return WalkerLoads(
        t_s,
        force_n,
        np.concatenate([up, log.normal]),
        np.concatenate([air, log.slip_m_s]),
        felt_n,
        np.concatenate([air[:, :, 2], log.acceleration_m_s2[:, :, 2] - GRAVITY_M_S2]),
        log.friction,
    )


class ScanTimes(NamedTuple):
    """How a board reads six legs, as its simulation shows it.

    Attributes:
        elements: Elements that are new in each frame, over and over, shape (frames, elements); one that comes twice in
            a row counts once.
        lag_s: From the middle of each one's conversion to that of one that would end with the frame [s], same shape.
        step_s: From one frame to the next [s].
        send_delay_s: From the middle of a conversion that ends with a frame to the sending of its force [s].
        conversion_s: Time of a conversion, with the host's part of it [s].
        scan_ns: Shortest time of a scan, by which the service measures ages [ns].
        noise_pf: Noise of a conversion [pF, rms].
        range_end_pf: Largest capacitance that the converter reads [pF].
    """

    elements: NDArray[np.intp]
    lag_s: Vector
    step_s: float
    send_delay_s: float
    conversion_s: float
    scan_ns: int
    noise_pf: float
    range_end_pf: float

    @property
    def scan_s(self) -> float:
        """Time of a scan [s]."""
        return ELEMENTS * self.conversion_s


#: Host's time of a transaction in `SCAN_TIMES` [us].
HOST_COST_US = 100
_FDC1004_STEP_S, _AD7147_STAGE_S = 2.931e-3, 1e-9 * ad7147.DECIMATIONS[64].stage_ns
_ORDER = conversion_elements(0, ELEMENTS)
#: Conversions of an AD7147 from one frame to the next, the first that ends before a frame, and frames after which their
#: phase is the same again.
_AD7147_CONVERSIONS, _AD7147_PHASE, _AD7147_FRAMES = 8.8, 0.1, 45
_AD7147_ENDS = _AD7147_CONVERSIONS * np.arange(1, _AD7147_FRAMES + 1) + _AD7147_PHASE
#: Numbers of the last nine conversions before each frame; where eight are new, the oldest of them twice.
_AD7147_NUMBERS = np.maximum(
    np.floor(_AD7147_ENDS)[:, None] - np.arange(ELEMENTS)[::-1],
    np.floor(_AD7147_ENDS - _AD7147_CONVERSIONS)[:, None] + 1.0,
)
#: By board; the mean over the legs, `fdc1004` on one bus and `ad7147` on two.
SCAN_TIMES = {
    "ad7147": ScanTimes(
        elements=_ORDER[_AD7147_NUMBERS.astype(np.intp) % ELEMENTS],
        lag_s=_AD7147_STAGE_S * (_AD7147_ENDS[:, None] - _AD7147_NUMBERS),
        step_s=_AD7147_CONVERSIONS * _AD7147_STAGE_S,
        send_delay_s=2.672e-3 - 0.5 * _AD7147_STAGE_S,
        conversion_s=_AD7147_STAGE_S,
        scan_ns=ELEMENTS * ad7147.DECIMATIONS[64].stage_ns,
        noise_pf=1e-3 * Ad7147Effects().noise_ff,
        range_end_pf=ad7147.RANGE_END_PF,
    ),
    "fdc1004": ScanTimes(
        elements=_ORDER[:, None],
        lag_s=np.zeros((ELEMENTS, 1)),
        step_s=_FDC1004_STEP_S,
        send_delay_s=4.142e-3,
        conversion_s=_FDC1004_STEP_S,
        scan_ns=ELEMENTS * fdc1004.RATES[400].conversion_ns,
        noise_pf=1e-3 * fdc1004.RATES[400].noise_ff,
        range_end_pf=fdc1004.RANGE_END_PF,
    ),
}


class WalkerReadings(NamedTuple):
    """Readings of the feet of a robot, one frame after another.

    Attributes:
        scan: Their scan.
        t_s: Middle of each conversion [s], shape (n, elements of a frame).
        elements: Elements that were read, same shape.
        capacitance_pf: What was read [pF], shape (n, legs, elements of a frame).
        loads: True loads at the times of sending.
        all_loads: True loads at all times.
    """

    scan: ScanTimes
    t_s: Vector
    elements: NDArray[np.intp]
    capacitance_pf: Vector
    loads: WalkerLoads
    all_loads: WalkerLoads


def read_walker(
    foot: Specimen,
    loads: WalkerLoads,
    seed: int,
    *,
    scan: ScanTimes,
    viscous_rel: float = 0.0,
) -> WalkerReadings:
    """Return simulated readings of the feet of a robot.

    Args:
        foot: The foot on every leg.
        loads: Their loads.
        seed: Seed of the noise.
        scan: How the feet are read.
        viscous_rel: Creep and lag of the rubber over those of the simulated rubber [1].
    """
    rng = np.random.default_rng(seed)
    n = int((loads.t_s[-1] - scan.step_s) / scan.step_s)
    t_s = np.asarray(scan.step_s * np.arange(1.0, n + 1), np.float64)
    row = np.arange(n) % len(scan.elements)
    elements, converted_s = scan.elements[row], t_s[:, None] - scan.lag_s[row]
    middles_s, at = np.unique(converted_s, return_inverse=True)
    at = at.reshape(converted_s.shape)
    read = loads.at(middles_s)
    n_legs = loads.force_n.shape[1]
    capacitance_pf = np.empty((n, n_legs, elements.shape[1]))
    for leg in range(n_legs):
        normal, force_n = read.normal[:, leg], read.felt_n[:, leg]
        if viscous_rel:
            normal, force_n = equivalent_elastic_load(middles_s, normal, force_n, viscous_rel, "assumed")
        whole_pf = np.tile(foot.unloaded_pf, (len(middles_s), 1))
        rows = np.flatnonzero(force_n.any(axis=1))
        for first in range(0, len(rows), _LOADS_PER_CALL):
            some = rows[first : first + _LOADS_PER_CALL]
            whole_pf[some] = foot.capacitance_pf(normal[some], force_n[some])
        capacitance_pf[:, leg] = whole_pf[at, elements]
    capacitance_pf += scan.noise_pf * rng.normal(size=capacitance_pf.shape)
    sent = loads.at(t_s + scan.send_delay_s)
    return WalkerReadings(scan, converted_s, elements, capacitance_pf, sent, loads)


class ToldMotion(NamedTuple):
    """How a gait controller tells the motion of the legs.

    Attributes:
        late_s: From the motion to its arrival [s].
        sigma_m_s2: Standard deviation that it tells [m/s2].
        period_s: Time from one to the next [s].
    """

    late_s: float = 2e-3
    sigma_m_s2: float = 0.5
    period_s: float = 10e-3

    def at(self, loads: WalkerLoads, t_s: float) -> LegMotion:
        """Return the newest motion of all legs at a time [s]."""
        told_s = (t_s // self.period_s) * self.period_s
        row = max(int(np.searchsorted(loads.t_s, told_s - self.late_s)) - 1, 0)
        acceleration = loads.acceleration_m_s2[row]
        n_legs = len(acceleration)
        return LegMotion(
            t_ns=np.full(n_legs, round(1e9 * told_s)),
            acceleration_m_per_s2=acceleration,
            sigma_m_per_s2=np.full(n_legs, self.sigma_m_s2),
            up=np.tile([0.0, 0.0, 1.0], (n_legs, 1)),
            phase=np.full(n_legs, StepPhase.UNKNOWN, np.uint8),
        )


class WalkerOutputs(NamedTuple):
    """What the pipeline said after each of n frames, beside the truth at the times of sending.

    Attributes:
        t_s: Times of sending [s], shape (n,).
        true: True loads at them.
        all_loads: True loads at all times, by which touches begin and end.
        force_n: Forces [N], shape (n, legs, 3), NaN where there is none.
        sigma_n: Their standard deviations [N], same shape.
        state: State of each leg, shape (n, legs).
        contact: Whether contact is reported, same shape.
        holds: Probability that each foot stands still on the ground, same shape.
        events: Every event, with the row of the frame after which it was reported.
    """

    t_s: Vector
    true: WalkerLoads
    all_loads: WalkerLoads
    force_n: Vector
    sigma_n: Vector
    state: Codes
    contact: Mask
    holds: Vector
    events: list[tuple[int, GaitEvent]]


def judging_pipeline(
    network: Network,
    response: FootResponse,
    scan: ScanTimes,
    feet: Sequence[FootParameters | None],
    *,
    friction: float | None = None,
    uncertainty: Sequence[ForceUncertainty] = (),
) -> Pipeline:
    """Return the service's pipeline.

    Args:
        network: The network, for as many rows as there are feet.
        response: Response table that it was trained on.
        scan: How the feet are read.
        feet: Calibration of each, None for a foot as designed.
        friction: Coefficient of friction of the ground, as if configured [1]; None for none.
        uncertainty: What nobody knows of the feet, as of `MountedFeet.of`.
    """
    return pipeline_of(
        network,
        MountedFeet.of(network.card.trained_inputs.design, feet, uncertainty=uncertainty),
        EstimationLimits(
            scan_ns=scan.scan_ns, range_end_pf=scan.range_end_pf, contact=ContactLimits(friction=friction)
        ),
        response,
    )


def run_pipeline(
    pipeline: Pipeline,
    readings: WalkerReadings,
    motion: ToldMotion | None = None,
) -> WalkerOutputs:
    """Return what a pipeline says of readings, frame by frame.

    Args:
        pipeline: The pipeline.
        readings: The readings.
        motion: How the motion of the legs is told; None where it is not.
    """
    n, n_legs, _ = readings.capacitance_pf.shape
    t_ns = np.zeros((n_legs, ELEMENTS), np.int64)
    capacitance_pf = np.full((n_legs, ELEMENTS), np.nan)
    reading = np.full((n_legs, ELEMENTS), Reading.NOT_READY, np.uint8)
    sent_ns = (1e9 * readings.loads.t_s).astype(np.int64).tolist()
    read_ns = (1e9 * readings.t_s).astype(np.int64)
    over = readings.capacitance_pf >= readings.scan.range_end_pf
    frames, events = [], []
    contact = np.zeros((n, n_legs), bool)
    for k, elements in enumerate(readings.elements.tolist()):
        t_ns[:, elements] = read_ns[k]
        capacitance_pf[:, elements] = np.where(over[k], np.nan, readings.capacitance_pf[k])
        reading[:, elements] = np.where(over[k], Reading.OVER_RANGE, Reading.OK)
        if motion is not None:
            pipeline.set_motion(motion.at(readings.all_loads, sent_ns[k] * 1e-9))
        frame, _ = pipeline.process(
            CapFrame(k, t_ns.copy(), capacitance_pf.copy(), reading.copy()), sent_ns[k]
        )
        frames.append((frame.force_n, frame.sigma_n, frame.state, frame.holds))
        contact[k] = [leg.in_contact for leg in pipeline._baselines.contacts]  # noqa: SLF001
        if frame.gait is not None:
            events += [(k, event) for event in frame.gait.events]
    force_n, sigma_n, state, holds = (np.array(part) for part in zip(*frames, strict=True))
    return WalkerOutputs(
        t_s=readings.loads.t_s,
        true=readings.loads,
        all_loads=readings.all_loads,
        force_n=force_n,
        sigma_n=sigma_n,
        state=state,
        contact=contact,
        holds=holds,
        events=events,
    )
