"""Rubber of a simulated foot: creep, hysteresis of loading and unloading, and what temperature does to it.

Creep and hysteresis act on the load of the elastic solid, as elements in series with the elastic foot:

    f_solid = (1 - sum_j w_j) f + sum_j w_j p_j + sum_k c_k z_k

    creep, a Kelvin chain:        tau_k dz_k/dt = f - z_k
    hysteresis, play operators:   p_j follows f with a lag of at most r_j, at any speed

z_k is integrated exactly for a load that stands still between two calls.

Source:
    Prony series for PDMS: arXiv:2402.07555; play operators: Krejci, Hysteresis, Convexity and Dissipation, 1996. The
    numbers are assumptions of a plausible size, measured on no foot: a creep of 3 %, 2 % and 2 % after 0.1 s, 1 s
    and 10 s, and a loop that is 2 % of 1 N wide. Level `insole`: the page `real-sensors`, calibration session, foam.
"""

import numpy as np

from footsense.frames import ELEMENTS, Vector
from footsense.sim.scene import RubberLevel, Warming

#: Factor on creep or play: one number, or one of each retardation time or operator [1].
RubberFactor = float | tuple[float, ...]
#: Share that creeps [1] and its retardation time [s].
CREEP_REL = np.array([0.03, 0.02, 0.02])
CREEP_TIME_S = np.array([0.1, 1.0, 10.0])
#: Weight [1] and width [N] of each play operator.
PLAY_OPERATOR_WEIGHTS = np.array([0.05, 0.05, 0.05])
PLAY_OPERATOR_WIDTHS_N = np.array([0.02, 0.06, 0.12])

#: Creep and play over those, by level. The insole's creep of 10 s is 15 % of the whole, its play 15 % at the largest
#: width; what creeps faster was not seen there.
RUBBER_LEVELS: dict[RubberLevel, tuple[RubberFactor, RubberFactor]] = {
    "assumed": (1.0, 1.0),
    "threefold": (3.0, 3.0),
    "insole": ((1.0, 1.0, 9.0), (0.0, 0.0, 3.6)),
}

#: A load below this is none [N].
_MIN_LOAD_N = 1e-6


class ViscoelasticRubber:
    """Creep and hysteresis state of the rubber of one foot; call in order of time.

    Args:
        creep: Creep over that assumed above [1], one number or one of each retardation time.
        play: Weight of the play operators over that assumed above [1], one number or one of each.
    """

    def __init__(self, creep: RubberFactor = 1.0, play: RubberFactor = 1.0) -> None:
        self._creep_rel: Vector = np.asarray(creep, np.float64) * CREEP_REL
        self._play_rel: Vector = np.asarray(play, np.float64) * PLAY_OPERATOR_WEIGHTS
        self._elastic_rel = 1.0 - self._play_rel.sum()
        self._crept_n = np.zeros((len(CREEP_REL), 3))
        self._played_n = np.zeros((len(PLAY_OPERATOR_WEIGHTS), 3))
        self._normal = np.array([0.0, 0.0, 1.0])
        self._t_ns: int | None = None

    def next_effective_load(self, t_ns: int, normal: Vector, force_n: Vector) -> tuple[Vector, Vector]:
        """Return normal and force [N] that would deform an elastic foot as much, shape (3,) each; advances the state.

        Args:
            t_ns: Time, not before that of the last call [ns].
            normal: Inward normal of the contact, shape (3,); ignored without a load.
            force_n: Load since the last call [N], shape (3,).
        """
        if self._t_ns is not None:
            kept = np.exp((self._t_ns - t_ns) * 1e-9 / CREEP_TIME_S)[:, None]
            self._crept_n = force_n + kept * (self._crept_n - force_n)
        self._t_ns = t_ns
        behind_n = force_n - self._played_n
        distance_n = np.sqrt((behind_n * behind_n).sum(axis=1))
        moved = np.maximum(distance_n - PLAY_OPERATOR_WIDTHS_N, 0.0) / np.maximum(distance_n, _MIN_LOAD_N)
        self._played_n += moved[:, None] * behind_n
        if force_n @ force_n > _MIN_LOAD_N**2:  # the memory of a load stays at its contact
            self._normal = normal
        return self._normal, (
            self._elastic_rel * force_n + self._play_rel @ self._played_n + self._creep_rel @ self._crept_n
        )


