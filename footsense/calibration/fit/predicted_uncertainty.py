"""How wrong a calibrated foot will be because its parameters are not known better: said before anyone relies on it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.calibration.fit.parameter_fit import PRIOR, Fit
from footsense.calibration.fit.twin import KINDS, STIFFNESS, FootTwin, Load, names
from footsense.errors import CalibrationError
from footsense.foot.force_errors import direction_errors_deg
from footsense.foot.gap_contact import element_means
from footsense.sim.test_stand.calibration_loads import GRAM_FORCE_N

Vector = NDArray[np.float64]

#: Beyond this no calibration is made: what a foot as designed would do after a careless assembly is not much worse.
_MOST_DEG, _MOST_REL = 4.0, 0.1
#: Closure over the thinnest gap from which a load is not asked for.
_OPEN_REL = 0.7
_DRAWS, _DRAWS_OF_KIND = 24, 6
_SEED = 1
#: Said to be told by the loads if they took half of what was not known.
TOLD_REL = 0.5


class Foreseen(NamedTuple):
    """Expected errors of loads all over the ball, by what is not known of the foot.

    Attributes:
        direction_deg: Half of the loads are off by less [deg].
        magnitude_rel: The same of the magnitude, relative [1].
        least_known: The kind of parameter that most of it comes from.
        untold: Names of the parameters of which the loads told little, and which are nearly as designed therefore.
    """

    direction_deg: float
    magnitude_rel: float
    least_known: str
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
    df is the least-squares answer to the change of its nine readings. Loads that shut a gap are left out: such a foot
    is not read there.
    """
    force_n = loads_n()
    cells_um = twin.cells_um(found.parameters, Load.centred(force_n))
    force_n = force_n[element_means(cells_um).max(axis=1) < _OPEN_REL * twin.gap_um(found.parameters).min()]
    if not len(force_n):
        return Foreseen(np.inf, np.inf, "gap", ())
    moves = _Moves(twin, found, force_n)
    rng = np.random.default_rng(_SEED)
    everything = np.ones(len(found.parameters), bool)
    direction_deg, magnitude_rel = moves.errors(everything, rng, _DRAWS)
    by_kind = {}
    for kind, where in KINDS.items():
        alone = np.zeros(len(found.parameters), bool)
        alone[where] = True
        by_kind[kind] = moves.errors(alone, rng, _DRAWS_OF_KIND)[0]
    untold = tuple(name for name, told in zip(names(), found.told_rel, strict=True) if told < TOLD_REL)
    return Foreseen(direction_deg, magnitude_rel, max(by_kind, key=by_kind.__getitem__), untold)


class _Moves:
    """What changes of parameters do to the forces that are read.

    Args:
        twin: The foot.
        found: What is known of it.
        force_n: Loads that it is asked for [N], shape (n, 3).
    """

    def __init__(self, twin: FootTwin, found: Fit, force_n: Vector) -> None:
        self._twin, self._found, self._force_n = twin, found, force_n
        self._at_pf = twin.capacitance_pf(found.parameters, Load.centred(force_n))
        self._size_n = np.linalg.norm(force_n, axis=1, keepdims=True)
        push_n = 1e-3 * self._size_n
        by_force = np.stack(
            [
                (twin.capacitance_pf(found.parameters, Load.centred(force_n + push_n * axis)) - self._at_pf)
                / push_n
                for axis in np.eye(3)
            ],
            axis=2,
        )
        self._read = np.linalg.pinv(by_force)

    def errors(self, which: NDArray[np.bool_], rng: np.random.Generator, n_draws: int) -> tuple[float, float]:
        """Return median angle [deg] and relative error of the magnitude if only these parameters are not known."""
        parameters = self._found.parameters
        root = np.linalg.cholesky(self._found.covariance[np.ix_(which, which)])
        angles_deg, sizes_rel = [], []
        for _ in range(n_draws):
            changed = parameters.copy()
            changed[which] += np.clip(
                root @ rng.normal(size=len(root)), -2.0 * PRIOR[which], 2.0 * PRIOR[which]
            )
            changed[STIFFNESS] = np.maximum(changed[STIFFNESS], -0.9)
            moved_pf = (
                self._twin.capacitance_pf(self._twin.possible(changed), Load.centred(self._force_n))
                - self._at_pf
            )
            guess_n = self._force_n + np.einsum("nij,nj->ni", self._read, moved_pf)
            angles_deg.append(direction_errors_deg(self._force_n, guess_n))
            sizes_rel.append(np.abs(np.linalg.norm(guess_n, axis=1) / self._size_n[:, 0] - 1.0))
        return float(np.median(angles_deg)), float(np.median(sizes_rel))


def require_known(foreseen: Foreseen, n_loads: int) -> None:
    """Refuse a foot of which too little is known.

    Raises:
        CalibrationError: Its forces would be off by more than a calibrated foot may be.
    """
    if foreseen.direction_deg > _MOST_DEG or foreseen.magnitude_rel > _MOST_REL:
        raise CalibrationError(
            f"{n_loads} loads leave half of all forces uncertain by {foreseen.direction_deg:.1f} deg and "
            f"{foreseen.magnitude_rel:.0%} or more, at most {_MOST_DEG:g} deg and {_MOST_REL:.0%} make a calibration; "
            f"what they tell least is the {foreseen.least_known}; press from more sides, at two magnitudes"
        )
