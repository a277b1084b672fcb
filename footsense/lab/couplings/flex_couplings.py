"""Couplings of a foot's lines from its drawn flexes: cross-sections, each times its length along the flex.

Cross-sections are cut where the copper changes. In the sheet both flexes are cut, along x and along y, and each cut
adds what runs side by side in it. Beyond the sheet each flex is cut across its own tail. What an electrode has to the
electrodes of the other flex is the elements themselves, with the field at their edges, and is left out. Traces that
converge count as parallel ones, which makes them too short by at most 30 % over a few millimetres; the surroundings of
an electrode count in both cuts.

Permittivities are effective ones, of a section's copper to each other and to the surroundings:

- tail with one layer, 1.5: traces of 0.08 to 0.2 mm at 0.5 mm between 25 um of polyimide (3.4) and 50 um of coverlay
  with its adhesive, which hold 0.07 and 0.13 of the field by the conformal maps of a coplanar line on a thin substrate
  (Gevorgian et al., IEEE Trans. Microw. Theory Tech. 43, 1995, p. 772); to the surroundings 1.0, air;
- tail with a layer of shield, 3.0: most of the field is in the polyimide between;
- sheet, 2.7: PDMS on the outer side of the electrodes and in the spacer (Aoyagi et al., section III A), to the
  surroundings too.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import shapely

from footsense.frames import Vector
from footsense.lab.couplings.moments import EPS0_FF_PER_MM, N_SEGMENTS, Strip, mutual_capacitance
from footsense.lab.fabrication import dimensions
from footsense.lab.fabrication.parts.flex import Board, Flex, flexes
from footsense.lab.fabrication.parts.gerber import Pad, Trace
from footsense.lab.geometry import FootDesign
from footsense.lab.template import render
from footsense.sim.couplings import GROUND, BoardCouplings

#: Boards whose couplings are computed.
BOARDS: tuple[Board, ...] = ("fdc1004", "ad7147")
#: Distance of grounded metal beside a tail, on the side of the lines [mm].
METAL_MM = 1.0
_SHEET_EPS_R, _TAIL_EPS_R, _SHIELDED_TAIL_EPS_R, _AIR_EPS_R = 2.7, 1.5, 3.0, 1.0
#: Least length of a cross-section, and difference of equal ones [mm].
_LEAST_MM, _EQUAL_MM = 0.02, 1e-6
#: Cross-sections of a piece in which the copper converges.
_N_CONVERGING = 3
#: Before the net of an electrode, in the sheet.
_LOWER, _UPPER = "lower electrode ", "upper electrode "


class _Copper(NamedTuple):
    """Copper of one net: its area [mm], with the coordinate first in which cuts follow each other, and its height."""

    net: str
    area: Any
    height_mm: float


class _Section(NamedTuple):
    """Strips of a cross-section, and the length for which it stands [mm]."""

    strips: tuple[Strip, ...]
    length_mm: float


def couplings_text(design: FootDesign) -> str:
    """Return the content of a foot's `couplings.yaml`: its couplings with each board, a conductor a line."""
    boards = {board: flex_couplings(flexes(design, board)) for board in BOARDS}
    return render("lab/couplings/couplings.yaml", {"foot_type": design.foot_type, "boards": boards})


def flex_couplings(both: tuple[Flex, Flex], n_segments: int = N_SEGMENTS) -> BoardCouplings:
    """Return the couplings of a foot's lines with the board of its flexes.

    Args:
        both: The lower and the upper flex.
        n_segments: Segments of a strip, at least.
    """
    conductors = (*sorted({net for flex in both for net in flex.contacts} - {GROUND}), GROUND)
    n, design = len(conductors), both[0].design
    mutual_ff, metal_ff, half_mm = np.zeros((n, n)), np.zeros(n), design.sheet_mm / 2.0

    def section_ff(section: _Section, plane_mm: float | None = None) -> Vector:
        nets, found = mutual_capacitance(section.strips, plane_mm=plane_mm, n_segments=n_segments)
        return section.length_mm * EPS0_FF_PER_MM * _of_conductors(nets, found, conductors)

    in_foot = [*_in_foot(both[0], -design.spacer_mm, _LOWER), *_in_foot(both[1], 0.0, _UPPER)]
    for section in (
        *_sections(in_foot, -half_mm, half_mm),
        *_sections([each._replace(area=_swapped(each.area)) for each in in_foot], -half_mm, half_mm),
    ):
        mutual_ff += _SHEET_EPS_R * section_ff(section)
    for flex in both:
        eps_r = np.full((n, n), _SHIELDED_TAIL_EPS_R if flex.shield_net else _TAIL_EPS_R)
        eps_r[-1] = eps_r[:, -1] = _AIR_EPS_R
        copper = _copper(flex)
        for section in _sections(copper, half_mm, flex.tail_start_u_mm):
            mutual_ff += eps_r * section_ff(section)
        for section in _sections(copper, flex.tail_start_u_mm, flex.tail_end_u_mm):
            in_air_ff = section_ff(section)
            mutual_ff += eps_r * in_air_ff
            metal_ff += _AIR_EPS_R * (section_ff(section, -METAL_MM) - in_air_ff)[-1]
    return BoardCouplings(
        conductors=conductors,
        mutual_ff=tuple(tuple(row) for row in mutual_ff.round(2).tolist()),
        metal_ff=tuple(metal_ff.round(2).tolist()),
    )


