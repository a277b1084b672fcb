"""How wrong a calibrated foot will be because its parameters are not known better: said before anyone relies on it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.calibration.fit import PRIOR, Fit
from footsense.calibration.twin import STIFFNESS, FootTwin, Load, names
from footsense.core.force_errors import direction_errors_deg
from footsense.errors import CalibrationError
from footsense.sim.poking import GRAM_FORCE_N

Vector = NDArray[np.float64]

#: Beyond this no pack is made: what a foot as designed would do after a careless assembly is not much worse.
_MOST_DEG, _MOST_REL = 6.0, 0.15
_DRAWS = 24
_SEED = 1
#: Said to be told by the pokes if they took half of what was not known.
TOLD_REL = 0.5


class Foreseen(NamedTuple):
    """Expected errors of loads all over the ball, by what is not known of the foot.

    Attributes:
        direction_deg: Root mean square angle [deg].
        magnitude_rel: Root mean square error of the magnitude, relative [1].
        untold: Names of the parameters of which the pokes told little.
    """

    direction_deg: float
    magnitude_rel: float
    untold: tuple[str, ...]


def loads_n() -> Vector:
    """Return forces all over the ball down to 45 deg, at 50 and 120 gf [N], shape (50, 3)."""
    azimuth, elevation = np.meshgrid(np.radians(30.0 * np.arange(12)), np.radians([50.0, 70.0]))
    ring = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=-1
    ).reshape(-1, 3)
    directions = np.concatenate([ring, [[0.0, 0.0, 1.0]]])
    return np.concatenate([size * GRAM_FORCE_N * directions for size in (50.0, 120.0)])


def foresee(twin: FootTwin, found: Fit) -> Foreseen:
    """Return how wrong the foot will be.

    To first order: a foot that differs from what was found by e reads a load f like what was found reads f + df, where
    df is the least-squares answer to the change of its nine readings.
    """
    force_n = loads_n()
    at = twin.capacitance_pf(found.parameters, Load.centred(force_n))
    size_n = np.linalg.norm(force_n, axis=1, keepdims=True)
    by_force = np.stack(
        [
            (twin.capacitance_pf(found.parameters, Load.centred(force_n + 1e-3 * size_n * axis)) - at)
            / (1e-3 * size_n)
            for axis in np.eye(3)
        ],
        axis=2,
    )
    read = np.linalg.pinv(by_force)
    rng = np.random.default_rng(_SEED)
    root = np.linalg.cholesky(found.covariance)
    angles, sizes = [], []
    for _ in range(_DRAWS):
        changed = found.parameters + np.clip(root @ rng.normal(size=len(root)), -2.0 * PRIOR, 2.0 * PRIOR)
        changed[STIFFNESS] = np.maximum(changed[STIFFNESS], -0.9)
        moved = twin.capacitance_pf(twin.possible(changed), Load.centred(force_n)) - at
        guess_n = force_n + np.einsum("nij,nj->ni", read, moved)
        angles.append(direction_errors_deg(force_n, guess_n))
        sizes.append(np.linalg.norm(guess_n, axis=1) / size_n[:, 0] - 1.0)
    untold = tuple(name for name, told in zip(names(), found.told_rel, strict=True) if told < TOLD_REL)
    return Foreseen(_rms(angles), _rms(sizes), untold)


def require_known(foreseen: Foreseen, n_pokes: int) -> None:
    """Refuse a foot of which too little is known.

    Raises:
        CalibrationError: Its forces would be off by more than a calibrated foot may be.
    """
    if foreseen.direction_deg > _MOST_DEG or foreseen.magnitude_rel > _MOST_REL:
        least = ", ".join(foreseen.untold[:3]) or "no parameter well enough"
        raise CalibrationError(
            f"{n_pokes} pokes leave forces uncertain by {foreseen.direction_deg:.1f} deg and "
            f"{foreseen.magnitude_rel:.0%}, at most {_MOST_DEG:g} deg and {_MOST_REL:.0%} make a pack; "
            f"they do not tell {least}; press from more sides, at two magnitudes"
        )


def _rms(values: list[Vector]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
