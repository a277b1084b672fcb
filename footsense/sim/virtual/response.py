"""Loads of feet to capacitances, in arrays of any library: the response table, and closed gaps on the host.

A gap that closes is a complementarity problem of one foot alone, which is solved exactly, in double precision.
"""

import functools
import math
import operator
from typing import NamedTuple

import numpy as np
from array_api_compat import device as device_of
from array_api_compat import is_torch_array, to_device
from numpy.typing import NDArray

from footsense.foot.capacitor import EPS0_PF_UM_PER_MM2
from footsense.foot.directions import normalized
from footsense.foot.gap_contact import CELLS_PER_ELEMENT as _CELLS
from footsense.foot.gap_contact import solve_contact_lcp
from footsense.foot.response_table import FootResponse
from footsense.frames import ELEMENTS, Vector
from footsense.sim.virtual.network import Array, ArrayModule
from footsense.sim.virtual.variation import FootDraw

#: Free closure over the gap from which an element is saturated for certain [1].
_CERTAIN_SATURATION = 1.5
#: Loads with closed cells whose response is computed at once.
_LOADS_AT_ONCE = 2048


class StepLoads(NamedTuple):
    """Loads of n feet over a step, frame of the leg.

    Attributes:
        from_n: Force at its begin [N], shape (n, 3).
        to_n: Force at its end [N], same shape.
        normal: Unit normal of the ground, same shape.
    """

    from_n: Array
    to_n: Array
    normal: Array


class Conversions(NamedTuple):
    """The k conversions of a step, oldest first.

    Attributes:
        share: Share of the step until each [1], shape (k,).
        element: Its element, same shape, int32.
    """

    share: Array
    element: Array


class StepReadings(NamedTuple):
    """What n feet read in k conversions, shape (n, k) each.

    Attributes:
        read_pf: Capacitances, stray included, without noise [pF], as if a closed cell took no load from others.
        closed: Whether a cell of the element is closed.
        mean_rel: Mean free closure of the element over its gap [1].
    """

    read_pf: Array
    closed: Array
    mean_rel: Array


def _on_host(array: Array) -> NDArray[np.float64]:
    found: NDArray[np.float64] = np.asarray(to_device(array, "cpu") if is_torch_array(array) else array)
    return found


