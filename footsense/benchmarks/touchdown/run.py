"""Frames of the daemon's pipeline for feet that touch down, at the pace of the study `tradeoff`."""

from dataclasses import dataclass

import numpy as np

from footsense.benchmarks.latency_vs_error.chain import latest, noise_rel, pace
from footsense.benchmarks.touchdown.readings import ORDER, RATE_SPS, readings_pf
from footsense.benchmarks.touchdown.touchdowns import CONTACT_N, Steps
from footsense.estimation.alignment.element_by_element import ElementByElement
from footsense.estimation.alignment.scan_by_scan import ScanByScan
from footsense.estimation.baseline.contact import ContactLimits
from footsense.estimation.baseline.tare import TareLimits
from footsense.estimation.pipeline import Pipeline
from footsense.estimation.sensitivity import sensitivity
from footsense.foot.specimen import Foot
from footsense.frames import ELEMENTS, CapFrame, Flag, Mask, Reading, Vector
from footsense.lab.studies.page import StudyContext

#: Ways to read a foot.
FRAME, ELEMENT = METHODS = ("full scan per frame", "element by element")


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """Published frames, shape (frames, feet) each but for the times.

    Attributes:
        sent_s: Time of sending [s], shape (frames,).
        contact: Flag CONTACT.
        force_n: Force along the leg [N], NaN without one.
        true_force_n: True force along the leg at the time of sending [N].
        swings: Whether the foot was in swing.
    """

    sent_s: Vector
    contact: Mask
    force_n: Vector
    true_force_n: Vector
    swings: Mask


def run(context: StudyContext, method: str, steps: Steps, until_s: float, seed: int) -> Run:
    """Return the frames of feet that touch down.

    Args:
        context: Response table and network.
        method: One of `METHODS`.
        steps: Steps of the feet.
        until_s: End of the run [s].
        seed: Seed of noise and drift.
    """
    step_ns, lead_ns = pace(RATE_SPS)
    n_feet, n = len(steps.kind), int(until_s * 1e9) // step_ns
    t_ns = np.arange(1, n + 1, dtype=np.int64) * step_ns
    read_pf = readings_pf(Foot(context.response, contact=False), steps, t_ns, np.random.default_rng(seed))
    pipeline = _pipeline(context, method, n_feet)
    each = ELEMENTS if method == FRAME else 1
    numbers = latest(ORDER, n)[::each]
    sent_ns = (t_ns + lead_ns)[ELEMENTS - 1 :: each]
    ok = np.full((n_feet, ELEMENTS), Reading.OK, np.uint8)
    contact, force_n = [], []
    for sequence, (number, now_ns) in enumerate(zip(numbers, sent_ns.tolist(), strict=True)):
        frame = CapFrame(sequence, np.tile(t_ns[number], (n_feet, 1)), read_pf[number].T.copy(), ok)
        forces, _ = pipeline.process(frame, now_ns)
        contact.append(forces.flags & Flag.CONTACT > 0)
        force_n.append(forces.force_n[:, 2])
    sent_s = sent_ns / 1e9
    true_force_n = steps.force_n(sent_s) * steps.upright
    return Run(sent_s, np.array(contact), np.array(force_n), true_force_n, steps.swings(sent_s))


def _pipeline(context: StudyContext, method: str, n_feet: int) -> Pipeline:
    """Return the daemon's pipeline of as many legs as there are feet."""
    network = context.network
    card = context.trained_inputs
    design, step_ns = card.design, pace(RATE_SPS).step_ns
    alignment = (
        ScanByScan(network, n_feet, card.moments)
        if method == FRAME
        else ElementByElement(network, n_feet, card.moments, ORDER, step_ns, noise_rel(design, RATE_SPS))
    )
    return Pipeline(
        alignment,
        card,
        np.zeros((n_feet, ELEMENTS)),
        np.full((n_feet, ELEMENTS), design.unloaded_pf),
        sensitivity=sensitivity(network, 1, card.moments),
        tare=TareLimits(window_frames=8, noise_limit_ff=5.0, unloaded_limit_rel=0.03),
        contact=ContactLimits(threshold_n=CONTACT_N),
        max_age_ns=4 * ELEMENTS * step_ns,
        settled_ns=4 * ELEMENTS * step_ns,
    )
