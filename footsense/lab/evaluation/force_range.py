"""Range of a foot: forces at which a gap begins to close, a reading stops telling loads apart, the converter ends.

The one place where a range is computed from a response table: for designs, for the report, and for the model cards.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from footsense.foot.directions import tangent_frame
from footsense.foot.gap_contact import CELLS_PER_ELEMENT
from footsense.foot.specimen import Specimen
from footsense.frames import Mask, Vector
from footsense.lab.training.load_cases import FULL_SCALE_PF

#: Closure over the gap up to which a load is read [1]: beyond, different loads have nearly the same closures (page
#: `design` of the report).
MAX_READABLE_CLOSURE_REL = 0.8
#: Largest angle between a force and the leg's axis within a stated range [deg], where no other is asked for.
REACH_DEG = 30.0
#: Angle between force and contact normal of the leaning loads within a stated range [deg]: at its largest a foot's
#: force is nearly upright, and friction takes a tenth of it.
STATED_LEAN_DEG = 5.0
#: Bisections of each force, up to this multiple of the one that would close the gap if the foot were linear.
_BISECTIONS, _LARGEST_OVER_LINEAR = 14, 4.0


class LoadDirections(NamedTuple):
    """Loads without their magnitude: force directions and contact normals, shape (loads, 3) each."""

    direction: Vector
    normal: Vector


class ForceLimits(NamedTuple):
    """Least forces at which a foot reaches its limits, along n loads [N], shape (n,) each.

    Attributes:
        gap_closes_n: A gap begins to close: part of an electrode touches.
        readable_n: A closure reads as more than `MAX_READABLE_CLOSURE_REL` of its gap.
        converter_n: A capacitance exceeds the converter's range; the leg says `saturated`.
    """

    gap_closes_n: Vector
    readable_n: Vector
    converter_n: Vector

    @property
    def range_n(self) -> Vector:
        """Largest force that is read along each load [N]."""
        return np.minimum(self.readable_n, self.converter_n)


def force_limits(foot: Specimen, loads: LoadDirections, range_end_pf: float = FULL_SCALE_PF) -> ForceLimits:
    """Return the limits of a foot along given loads, by bisection, gap contact included.

    Args:
        foot: The foot, as designed or with deviations that are known: strays are taken off, and the gaps are its own.
        loads: The loads.
        range_end_pf: Largest capacitance that the converter reads [pF].
    """
    gap_um, design = foot.gap_um, foot.response.design
    unloaded_pf = foot.unloaded_pf - foot.stray_pf
    free_um = foot.response.free_element_closures_um(loads.normal, loads.direction).max(axis=1)
    most_n = _LARGEST_OVER_LINEAR * gap_um.max() / free_um
    touching_um = (1.0 - 1e-9) * np.repeat(gap_um, CELLS_PER_ELEMENT)

    def touches(force_n: Vector) -> Mask:
        beyond: Mask = (foot.cell_closures_um(loads.normal, force_n) - touching_um).max(axis=1) >= 0.0
        return beyond

    def is_unreadable(force_n: Vector) -> Mask:
        capacitance_pf = foot.capacitance_pf(loads.normal, force_n) - foot.stray_pf
        closure_um = design.closure_um(capacitance_pf, unloaded_pf)
        beyond: Mask = (closure_um / gap_um).max(axis=1) > MAX_READABLE_CLOSURE_REL
        return beyond

    def is_over_range(force_n: Vector) -> Mask:
        beyond: Mask = foot.capacitance_pf(loads.normal, force_n).max(axis=1) > range_end_pf
        return beyond

    def least_n(is_beyond: Callable[[Vector], Mask]) -> Vector:
        low: Vector = np.zeros_like(most_n)
        high: Vector = most_n
        for _ in range(_BISECTIONS):
            middle = (low + high) / 2.0
            beyond = is_beyond(middle[:, None] * loads.direction)
            low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
        return low

    return ForceLimits(*map(least_n, (touches, is_unreadable, is_over_range)))


def stated_loads(max_lean_deg: float) -> LoadDirections:
    """Return the loads over which the range of a design is stated: up to an angle from the leg's axis.

    Centred ones, and contacts whose normal leans from the force by `STATED_LEAN_DEG` to four sides.

    Args:
        max_lean_deg: Largest angle between force and the leg's axis [deg].
    """
    half = max_lean_deg / 2.0
    polar = ((0, 0), (half, 0), (half, 45), (max_lean_deg, 0), (max_lean_deg, 22.5), (max_lean_deg, 45))
    centred = np.stack([_unit_vector(*one) for one in polar])
    leaning = leaning_loads(
        np.stack([_unit_vector(half, 0), _unit_vector(max_lean_deg, 45)]), STATED_LEAN_DEG
    )
    return LoadDirections(*(np.concatenate([centred, part]) for part in leaning))


def leaning_loads(direction: Vector, lean_deg: float) -> LoadDirections:
    """Return loads along each direction whose contact normals lean from it to four sides, (4 n, 3) each.

    Args:
        direction: Directions of the force, shape (n, 3).
        lean_deg: Angle between force and contact normal [deg].
    """
    lean = np.radians(lean_deg)
    sideways = [sign * across for across in tangent_frame(direction) for sign in (1.0, -1.0)]
    normal = [np.cos(lean) * direction + np.sin(lean) * one for one in sideways]
    return LoadDirections(np.tile(direction, (4, 1)), np.concatenate(normal))


def _unit_vector(angle_deg: float, azimuth_deg: float) -> Vector:
    """Return the unit vector at an angle from the leg's axis and an azimuth [deg]."""
    angle, azimuth = np.radians(angle_deg), np.radians(azimuth_deg)
    return np.array([np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)])
