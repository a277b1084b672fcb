"""Simulated readings of feet of walking robots, for training: their impacts, bounces and leaning forces.

A log is of one robot; its loads are turned about the foot's axis, mirrored, scaled and made slower or faster at
random, so that a few minutes of walking are as many gaits as a network needs.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed

from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import ContactLoads
from footsense.frames import Vector
from footsense.lab.training.gait_readings import (
    GaitReadings,
    concatenate_gaits,
    draw_conditions,
    simulate_gait_readings,
)
from footsense.lab.walkers.simulate import WalkerLog
from footsense.progress import progress_bar
from footsense.sim.loads.load_log import RowsBetween

#: Force that one in a thousand loaded samples exceeds, over the largest force of the training [1], and its speed over
#: that of the log [1].
_PEAK_REL, _SPEED_REL = (0.05, 0.9), (0.75, 1.4)
#: Slowest conversion over the usual one [1]: a log ends.
_SLOWEST_REL = 1.6


class _FootLog(NamedTuple):
    """What one foot of a log feels, and the force that one in a thousand loaded samples of the robot exceeds [N]."""

    t_s: Vector
    force_n: Vector
    normal: Vector
    peak_n: float

    def loads(self, turn: Vector, start_s: float, speed_rel: float, t_s: Vector) -> ContactLoads:
        """Return the loads at n times [s], in a turned frame, the log repeated."""
        rows = RowsBetween.of(self.t_s, np.mod(start_s + speed_rel * t_s, self.t_s[-1]))
        normal = rows.normals(self.normal, self.force_n)
        return ContactLoads(normal @ turn.T, rows.values(self.force_n) @ turn.T)


def _walker_gait(
    response: FootResponse, log: _FootLog, n: int, max_n: float, rng: np.random.Generator
) -> GaitReadings:
    """Return the readings of a foot of a log under random conditions."""
    scale = rng.uniform(*_PEAK_REL) * max_n / log.peak_n
    around, mirror = rng.uniform(0.0, 2.0 * np.pi), rng.choice((-1.0, 1.0))
    sin, cos = np.sin(around), np.cos(around)
    turn = np.array([[cos, -mirror * sin, 0.0], [sin, mirror * cos, 0.0], [0.0, 0.0, 1.0]])
    loads = partial(
        log._replace(force_n=scale * log.force_n).loads,
        turn,
        rng.uniform(0.0, log.t_s[-1]),
        float(np.exp(rng.uniform(*np.log(_SPEED_REL)))),
    )
    conditions = draw_conditions(rng, slowest_rel=_SLOWEST_REL)
    return simulate_gait_readings(response, loads, conditions, rng, n)


def walker_gaits(
    response: FootResponse, logs: Sequence[WalkerLog], seed: int, m: int, n: int, max_n: float, jobs: int = 1
) -> GaitReadings:
    """Return simulated readings of m gaits of n conversions, of random feet of logs.

    Args:
        response: Response of the foot.
        logs: Logs of walking robots.
        seed: Seed of the draws; the same gives the same, on any number of processes.
        m: Number of gaits.
        n: Conversions of each.
        max_n: Largest force of the training [N].
        jobs: Processes.
    """
    feet = [
        _FootLog(log.t_s, log.force_n[:, leg], log.normal[:, leg], peak_n)
        for log, peak_n in ((log, log.peak_n()) for log in logs)
        for leg in range(len(log.legs))
    ]
    rngs = [np.random.default_rng(own) for own in np.random.SeedSequence((seed, 1)).spawn(m)]
    making = Parallel(n_jobs=jobs, return_as="generator")(
        delayed(_walker_gait)(response, feet[rng.integers(len(feet))], n, max_n, rng) for rng in rngs
    )
    made: list[GaitReadings] = []
    with progress_bar("walkers", m) as gaits_done:
        for gait in making:
            made.append(gait)
            gaits_done(len(made))
    return concatenate_gaits(made)
