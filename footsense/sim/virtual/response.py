"""Loads of feet to capacitances, in arrays of any library: the response table.

A cell whose gap has closed takes no load from the others, in contrast to the simulated service, where it does.
"""

import functools
import math
import operator

import numpy as np
from array_api_compat import device as device_of
from array_api_compat import is_lazy_array

from footsense.foot.capacitor import EPS0_PF_UM_PER_MM2
from footsense.foot.gap_contact import CELLS_PER_ELEMENT as _CELLS
from footsense.foot.response_table import FootResponse
from footsense.frames import ELEMENTS
from footsense.sim.virtual.network import Array, ArrayModule
from footsense.sim.virtual.variation import FootDraw, rotated

#: What of a foot's draw its readings under a load depend on.
_OF_TABLE = ("turn_rad", "compliance", "distance_um", "gap_um", "gain")


class BatchResponse:
    """Response of feet of a type, each with its deviations.

    Args:
        response: Response table of the type.
        xp: Module of the arrays.
        device: Where they are.
    """

    def __init__(self, response: FootResponse, xp: ArrayModule, device: Array = None) -> None:
        self._response, self._xp = response, xp
        self._area_pf_um = EPS0_PF_UM_PER_MM2 * response.design.electrode_area_mm2
        self._lowest_z = math.sin(math.radians(response.min_elevation_deg))
        # Of each element's cells: shape (9, 6 * cells, products), point force before patch.
        cells = response.closure_coefficients.reshape(2, -1, 3, ELEMENTS, _CELLS)
        series = cells.transpose(3, 0, 2, 4, 1).reshape(ELEMENTS, -1, cells.shape[1]).astype(np.float32)
        self._series = xp.asarray(series, device=device)

    def change_pf(
        self, from_n: Array, to_n: Array, normal: Array, share: Array, element: Array, draw: FootDraw
    ) -> Array:
        """Return what n feet read over a step above what they read in the air, without noise [pF], shape (k, n).

        NaN under a load that leans farther than the response table reaches.

        Args:
            from_n: Force at the begin of the step, frame of the leg [N], shape (3, n).
            to_n: Force at its end [N], same shape.
            normal: Unit normal of the ground, same shape.
            share: Share of the step until each of the k conversions, oldest first [1], shape (k,).
            element: Element of each, same shape, int32.
            draw: The feet.
        """
        xp = self._xp
        loads, loaded = (from_n, to_n, normal), xp.any((from_n != 0.0) | (to_n != 0.0), axis=0)
        if is_lazy_array(loaded):
            return xp.where(loaded, self._of_loaded(share, element, loads, draw), 0.0)
        # Feet in the air need no table, where a library may look which they are.
        (rows,) = xp.nonzero(loaded)
        if not rows.shape[0]:
            return xp.zeros((share.shape[0], *loaded.shape), dtype=xp.float32, device=device_of(loaded))
        loads = tuple(xp.take(part, rows, axis=-1) for part in loads)
        draw = draw._replace(**{name: xp.take(getattr(draw, name), rows, axis=-1) for name in _OF_TABLE})
        found = self._of_loaded(share, element, loads, draw)
        place = xp.clip(xp.cumulative_sum(xp.astype(loaded, xp.int32)) - 1, min=0)
        return xp.where(loaded, xp.take(found, place, axis=1), 0.0)

    def _of_loaded(self, share: Array, element: Array, loads: tuple[Array, ...], draw: FootDraw) -> Array:
        xp, k = self._xp, share.shape[0]
        from_n, to_n, normal = (rotated(xp, part, draw.turn_rad) for part in loads)
        basis = self._basis(normal)
        now_n = from_n[None, :, :] + share[:, None, None] * (to_n - from_n)[None, :, :]
        pressing_n = xp.abs(xp.sum(now_n * normal[None, :, :], axis=1, keepdims=True))
        hertz = 0.75 * self._response.ball_radius_mm / self._response.hertz_modulus_mpa
        point_n = draw.compliance * now_n
        weights = xp.concat([point_n, (hertz * pressing_n) ** (2.0 / 3.0) * point_n], axis=1)
        change_pf = [None] * k
        for first in range(min(k, ELEMENTS)):
            # The normal stays the same over the step: each element needs it once, however often it is read.
            own, at = element[first : first + 1], slice(first, None, ELEMENTS)
            own_distance_um, own_gap_um, own_gain = (
                xp.take(part, own, axis=0) for part in (draw.distance_um, draw.gap_um, draw.gain)
            )
            per_newton_um = xp.reshape(xp.take(self._series, own, axis=0)[0, ...] @ basis, (6, _CELLS, -1))
            terms = (weights[at, c, None, :] * per_newton_um[c, ...] for c in range(6))
            free_um = functools.reduce(operator.add, terms)
            closure_um = xp.minimum(own_gain * xp.minimum(free_um, own_gap_um), own_gap_um)
            closure_rel = xp.mean(closure_um / (own_distance_um - closure_um), axis=1)
            read_pf = self._area_pf_um / own_distance_um * closure_rel
            change_pf[at] = [read_pf[j, :] for j in range(read_pf.shape[0])]
        return xp.where(normal[2, :] < self._lowest_z, math.nan, xp.stack(change_pf))

    def _basis(self, normal: Array) -> Array:
        """Return what `series_basis` does, by recurrence, shape (products, n), of normals, shape (3, n)."""
        xp, rim = self._xp, math.radians(self._response.fit_elevation_deg)
        plane = normal[:2, :] * (
            (1.0 + math.sin(rim)) / math.cos(rim) / (1.0 + xp.maximum(normal[2:, :], self._lowest_z))
        )
        chebyshev = [xp.ones_like(plane), plane]
        while len(chebyshev) <= self._response.degree:
            chebyshev.append(2.0 * plane * chebyshev[-1] - chebyshev[-2])
        of_y = xp.stack([each[1, :] for each in chebyshev])
        rows = [of_x[:1, :] * of_y[: of_y.shape[0] - i, :] for i, of_x in enumerate(chebyshev)]
        return xp.concat(rows, axis=0)
