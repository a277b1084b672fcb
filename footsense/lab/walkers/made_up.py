"""Loads of feet that are made up: that are set down slowly, and that shake."""

from typing import NamedTuple

import numpy as np

from footsense.frames import LEGS, Vector
from footsense.lab.walkers.shaking_loads import shaking_foot
from footsense.lab.walkers.simulate import LOG_STEP_S, WalkerLog
from footsense.lab.walkers.slow_loads import slow_foot

#: Their gaits.
SLOW, SHAKING = "slow", "shaking"
_FEET = {SLOW: slow_foot, SHAKING: shaking_foot}
_FRICTION = 0.8


class MadeUpLoads(NamedTuple):
    """Loads of six feet that do not slide.

    Attributes:
        gait: `SLOW` or `SHAKING`.
        seed: Their seed; each foot has a part of it.
        duration_s: Duration [s].
    """

    gait: str
    seed: int
    duration_s: float

    @property
    def name(self) -> str:
        """What they are called."""
        return f"{self.gait} {self.seed}"

    @property
    def kind(self) -> str:
        """Kind of robot that they are of: of any."""
        return ""

    def kept_log(self) -> WalkerLog:
        """Return the loads over their peak."""
        t_s: Vector = np.asarray(LOG_STEP_S * np.arange(round(self.duration_s / LOG_STEP_S)), np.float64)
        feet = [_FEET[self.gait](t_s, rng) for rng in np.random.default_rng(self.seed).spawn(len(LEGS))]
        force_n, normal, acceleration_m_s2 = (np.stack(part, axis=1) for part in zip(*feet, strict=True))
        return WalkerLog(LEGS, t_s, force_n, normal, np.zeros_like(force_n), acceleration_m_s2, _FRICTION)
