"""Rubber that creeps: a closure that keeps growing under a load that stands still, and is slow to go back.

A generalised Kelvin chain in series with the elastic foot, the same for every element:

    d(t) = e(t) + sum_k c_k z_k(t),      tau_k dz_k/dt = e - z_k

e is the elastic closure. Under a step of e the chain answers 1 + sum_k c_k (1 - exp(-t / tau_k)). The equation of z_k
is integrated exactly for an e that stands still between samples. This holds as long as no gap shuts.

Source:
    The form, linear and with a few relaxation times, is that of PDMS at small strain (a Prony series):
    arXiv:2402.07555. The numbers of `ASSUMED` are assumptions of a plausible size, measured on no foot.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


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


def crept_closure(
    elastic: NDArray[np.float64], period_s: float, chain: tuple[Kelvin, ...] = ASSUMED
) -> NDArray[np.float64]:
    """Return the closures of a foot that creeps, sampled with a fixed period, at rest before the first sample.

    Args:
        elastic: Elastic closures in any unit, time first, shape (n, ...); each lasts from the sample before to its own.
        period_s: Time between samples [s].
        chain: The elements.

    Returns:
        Closures in the same unit, shape (n, ...).
    """
    crept = elastic.copy()
    for part in chain:
        kept = np.exp(-period_s / part.time_s)
        late = np.zeros_like(elastic[0])
        for k, now in enumerate(elastic):
            late = now + kept * (late - now)
            crept[k] += part.share_rel * late
    return crept


def uncrept_closure(
    crept: NDArray[np.float64], period_s: float, chain: tuple[Kelvin, ...] = ASSUMED
) -> NDArray[np.float64]:
    """Return the elastic closures behind measured ones, scan by scan: the inverse of `crept_closure`.

    Args:
        crept: Closures of a foot that creeps, shape (n, ...), at rest before the first sample.
        period_s: Time between samples [s].
        chain: The elements that the foot is believed to have.

    Returns:
        Elastic closures in the same unit, shape (n, ...).
    """
    kept = [np.exp(-period_s / part.time_s) for part in chain]
    at_once = 1.0 + sum(part.share_rel * (1.0 - k) for part, k in zip(chain, kept, strict=True))
    late = [np.zeros_like(crept[0]) for _ in chain]
    elastic = np.empty_like(crept)
    for n, seen in enumerate(crept):
        owed = sum(
            (part.share_rel * k * z for part, k, z in zip(chain, kept, late, strict=True)), np.zeros(1)
        )
        elastic[n] = (seen - owed) / at_once
        late = [elastic[n] + k * (z - elastic[n]) for k, z in zip(kept, late, strict=True)]
    return elastic
