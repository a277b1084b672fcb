"""What differs between feet in a batch and from episode to episode, and the random numbers of each foot.

Random numbers are a hash of the foot's key and a counter: the same in every library and on every device, and of one
foot whatever happens to the others.

Source:
    C. Wellons, Hash Prospector, 2018: lowbias32. Normal numbers: Box and Muller, 1958.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import array_api_compat

from footsense.foot.capacitor import EPS0_PF_UM_PER_MM2, Capacitor
from footsense.frames import ELEMENTS
from footsense.sim.fabrication import MIN_DRAWN_OVER_DESIGN, FootTolerances
from footsense.sim.virtual.network import Array, ArrayModule

_EXACT = FootTolerances()
#: Longest delay [s]: beyond it, the readings that are kept of a foot outnumber its random numbers of a step.
_MAX_DELAY_S = 0.5
#: Added to a square, which may be 0 [rad^2].
_TINY = 1e-20


@dataclass(frozen=True, slots=True, kw_only=True)
class Variation:
    """How feet of a batch differ: each draws its own at the start and at every reset.

    Attributes:
        tolerances: Rms deviations of gaps, films, strays, stiffness and mounting from the design. A draw that would
            leave less than a quarter of it leaves a quarter.
        gain_rel: Rms change of the gain of each element since the foot was made, as of electrodes of worn feet [1].
        baseline_error_ff: Rms error of a foot's baseline [fF].
        noise_rel: Least and most noise of a foot over that of its converter [1].
        delay_s: Least and most delay of a foot's forces after they were sent, to 0.5 [s].
    """

    tolerances: FootTolerances = _EXACT
    gain_rel: float = 0.0
    baseline_error_ff: float = 0.3
    noise_rel: tuple[float, float] = (1.0, 1.0)
    delay_s: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ValueError: One is upside down, below 0, or too large; the message names it.
        """
        for name, most, unit in (
            ("noise_rel", math.inf, ""),
            ("delay_s", _MAX_DELAY_S, " in seconds, at most 0.5,"),
        ):
            match getattr(self, name):
                case (int() | float() as low, int() | float() as high) if 0.0 <= low <= high <= most:
                    continue
                case other:
                    raise ValueError(f"{name}: a least and a most,{unit} neither below 0, got {other}")
        for name in ("gain_rel", "baseline_error_ff"):
            if not 0.0 <= (rms := getattr(self, name)) < math.inf:
                raise ValueError(f"{name}: is an rms value, not below 0, got {rms}")


AS_DESIGNED = Variation()


class FootDraw(NamedTuple):
    """What n feet have drawn for an episode.

    Attributes:
        key: Key of the foot's random numbers, shape (n,), int32.
        distance_um: Electrical distance of the open plates of each element [um], shape (9, n).
        gap_um: Gap of each element [um], same shape.
        gain: Closure that each element reads over its real one [1], same shape.
        tared_pf: Its baseline, stray included [pF], same shape.
        error_pf: Error of the baselines [pF], shape (n,).
        compliance: Compliance of the foot over the design's [1], shape (n,).
        turn_rad: Rotation vector from the leg's frame to the foot's [rad], shape (3, n).
        noise_pf: Noise of a conversion [pF rms], shape (n,).
        delay_ns: Delay of its forces after they were sent [ns], shape (n,), int32.
    """

    key: Array
    distance_um: Array
    gap_um: Array
    gain: Array
    tared_pf: Array
    error_pf: Array
    compliance: Array
    turn_rad: Array
    noise_pf: Array
    delay_ns: Array


def hashed(number: Array) -> Array:
    """Return random bits for integers, int32 both."""
    for shift, factor in ((16, 0x7FEB352D), (15, 0x846CA68B - 2**32)):
        number = (number ^ ((number >> shift) & (2 ** (32 - shift) - 1))) * factor
    return number ^ ((number >> 16) & 0xFFFF)


def uniform(xp: ArrayModule, key: Array, first: Array, n: int) -> Array:
    """Return uniform random numbers above 0 and below 1, float32, shape (n, keys), of counters from one on."""
    counter = first + xp.arange(n, dtype=xp.int32, device=array_api_compat.device(key))
    bits = hashed(key ^ hashed(counter)[:, None])
    return (xp.astype((bits >> 9) & 0x7FFFFF, xp.float32) + 0.5) * 2.0**-23


def random_normal(xp: ArrayModule, key: Array, first: Array, n: int) -> Array:
    """Return normal random numbers, float32, shape (n, keys), of counters from one on."""
    half = (n + 1) // 2
    draws = uniform(xp, key, first, 2 * half)
    size, angle = xp.sqrt(-2.0 * xp.log(draws[:half, :])), 2.0 * math.pi * draws[half:, :]
    return xp.concat([size * xp.cos(angle), size * xp.sin(angle)])[:n, :]


def rotated(xp: ArrayModule, vector: Array, turn_rad: Array) -> Array:
    """Return vectors turned by rotation vectors [rad], shape (3, n) all: Rodrigues' formula."""
    angle = xp.sqrt(xp.sum(turn_rad * turn_rad, axis=0) + _TINY)
    across = xp.linalg.cross(turn_rad / angle, vector, axis=-2)
    twice_across = xp.linalg.cross(turn_rad / angle, across, axis=-2)
    return vector + xp.sin(angle) * across + (1.0 - xp.cos(angle)) * twice_across


def draw_feet(
    xp: ArrayModule, variation: Variation, design: Capacitor, noise_pf: float, key: Array
) -> FootDraw:
    """Return what feet of some keys draw.

    Args:
        xp: Module of the arrays.
        variation: How they differ.
        design: Their capacitors.
        noise_pf: Noise of a conversion as designed [pF rms].
        key: Keys of the feet for an episode, shape (n,), int32.
    """
    tolerances = variation.tolerances

    def drawn(kind: int, rms: float, width: int = ELEMENTS) -> Array:
        return rms * random_normal(xp, key, _of_kind(kind), width)

    def around(mean: float, deviation: Array) -> Array:
        return xp.clip(mean + deviation, min=MIN_DRAWN_OVER_DESIGN * mean)

    def between(kind: int, least: float, most: float) -> Array:
        return least + (most - least) * uniform(xp, key, _of_kind(kind), 1)[0, :]

    gap_um = around(design.gap_um, drawn(0, tolerances.gap_um))
    film_um = around(design.film_um, drawn(1, tolerances.film_um))
    distance_um = gap_um + film_um / design.film_eps_r
    error_pf = drawn(3, 1e-3 * variation.baseline_error_ff, 1)[0, :]
    open_pf = EPS0_PF_UM_PER_MM2 * design.electrode_area_mm2 / distance_um
    return FootDraw(
        key=key,
        distance_um=distance_um,
        gap_um=gap_um,
        gain=around(1.0, drawn(4, variation.gain_rel)),
        tared_pf=open_pf + drawn(2, tolerances.stray_pf) + error_pf,
        error_pf=error_pf,
        compliance=1.0 / around(1.0, drawn(5, tolerances.stiffness_rel, 1))[0, :],
        turn_rad=drawn(6, math.radians(tolerances.mount_deg) / math.sqrt(3.0), 3),
        noise_pf=noise_pf * between(7, *variation.noise_rel),
        delay_ns=xp.astype(1e9 * between(8, *variation.delay_s), xp.int32),
    )


def _of_kind(kind: int) -> int:
    return 32 * (kind - 32)  # the counters of steps are from 0 on
