"""Range of a foot: the largest normal load at which every element is still read, by how far the force leans.

Ground presses a robot's foot along its normal, which is nearly upright in the frame of the foot, and friction leans the
force from it. A force that leans passes beside the middle of the ball and bends the sheet: the gap of one corner closes
at a fraction of the load that a centred force, of any direction, needs. Hence a range is a normal load, and a lean.

The one place where a range is computed from a response table: for designs, for the report, and for the model cards.
"""

from typing import NamedTuple

import numpy as np

from footsense.foot.directions import direction_grid, tangent_frame
from footsense.foot.specimen import ContactLoads, Specimen
from footsense.frames import Vector
from footsense.lab.training.load_cases import FULL_SCALE_PF

#: Closure over the gap up to which a load is read [1]: beyond, different loads have nearly the same closures (page
#: `design` of the report).
MAX_READABLE_CLOSURE_REL = 0.8
#: Angles between an upright contact normal and the force at which a range is stated [deg]: a force along the normal,
#: the rms lean of the training's leaning loads, and a friction of 0.577.
LEANS_DEG = (0.0, 14.0, 30.0)
#: Angle from the foot's axis of the centred forces at which a range is stated beside them [deg].
CENTRED_DEG = 30.0
#: Normal of level ground under an upright foot, shape (1, 3).
UPRIGHT = np.array([[0.0, 0.0, 1.0]])
_AZIMUTHS_DEG = 45.0 * np.arange(8)
#: Bisections of each load, up to this multiple of the one that would close the gap if the foot were linear.
_BISECTIONS, _LARGEST_OVER_LINEAR = 14, 4.0


class ForceRange(NamedTuple):
    """Largest normal loads at which a force is given without an overload [N], in the worst azimuth.

    Every element is read, and the force is not above the largest of the training.

    Attributes:
        upright_n: Of an upright contact normal and a force that leans from it by `LEANS_DEG`, shape (3,).
        centred_n: Of a centred force, `CENTRED_DEG` from the foot's axis; its normal load is its magnitude.
    """

    upright_n: Vector
    centred_n: float


def force_range(foot: Specimen, max_force_n: float, range_end_pf: float = FULL_SCALE_PF) -> ForceRange:
    """Return the range of a foot.

    Args:
        foot: The foot, as for `largest_loads_n`.
        max_force_n: Largest force of the training [N].
        range_end_pf: Largest capacitance that the converter reads [pF].
    """

    def least_n(loads: ContactLoads) -> float:
        trained_n = max_force_n / np.linalg.norm(loads.force_n, axis=1)
        return float(np.minimum(largest_loads_n(foot, loads, range_end_pf), trained_n).min())

    tilted = direction_grid(_AZIMUTHS_DEG, [90.0 - CENTRED_DEG])
    upright_n = [least_n(friction_loads(UPRIGHT, lean_deg)) for lean_deg in LEANS_DEG]
    return ForceRange(np.array(upright_n), least_n(friction_loads(tilted, 0.0)))


def friction_loads(normal: Vector, lean_deg: float) -> ContactLoads:
    """Return loads of 1 N along each contact normal, their forces leaning from it to eight sides, 8 n of them.

    Args:
        normal: Contact normals, shape (n, 3).
        lean_deg: Angle between normal and force [deg]; 0 for one load of each normal, centred.
    """
    if lean_deg == 0.0:
        return ContactLoads.centred(normal)
    first, second = tangent_frame(normal)
    sideways = np.concatenate([np.cos(a) * first + np.sin(a) * second for a in np.radians(_AZIMUTHS_DEG)])
    upward = np.tile(normal, (len(_AZIMUTHS_DEG), 1))
    return ContactLoads(upward, upward + np.tan(np.radians(lean_deg)) * sideways)


def largest_loads_n(foot: Specimen, loads: ContactLoads, range_end_pf: float = FULL_SCALE_PF) -> Vector:
    """Return the largest normal load that is read along each load [N], shape (n,), gap contact included.

    No closure reads as more than `MAX_READABLE_CLOSURE_REL` of its gap, no capacitance exceeds the converter's range.

    Args:
        foot: The foot, as designed or with deviations that are known: strays are taken off, and the gaps are its own.
        loads: The loads, each of 1 N along its normal.
        range_end_pf: Largest capacitance that the converter reads [pF].
    """
    gap_um, design = foot.gap_um, foot.response.design
    unloaded_pf = foot.unloaded_pf - foot.stray_pf
    free_um = foot.response.free_element_closures_um(loads.normal, loads.force_n).max(axis=1)
    low: Vector = np.zeros(len(free_um))
    high: Vector = _LARGEST_OVER_LINEAR * gap_um.max() / free_um
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2.0
        read_pf = foot.capacitance_pf(loads.normal, middle[:, None] * loads.force_n)
        closure_rel = design.closure_um(read_pf - foot.stray_pf, unloaded_pf) / gap_um
        beyond = (closure_rel.max(axis=1) > MAX_READABLE_CLOSURE_REL) | (read_pf.max(axis=1) > range_end_pf)
        low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
    return low