class ElementCreep:
    """Creep of single elements beside that of the whole foot, which no common load explains.

    To the change of capacitance of each element comes a share of its own, with the retardation times of the rubber.

    Args:
        spread_rel: Standard deviation of that share between the elements, after a long time [1].
        unloaded_pf: Capacitance of each element of the free foot [pF], shape (elements,).
        rng: Source of the shares.
    """

    def __init__(self, spread_rel: float, unloaded_pf: Vector, rng: np.random.Generator) -> None:
        share_rel = spread_rel * rng.standard_normal(ELEMENTS)
        self._creep_rel = share_rel[:, None] * CREEP_REL / CREEP_REL.sum()
        self._unloaded_pf = unloaded_pf
        self._crept_pf = np.zeros_like(self._creep_rel)
        self._t_ns: int | None = None

    def next_capacitance_pf(self, t_ns: int, elastic_pf: Vector) -> Vector:
        """Return the capacitances with creep [pF], shape (elements,); advances the state.

        Args:
            t_ns: Time, not before that of the last call [ns].
            elastic_pf: Capacitances since the last call without it [pF], shape (elements,).
        """
        change_pf = (elastic_pf - self._unloaded_pf)[:, None]
        if self._t_ns is not None:
            kept = np.exp((self._t_ns - t_ns) * 1e-9 / CREEP_TIME_S)
            self._crept_pf = change_pf + kept * (self._crept_pf - change_pf)
        self._t_ns = t_ns
        crept_pf: Vector = elastic_pf + (self._creep_rel * self._crept_pf).sum(axis=1)
        return crept_pf


#: Least share of a floor's capacitance that an element has of its largest [1]: not all are as near.
_MIN_FLOOR_SHARE = 0.7


def draw_floor_pf(largest_pf: float, rng: np.random.Generator) -> Vector:
    """Return the capacitance that a floor adds to each element of a foot in contact [pF], shape (elements,).

    Args:
        largest_pf: The most that an element may have [pF].
        rng: Source of their shares.
    """
    return largest_pf * rng.uniform(_MIN_FLOOR_SHARE, 1.0, ELEMENTS)


#: Thermal expansion of the spacer, 310 ppm/K, on an element of 5 pF [pF/K].
DRIFT_PF_PER_K = -1.5e-3
#: Standard deviation between the elements of a foot [1].
DRIFT_SPREAD_REL = 0.2
#: Shear modulus of PDMS, 1.1 kPa/K of 250 kPa (Lotters 1997) [1/K].
STIFFENING_PER_K = 4.4e-3


def relative_compliance_when_warmed(kelvin: float) -> float:
    """Return the factor on the gap closures under the same load, for a foot warmed by `kelvin` [1].

    Args:
        kelvin: Change of temperature [K].
    """
    return 1.0 / (1.0 + STIFFENING_PER_K * kelvin)


class WarmingFoot:
    """Temperature change of one foot over time, with its baseline drift and stiffening.

    Args:
        warming: The change.
        rng: Source of the differences between its elements.
    """

    def __init__(self, warming: Warming, rng: np.random.Generator) -> None:
        self._warming = warming
        spread_rel = DRIFT_SPREAD_REL * rng.standard_normal(ELEMENTS)
        self._pf_per_k: list[float] = (DRIFT_PF_PER_K * (1.0 + spread_rel)).tolist()

    def drift_pf(self, t_ns: int) -> list[float]:
        """Return the baseline drift of each element at a time [pF]."""
        kelvin = self._warming.temperature_change_k_at(t_ns)
        return [pf_per_k * kelvin for pf_per_k in self._pf_per_k]

    def relative_compliance(self, t_ns: int) -> float:
        """Return the factor on the gap closures under the same load at a time [1]; 1 at the start."""
        return relative_compliance_when_warmed(self._warming.temperature_change_k_at(t_ns))
