"""Whole walks of six simulated feet through the released network: an ageing foot raises an alarm, a sound one does not.

Only chips and buses are left out: what the converters would read at each conversion is computed once for a stride.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from footsense.acquisition.scan_plan import CONVERSION_ORDERS
from footsense.config import DEFAULT, Config
from footsense.daemon.estimation import pipeline_for
from footsense.daemon.foot_types import released_path
from footsense.daemon.models import load_models
from footsense.estimation.faults.calibration_monitor import REFERENCE_STRIDES
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Foot
from footsense.frames import ELEMENTS, LEGS, CapFrame, Cause, State, Vector
from footsense.sim.foot.warming import relative_compliance_when_warmed
from footsense.sim.loads.walk import Walk, smooth_stance_reaction

SCAN_NS, FRAMES = 24_400_000, 32
PERIOD_NS = FRAMES * SCAN_NS
STEP_NS = SCAN_NS // ELEMENTS
#: When each element of a scan is converted, before its end [ns].
BEFORE_NS = SCAN_NS - STEP_NS * np.argsort(CONVERSION_ORDERS["lo_shu"])
LEAD_IN = 20
NOISE_PF, SCATTER_REL = 0.47e-3, 0.05
RM = LEGS.index("rm")

MODELS = load_models(DEFAULT)


@cache
def stride_pf(relative_compliance: float) -> tuple[Vector, Vector]:
    """Return what a scan of a foot at rest reads, and those of a stride by frame and leg [pF]."""
    foot = Foot(FootResponse.load(released_path("response.npz")))
    reaction = smooth_stance_reaction(0.6, 0.8, 0.15)
    walk = Walk(dict.fromkeys(LEGS, reaction), PERIOD_NS, duty_rel=0.6, pitch_deg=10.0, from_ns=0)
    scans = np.empty((FRAMES, len(LEGS), ELEMENTS))
    for row, leg in enumerate(LEGS):
        for frame in range(FRAMES):
            # A stride later, when the second tripod has begun too.
            t_ns = (FRAMES + frame) * SCAN_NS - BEFORE_NS
            contacts = [walk.contact(leg, t) for t in t_ns.tolist()]
            normal = np.array([contact.normal for contact in contacts])
            force_n = np.array([contact.force_n for contact in contacts])
            scans[frame, row] = foot.capacitance_pf(normal, force_n * relative_compliance).diagonal()
    return foot.unloaded_pf, scans


def walk(
    strides: int, then: Vector | float = 1.0, config: Config = DEFAULT
) -> tuple[dict[str, int], list[float]]:
    """Walk until it is known what is usual, and on with feet of another compliance.

    Args:
        strides: How many then.
        then: Softness of each foot [1].
        config: The robot.

    Returns:
        In which of those strides each leg raised the alarm, and the forces along the last such leg in the
        stride after that [N].
    """
    pipeline = pipeline_for(replace(MODELS, config=config), 0)
    rng = np.random.default_rng(2)
    relative_compliance = np.broadcast_to(then, len(LEGS))
    unloaded_pf, sound_pf = stride_pf(1.0)
    aged_pf = np.stack([stride_pf(float(s))[1][:, row] for row, s in enumerate(relative_compliance)], axis=1)
    alarms: dict[str, int] = {}
    forces_n: list[float] = []
    reading = np.zeros((len(LEGS), ELEMENTS), np.uint8)
    for stride in range(-REFERENCE_STRIDES - 3, strides):
        of_stride = aged_pf if stride >= 0 else sound_pf
        # One stride is never quite like another.
        carries_rel = 1 + SCATTER_REL * rng.standard_normal((len(LEGS), 1))
        for frame in range(FRAMES):
            number = (stride + REFERENCE_STRIDES + 3) * FRAMES + frame
            capacitance_pf = unloaded_pf + carries_rel * (of_stride[frame] - unloaded_pf)
            if number < LEAD_IN:
                capacitance_pf = np.tile(unloaded_pf, (len(LEGS), 1))
            capacitance_pf = capacitance_pf + NOISE_PF * rng.standard_normal(reading.shape)
            now_ns = (number + 1) * SCAN_NS
            t_ns = np.tile(now_ns - BEFORE_NS, (len(LEGS), 1))
            out, _ = pipeline.process(CapFrame(number, t_ns, capacitance_pf, reading), now_ns)
            stale = out.cause == Cause.CALIBRATION_STALE
            for row in np.flatnonzero(stale).tolist():
                alarms.setdefault(LEGS[row], stride)
                assert out.state[row] == State.VALID
                forces_n.append(float(out.force_n[row, 2]))
    return alarms, forces_n


def test_a_foot_that_became_softer_is_named_and_its_forces_stay() -> None:
    """15 % more closure under the same load: found within 20 strides on that leg alone; the force is as it is read."""
    aged = np.ones(len(LEGS))
    aged[RM] = 1.15
    alarms, forces_n = walk(22, aged)
    assert list(alarms) == ["rm"]
    assert alarms["rm"] <= 20
    assert max(forces_n) > 0.85


@pytest.mark.parametrize(
    "relative_compliance", [1.0, relative_compliance_when_warmed(20.0)], ids=["as before", "20 K warmer"]
)
def test_sound_feet_raise_no_alarm(relative_compliance: float) -> None:
    """Nor feet that are 20 K warmer, which takes 8 % of every force."""
    assert walk(60, relative_compliance)[0] == {}
