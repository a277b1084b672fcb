"""Rubber that creeps: a closure that keeps growing under a constant load, and returns slowly.

A generalised Kelvin chain in series with the elastic foot, the same for every element:

    d(t) = e(t) + sum_k c_k z_k(t),      tau_k dz_k/dt = e - z_k

e is the elastic closure. Under a step of e the chain answers 1 + sum_k c_k (1 - exp(-t / tau_k)). The equation of z_k
is integrated exactly for an e that is constant between samples, which makes it a recursive filter. This holds as long
as no gap closes.

Source:
    The form, linear and with a few relaxation times, is that of PDMS at small strain (a Prony series):
    arXiv:2402.07555. The numbers of `ASSUMED` are assumptions of a plausible size, measured on no foot.
"""

from dataclasses import dataclass
from functools import reduce

import numpy as np
from scipy.signal import lfilter

from footsense.frames import Vector


@dataclass(frozen=True, slots=True, kw_only=True)
class Kelvin:
    """One element of the chain.

    Attributes:
        share_rel: Closure that it adds in the end, over the elastic one [1].
        time_s: Retardation time [s].
    """

    share_rel: float
    time_s: float


#: A chain that adds 8 % within a step and 5 % over some steps.
ASSUMED = (Kelvin(share_rel=0.08, time_s=0.15), Kelvin(share_rel=0.05, time_s=2.0))


def _filter(period_s: float, chain: tuple[Kelvin, ...]) -> tuple[Vector, Vector]:
    """Return numerator and denominator of the filter from elastic closures to closures."""
    poles = [np.array([1.0, -np.exp(-period_s / part.time_s)]) for part in chain]
    denominator = reduce(np.convolve, poles, np.ones(1))
    numerator = denominator.copy()
    for k, part in enumerate(chain):
        others = reduce(np.convolve, poles[:k] + poles[k + 1 :], np.ones(1))
        numerator[:-1] += part.share_rel * (1.0 + poles[k][1]) * others
    return numerator, denominator


def crept_closure(elastic: Vector, period_s: float, chain: tuple[Kelvin, ...] = ASSUMED) -> Vector:
    """Return the closures of a foot that creeps, sampled with a fixed period, unloaded before the first sample.

    Args:
        elastic: Elastic closures in any unit, time first, shape (n, ...); each lasts from the sample before to its own.
        period_s: Time between samples [s].
        chain: The elements.

    Returns:
        Closures in the same unit, shape (n, ...).
    """
    return np.asarray(lfilter(*_filter(period_s, chain), elastic, axis=0))


def uncrept_closure(crept: Vector, period_s: float, chain: tuple[Kelvin, ...] = ASSUMED) -> Vector:
    """Return the elastic closures behind measured ones, scan by scan: the inverse of `crept_closure`.

    Args:
        crept: Closures of a foot that creeps, shape (n, ...), unloaded before the first sample.
        period_s: Time between samples [s].
        chain: The assumed elements of the foot.

    Returns:
        Elastic closures in the same unit, shape (n, ...).
    """
    numerator, denominator = _filter(period_s, chain)
    return np.asarray(lfilter(denominator, numerator, crept, axis=0))