class BatchResponse:
    """Response of feet of a type, each with its deviations.

    Args:
        response: Response table of the type.
        xp: Module of the arrays.
        device: Where they are.
    """

    def __init__(self, response: FootResponse, xp: ArrayModule, device: Array = None) -> None:
        self._response, self._xp = response, xp
        self.area_pf_um = EPS0_PF_UM_PER_MM2 * response.design.electrode_area_mm2
        self.lowest_z = math.sin(math.radians(response.min_elevation_deg))
        # Of each element's cells: shape (9, 6 * cells, products), point force before patch.
        cells = response.closure_coefficients.reshape(2, -1, 3, ELEMENTS, _CELLS)
        series = cells.transpose(3, 0, 2, 4, 1).reshape(ELEMENTS, -1, cells.shape[1]).astype(np.float32)
        self._series = xp.asarray(series, device=device)

    def open_pf(self, draw: FootDraw) -> Array:
        """Return the capacitances of feet in the air [pF], shape (n, 9) or (1, 9)."""
        return self.area_pf_um / draw.distance_um + draw.stray_pf

    def _in_frame(self, loads: StepLoads, mount: Array) -> StepLoads:
        """Return the loads in the foot's frame, those below the table lifted to its edge."""
        xp = self._xp
        if mount is not None:
            loads = StepLoads(*((mount @ part[:, :, None])[:, :, 0] for part in loads))
        across = loads.normal[:, :2]
        edge = math.sqrt(1.0 - self.lowest_z**2) / xp.sqrt(xp.sum(across * across, axis=1) + 1e-12)
        edge = xp.where(loads.normal[:, 2] < self.lowest_z, edge, xp.ones_like(edge))
        upward = xp.clip(loads.normal[:, 2:], min=self.lowest_z)
        return loads._replace(normal=xp.concat([across * edge[:, None], upward], axis=1))

    def read(self, loads: StepLoads, conversions: Conversions, draw: FootDraw) -> StepReadings:
        """Return the readings of loaded feet."""
        xp, k = self._xp, conversions.share.shape[0]
        loads = self._in_frame(loads, draw.mount)
        # Feet are the last axis, the fastest.
        from_n, to_n, normal = (part.T for part in loads)
        basis = self._basis(normal)
        now_n = from_n[None, :, :] + conversions.share[:, None, None] * (to_n - from_n)[None, :, :]
        pressing_n = xp.abs(xp.sum(now_n * normal[None, :, :], axis=1, keepdims=True))
        hertz = 0.75 * self._response.ball_radius_mm / self._response.hertz_modulus_mpa
        point_n = now_n * draw.compliance.T[None, :, :]
        weights = xp.concat([point_n, (hertz * pressing_n) ** (2.0 / 3.0) * point_n], axis=1)
        distance_um, gap_um, gain = (
            xp.take(part, conversions.element, axis=1).T[:, None, :]
            for part in (draw.distance_um, draw.gap_um, draw.gain)
        )
        per_um, closed, mean_um = ([None] * k for _ in range(3))
        for first in range(min(k, ELEMENTS)):
            # The normal stays the same over the step: each element needs it once, however often it is read.
            series = xp.take(self._series, conversions.element[first : first + 1], axis=0)[0, ...]
            per_newton_um = xp.reshape(series @ basis, (6, _CELLS, -1))
            at = slice(first, None, ELEMENTS)
            terms = (weights[at, c, None, :] * per_newton_um[c, ...] for c in range(6))
            free_um = functools.reduce(operator.add, terms)
            closure_um = xp.minimum(gain[at, ...] * xp.minimum(free_um, gap_um[at, ...]), gap_um[at, ...])
            of_reads = (
                xp.mean(1.0 / (distance_um[at, ...] - closure_um), axis=1),
                xp.any(free_um > gap_um[at, ...], axis=1),
                xp.mean(free_um, axis=1),
            )
            for of_all, of_element in zip((per_um, closed, mean_um), of_reads, strict=True):
                of_all[at] = [of_element[j, :] for j in range(of_element.shape[0])]
        stray_pf = xp.take(draw.stray_pf, conversions.element, axis=1)
        return StepReadings(
            self.area_pf_um * xp.stack(per_um, axis=1) + stray_pf,
            xp.stack(closed, axis=1),
            (xp.stack(mean_um) / gap_um[:, 0, :]).T,
        )

    def _basis(self, normal: Array) -> Array:
        """Return what `series_basis` does, by recurrence, shape (products, n), of normals, shape (3, n)."""
        xp, rim = self._xp, math.radians(self._response.fit_elevation_deg)
        plane = normal[:2, :] * ((1.0 + math.sin(rim)) / math.cos(rim) / (1.0 + normal[2:, :]))
        chebyshev = [xp.ones_like(plane), plane]
        while len(chebyshev) <= self._response.degree:
            chebyshev.append(2.0 * plane * chebyshev[-1] - chebyshev[-2])
        of_y = xp.stack([each[1, :] for each in chebyshev])
        rows = [of_x[:1, :] * of_y[: of_y.shape[0] - i, :] for i, of_x in enumerate(chebyshev)]
        return xp.concat(rows, axis=0)

    def touching(self, closed_before: Array, readings: StepReadings, is_whole: Array) -> Array:
        """Return the readings that another closed cell changes, shape (n, k).

        It is closed when its element was read last; an element that is saturated for certain is not changed.

        Args:
            closed_before: Whether a cell was closed in the nine conversions before, shape (n, 9).
            readings: The readings.
            is_whole: Whether the first of them is none of those nine, shape (1,).
        """
        xp, k = self._xp, readings.closed.shape[1]
        lately = xp.where(
            is_whole,
            xp.concat([closed_before[:, 1:], readings.closed], axis=1),
            xp.concat([closed_before, readings.closed[:, 1:]], axis=1),
        )
        touches = functools.reduce(operator.or_, (lately[:, ago : ago + k] for ago in range(ELEMENTS)))
        return touches & (readings.mean_rel < _CERTAIN_SATURATION)

    def with_contact(
        self, read_pf: Array, touches: Array, loads: StepLoads, conversions: Conversions, draw: FootDraw
    ) -> Array:
        """Return capacitances without noise [pF], those of feet with closed cells anew, shape (n, k)."""
        xp = self._xp
        feet, columns = np.nonzero(_on_host(touches))
        loads = StepLoads(*map(_on_host, self._in_frame(loads, draw.mount)))
        share, element = map(_on_host, conversions)
        deviations = [
            np.broadcast_to(_on_host(part).astype(np.float64), (len(loads.normal), part.shape[1]))
            for part in (draw.compliance, draw.gap_um, draw.distance_um, draw.gain, draw.stray_pf)
        ]
        touched_pf = np.array(_on_host(read_pf))
        for start in range(0, len(feet), _LOADS_AT_ONCE):
            at, now = (each[start : start + _LOADS_AT_ONCE] for each in (feet, columns))
            from_n, to_n, normal = (part[at].astype(np.float64) for part in loads)
            force_n = from_n + share[now, None] * (to_n - from_n)
            free_um = self._response.free_closure_um(normalized(normal), force_n)
            touched_pf[at, now] = [
                self._touched_pf(free, here, *own)
                for free, here, *own in zip(
                    free_um, element[now], *(part[at] for part in deviations), strict=True
                )
            ]
        return xp.asarray(touched_pf, device=device_of(read_pf))

    def _touched_pf(
        self,
        free_um: Vector,
        element: int,
        compliance: Vector,
        gap_um: Vector,
        distance_um: Vector,
        gain: Vector,
        stray_pf: Vector,
    ) -> float:
        """Return the capacitance of an element of one foot with closed cells [pF]."""
        # Over the compliance, forces of cells on one another are those of the design.
        solved = solve_contact_lcp(
            compliance * free_um, np.repeat(gap_um, _CELLS), self._response.compliance_um_per_n
        )
        closure_um = gain[element] * solved.cell_closures_um[element * _CELLS : (element + 1) * _CELLS]
        spacing_um = distance_um[element] - np.minimum(closure_um, gap_um[element])
        return self.area_pf_um * float(np.mean(1.0 / spacing_um)) + float(stray_pf[element])