def _of_conductors(nets: Sequence[str], found: Vector, conductors: Sequence[str]) -> Vector:
    """Return the capacitances of a cross-section's nets as those of all conductors, without those of the elements."""
    mutual = np.zeros((len(conductors),) * 2)
    place = [conductors.index(net.removeprefix(_LOWER).removeprefix(_UPPER)) for net in nets]
    for a, (net, row) in enumerate(zip(nets, place, strict=True)):
        for b, (other, column) in enumerate(zip(nets, place, strict=True)):
            is_element = net.startswith((_LOWER, _UPPER)) and other.startswith((_LOWER, _UPPER))
            if a != b and row != column and not (is_element and net[:5] != other[:5]):
                mutual[row, column] += found[a, b]
        if row != len(conductors) - 1:
            mutual[row, -1] += found[a, a]
            mutual[-1, row] += found[a, a]
    return mutual


def _copper(flex: Flex, height_mm: float = 0.0, electrodes: str = "") -> list[_Copper]:
    """Return the copper of a flex by net, in its own coordinates; electrodes apart if they have a prefix."""
    shapes: dict[tuple[str, float], list[Any]] = {}
    for shape in flex.copper:
        is_electrode = isinstance(shape, Pad) and not shape.pin
        net = electrodes + shape.net if is_electrode else shape.net
        shapes.setdefault((net, height_mm), []).append(_area(shape))
    for pad in flex.shield:
        shapes.setdefault((pad.net, height_mm + dimensions.LAYER_DISTANCE_MM), []).append(_area(pad))
    areas = {key: shapely.union_all(own) for key, own in shapes.items()}
    # A trace that leads over an electrode ends at its edge.
    return [
        _Copper(net, area.difference(areas.get((electrodes + net, height), shapely.Point())), height)
        if electrodes and not net.startswith(electrodes)
        else _Copper(net, area, height)
        for (net, height), area in areas.items()
    ]


def _area(shape: Pad | Trace) -> Any:
    if isinstance(shape, Trace):
        line = shapely.LineString(shape.points_mm)
        return line.buffer(shape.width_mm / 2.0, cap_style="flat", join_style="mitre")
    (u, v), (length, width) = shape.centre_mm, shape.size_mm
    return shapely.box(u - length / 2.0, v - width / 2.0, u + length / 2.0, v + width / 2.0)


def _in_foot(flex: Flex, height_mm: float, electrodes: str) -> list[_Copper]:
    """Return the copper of a flex in foot coordinates."""
    to_foot = flex.artwork_to_foot
    return [
        each._replace(
            area=shapely.transform(
                each.area, lambda points: np.array([to_foot((u, v)) for u, v in points.tolist()])
            )
        )
        for each in _copper(flex, height_mm, electrodes)
    ]


def _swapped(area: Any) -> Any:
    return shapely.transform(area, lambda points: points[:, ::-1])


def _sections(copper: Sequence[_Copper], from_mm: float, to_mm: float) -> Iterator[_Section]:
    """Yield the cross-sections of copper between two places [mm]."""
    corners = np.concatenate([shapely.get_coordinates(each.area)[:, 0] for each in copper])
    places = [from_mm]
    for corner in [*np.unique(corners[(corners > from_mm) & (corners < to_mm)]).tolist(), to_mm]:
        if corner - places[-1] > _LEAST_MM:
            places.append(corner)
    places[-1] = to_mm
    for start, end in pairwise(places):
        first, last = (_strips(copper, start + share * (end - start)) for share in (0.01, 0.99))
        if not first:
            continue
        n = 1 if _are_equal(first, last) else _N_CONVERGING
        for k in range(n):
            strips = _strips(copper, start + (k + 0.5) / n * (end - start))
            yield _Section(strips, (end - start) / n)


def _strips(copper: Sequence[_Copper], place_mm: float) -> tuple[Strip, ...]:
    """Return the strips of the cross-section at a place [mm]."""
    far = 1e3
    line = shapely.LineString([(place_mm, -far), (place_mm, far)])
    return tuple(
        Strip(each.net, bounds[1], bounds[3], each.height_mm)
        for each in copper
        for bounds in shapely.bounds(shapely.get_parts(each.area.intersection(line))).tolist()
        if bounds[3] - bounds[1] > _EQUAL_MM
    )


def _are_equal(first: Sequence[Strip], last: Sequence[Strip]) -> bool:
    return [strip.net for strip in first] == [strip.net for strip in last] and np.allclose(
        [strip[1:] for strip in first], [strip[1:] for strip in last], rtol=0.0, atol=_EQUAL_MM
    )
