"""Whether a reference may be believed: held against what the foot itself makes of the same loads.

A foot that is badly made is off by some 20 deg and 20 %, and still knows a kilogram-force from a newton and left from
right. So it tells which units and which axes would fit, but never by how much the reference is right.
"""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from footsense.foot.directions import angles_between_deg

__all__ = ["MIN_LOADS", "implausible"]

Vector = NDArray[np.float64]

#: So many loads have to say the same.
MIN_LOADS = 5
#: What no foot is off by; another unit has to explain it to within `_EXPLAINED`.
_OFF, _EXPLAINED = 2.0, 1.5
#: Angles in the mean [deg]: what hardly a foot is off by, what another map has to gain and to lead others by, and from
#: where on no foot is to blame even if no other map fits: of 60 made as badly as the paper's, the worst is off by 35.
_TURNED_DEG, _GAIN_DEG, _LEAD_DEG, _ASTRAY_DEG = 35.0, 20.0, 8.0, 50.0


def implausible(
    reference_n: Vector,
    estimate_n: Vector,
    newton_per: Mapping[str, float],
    units: str,
    axes: Sequence[str],
    to_sensor: Vector,
) -> list[str]:
    """Return what cannot be right about a reference, one line each; nothing if it may be, or if nobody can tell.

    Args:
        reference_n: Forces of the loads as the reference says them [N], shape (n, 3), foot frame.
        estimate_n: The same as the foot's network says them [N], NaN where it cannot, shape (n, 3).
        newton_per: Every unit that there is [N].
        units: The one that the bench's file names.
        axes: The sensor's axes for the foot's x, y and z, as the file names them.
        to_sensor: What turns a force on the foot into those three axes, shape (3, 3): the mount's turn undone.
    """
    known = np.isfinite(estimate_n).all(axis=1) & (np.linalg.norm(estimate_n, axis=1) > 0.0)
    if known.sum() < MIN_LOADS:
        return []
    reference, estimate = reference_n[known], estimate_n[known]
    return [
        *_wrong_units(reference, estimate, newton_per, units),
        *_wrong_axes(reference, estimate, axes, to_sensor),
    ]


def _wrong_units(
    reference_n: Vector, estimate_n: Vector, newton_per: Mapping[str, float], units: str
) -> Iterator[str]:
    times = float(np.median(np.linalg.norm(reference_n, axis=1) / np.linalg.norm(estimate_n, axis=1)))
    if abs(math.log(times)) < math.log(_OFF):
        return
    off = {unit: abs(math.log(times * value / newton_per[units])) for unit, value in newton_per.items()}
    best = min(off, key=off.__getitem__)
    says = f"the reference says {times:.3g} times the force that the foot itself makes of it"
    if best != units and off[best] < math.log(_EXPLAINED):
        yield f"{says}: its readings seem to be in {best}, and the bench's file says units: {units}"
    else:
        yield f"{says}, which no other unit explains; check units and unit_per_count in the bench's file, and the foot"


def _wrong_axes(
    reference_n: Vector, estimate_n: Vector, axes: Sequence[str], to_sensor: Vector
) -> Iterator[str]:
    given_deg = float(angles_between_deg(reference_n, estimate_n).mean())
    if given_deg < _TURNED_DEG:
        return
    inner_n = reference_n @ to_sensor.T
    tried = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            turned_n = (inner_n[:, order] * signs) @ to_sensor
            tried.append((float(angles_between_deg(turned_n, estimate_n).mean()), order, signs))
    tried.sort()
    (best_deg, order, signs), (second_deg, *_) = tried[:2]
    says = f"the reference points {given_deg:.0f} deg away from the force that the foot itself makes of it"
    if best_deg < given_deg - _GAIN_DEG and second_deg - best_deg > _LEAD_DEG:
        names = [_turned(axes[source], sign) for source, sign in zip(order, signs, strict=True)]
        fits = ", ".join(f"{axis}: {name}" for axis, name in zip("xyz", names, strict=True))
        yield f"{says}: axes: {{{fits}}} would fit to {best_deg:.0f} deg"
    elif given_deg > _ASTRAY_DEG:
        yield f"{says}; check the signs of axes in the bench's file, and press from more sides to see which would fit"


def _turned(axis: str, sign: float) -> str:
    """Return an axis, or its opposite.

    Example:
        >>> _turned("-x", -1.0), _turned("+y", -1.0), _turned("z", 1.0)
        ('x', '-y', 'z')
    """
    negative = (axis[0] == "-") != (sign < 0)
    return f"{'-' if negative else ''}{axis[-1]}"
