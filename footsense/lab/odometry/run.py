"""The filter of `examples/odometry.py` on a walk, with contact from many sources at once."""

from collections.abc import Sequence
from functools import cache
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from footsense.errors import FootsenseError
from footsense.frames import Vector
from footsense.lab.odometry.sources import Holds, Loads, Source, VectorForces
from footsense.lab.odometry.walk import STEP_S, OdometryWalk, Senses

#: Squared innovation of a foothold from which the gate sets it down anew: one in a thousand of a right filter.
GATE = 16.3
#: Noise of a foothold behind the gate, which finds those that slide, over that without one [1].
GATED_NOISE_REL = 1.0 / 3.0

#: Power of the probability of holding that is the share of a firm foot's noise [1]: a doubtful foothold is a soft one.
SURE_POWER = 4


class Filter(NamedTuple):
    """One filter: what it knows of the footholds, and whether it has a gate."""

    source: Source
    gated: bool


@cache
def example() -> Any:
    """Return the module `examples/odometry.py`.

    Raises:
        FootsenseError: It is not there, as in an installation without a checkout.
    """
    file = Path(__file__).parents[3] / "examples" / "odometry.py"
    spec = spec_from_file_location("footsense_odometry", file)
    if spec is None or spec.loader is None or not file.is_file():
        raise FootsenseError(f"no {file}: the odometry runs in a checkout")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def run_filters(walk: OdometryWalk, senses: Senses, filters: Sequence[Filter]) -> tuple[Vector, Vector]:
    """Return the poses of b filters that run together, at the rows of the walk.

    Args:
        walk: The walk.
        senses: What the robot senses of it.
        filters: The filters.

    Returns:
        Places [m], shape (n + 1, b, 3), and attitudes, shape (n + 1, b, 3, 3).

    Raises:
        FootsenseError: As of `example`.
    """
    n, n_legs = len(walk.rows) - 1, len(walk.robot.legs)

    def for_each(part: Vector) -> Vector:
        return np.broadcast_to(part, (len(filters), *part.shape))

    noise = np.empty((n, len(filters), n_legs))
    forces = []
    for row, one in enumerate(filters):
        if isinstance(one.source, Loads):
            noise[:, row] = example().foothold_noise(*one.source)
        elif isinstance(one.source, Holds):
            noise[:, row] = _noise_by_holds(one.source)
        else:
            forces.append((row, one.source))
    gated = np.array([one.gated for one in filters])
    firmness = np.where(gated, GATED_NOISE_REL, 1.0)[:, None]
    odometry = example().Odometry(
        for_each(senses.accel_at_rest), n_legs, walk.robot.foot_radius_m, np.where(gated, GATE, np.inf)
    )
    position_m, rotation = [odometry.columns[:, 1].copy()], [odometry.rotation]
    for k in range(n):
        _weigh(forces, odometry.rotation, k, walk.standing_n, noise[k])
        sensed = (for_each(part[k]) for part in senses[:4])
        odometry.step(STEP_S, *sensed, firmness * noise[k])
        position_m.append(odometry.columns[:, 1].copy())
        rotation.append(odometry.rotation)
    return np.stack(position_m), np.stack(rotation)


def _noise_by_holds(source: Holds) -> Vector:
    """Return the noise of the footholds, in its logarithm between that of a firm foot and that of one in the air."""
    share = np.nan_to_num(source.probability) ** SURE_POWER
    return np.asarray(example().FIRM ** share * example().IN_AIR ** (1.0 - share))


def _weigh(
    forces: Sequence[tuple[int, VectorForces]], rotation: Vector, k: int, standing_n: float, noise: Vector
) -> None:
    """Set the noise of the footholds of which forces are known at a step, by each filter's own attitude."""
    if forces:
        rows = [row for row, _ in forces]
        load_n, ratio = example().load_and_ratio(
            np.stack([one.force_n[k] for _, one in forces]), rotation[rows]
        )
        friction = np.array([one.friction for _, one in forces])[:, None]
        noise[rows] = example().foothold_noise(load_n / standing_n, ratio / friction)
