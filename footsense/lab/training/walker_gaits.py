"""Simulated readings of feet of walking robots, for training: their impacts, bounces and leaning forces.

A log is of one robot; its loads are turned about the foot's axis, mirrored, scaled and made slower or faster at
random, so that a few minutes of walking are as many gaits as a network needs. In swing the foot's own mass pulls at the
sensor, which is no force of the ground: over the peak as where a robot loads the foot to half of its largest force.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple, Self

import numpy as np
from joblib import delayed

from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import ContactLoads
from footsense.frames import Vector
from footsense.lab.training.gait_readings import (
    GaitReadings,
    draw_conditions,
    simulate_gait_readings,
    simulate_side_by_side,
)
from footsense.lab.walkers.simulate import WalkerLog
from footsense.sim.loads.load_log import RowsBetween

#: Force that one in a thousand loaded samples exceeds, over the largest force of the training [1], and its speed over
#: that of the log [1].
_PEAK_REL, _SPEED_REL = (0.05, 0.9), (0.75, 1.4)
#: Peak over the largest force of the training [1] at which the foot's mass counts as it is.
_INERTIAL_PEAK_REL = 0.5
#: Slowest conversion over the usual one [1]: a log ends.
_SLOWEST_REL = 1.6


class _FootLog(NamedTuple):
    """What one foot of a log feels, and the force that one in a thousand loaded samples of the robot exceeds [N]."""

    t_s: Vector
    force_n: Vector
    inertial_n: Vector
    normal: Vector
    peak_n: float

    def scaled(self, max_n: float, scale: float, speed_rel: float) -> Self:
        """Return the log with scaled forces, on a foot of a largest force [N], at another speed."""
        inertial = scale * self.peak_n / (_INERTIAL_PEAK_REL * max_n) * speed_rel**2
        return self._replace(force_n=scale * self.force_n, inertial_n=inertial * self.inertial_n)

    def loads(self, turn: Vector, start_s: float, speed_rel: float, felt: bool, t_s: Vector) -> ContactLoads:  # noqa: FBT001 - bound by a partial
        """Return the loads at n times [s], in a turned frame, the log repeated; or what is felt of them."""
        rows = RowsBetween.of(self.t_s, np.mod(start_s + speed_rel * t_s, self.t_s[-1]))
        normal = rows.normals(self.normal, self.force_n)
        force_n = rows.values(self.force_n + self.inertial_n if felt else self.force_n)
        return ContactLoads(normal @ turn.T, force_n @ turn.T)


def _walker_gait(
    response: FootResponse, log: _FootLog, n: int, max_n: float, rng: np.random.Generator
) -> GaitReadings:
    """Return the readings of a foot of a log under random conditions."""
    scale = rng.uniform(*_PEAK_REL) * max_n / log.peak_n
    around, mirror = rng.uniform(0.0, 2.0 * np.pi), rng.choice((-1.0, 1.0))
    sin, cos = np.sin(around), np.cos(around)
    turn = np.array([[cos, -mirror * sin, 0.0], [sin, mirror * cos, 0.0], [0.0, 0.0, 1.0]])
    start_s, speed_rel = rng.uniform(0.0, log.t_s[-1]), float(np.exp(rng.uniform(*np.log(_SPEED_REL))))
    loads, felt = (
        partial(log.scaled(max_n, scale, speed_rel).loads, turn, start_s, speed_rel, felt)
        for felt in (False, True)
    )
    conditions = draw_conditions(rng, _SLOWEST_REL)
    return simulate_gait_readings(response, loads, conditions, rng, n, felt)


def walker_gaits(
    response: FootResponse,
    logs: Sequence[WalkerLog],
    force_unit: float,
    seed: int,
    m: int,
    n: int,
    max_n: float,
    jobs: int = 1,
) -> GaitReadings:
    """Return simulated readings of m gaits of n conversions, of random feet of logs.

    Args:
        response: Response of the foot.
        logs: Logs of walking robots.
        force_unit: Newtons in a unit of the response's forces and of `max_n` [1].
        seed: Seed of the draws; the same gives the same, on any number of processes.
        m: Number of gaits.
        n: Conversions of each.
        max_n: Largest force of the training [N].
        jobs: Processes.
    """
    feet = [
        _FootLog(log.t_s, log.force_n[:, leg], inertial_n[:, leg], log.normal[:, leg], peak_n)
        for log, inertial_n, peak_n in (
            (log, log.inertial_n(response.ball_radius_mm) / force_unit, log.peak_n()) for log in logs
        )
        for leg in range(len(log.legs))
    ]
    rngs = [np.random.default_rng(own) for own in np.random.SeedSequence((seed, 1)).spawn(m)]
    calls = (delayed(_walker_gait)(response, feet[rng.integers(len(feet))], n, max_n, rng) for rng in rngs)
    return simulate_side_by_side(calls, m, jobs, "walkers")
