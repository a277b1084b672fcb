"""Finite element model of a whole, unsymmetric foot, for feet that are not put together as designed.

The sheet stays where it is, the balls move. What an imperfection changes is added to the released table, so that the
error of the coarse mesh of a whole foot cancels:

    table of the imperfect foot = released table + (imperfect - as designed), both on meshes of that size

Bonds are linear: a bar that is not bonded also bears no pressure.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import ngsolve as ng
import numpy as np

from footsense.foot.response_table import FLAT_OF_GRID, GRID_SIDE, FootResponse
from footsense.frames import Vector
from footsense.lab.fem.adjoint import solve_cell_closure_fields
from footsense.lab.fem.elasticity import BondedLayer
from footsense.lab.fem.mesh import COARSE_MESH, build_mesh
from footsense.lab.fem.quarter import NO_MIRRORS, QuarterFoot
from footsense.lab.geometry import FootDesign
from footsense.lab.response import fit_series, patch_series


class _WholeFoot(QuarterFoot):
    """Factorised finite element problem of a whole foot on the coarse mesh.

    Args:
        design: The foot.
        sheet_offset_mm: x of the sheet's centre from the axis of its balls [mm].
        bonded_width_share: How much of the width of the bar between front and middle row is bonded [1].
    """

    def __init__(self, design: FootDesign, sheet_offset_mm: float, bonded_width_share: float) -> None:
        self._offset_mm = sheet_offset_mm
        mesh = build_mesh(design, COARSE_MESH, sheet_offset_mm, quarter=False)
        inner, outer = design.bar_span_mm
        in_bar = ng.IfPos(ng.x - inner, ng.IfPos(outer - ng.x, 1.0, 0.0), 0.0)
        bonded = 1.0 - (1.0 - bonded_width_share) * in_bar
        layer = BondedLayer(design.pdms, design.spacer_mm, bonded_share=bonded)
        super().__init__(design, COARSE_MESH, NO_MIRRORS, mesh, layer)

    @property
    def ball_centre_mm(self) -> tuple[float, float, float]:
        """Centre of the ground-side ball from the middle of the sheet [mm]."""
        return -self._offset_mm, 0.0, -self.design.plate_mm


def _solve_whole_foot(foot: tuple[FootDesign, float, float]) -> tuple[Vector, Vector]:
    """Return response series [um/N], (products, 324, 3), and compliance [um/N], (324, 324), of a whole foot."""
    field = solve_cell_closure_fields(_WholeFoot(*foot))
    whole = field.compliance_um_per_n
    return fit_series(field), (whole + whole.T) / 2.0


def with_added_response(
    response: FootResponse, design: FootDesign, series: Vector, compliance: Vector
) -> FootResponse:
    """Return a response table with a change of series and compliance added.

    Args:
        response: The released table.
        design: Its foot.
        series: Change of the series of G0 [um/N], shape (products, 324, 3).
        compliance: Change of the compliance [um/N], shape (324, 324).
    """
    whole = response.closure_coefficients.reshape(2, len(series), 3, -1).transpose(0, 1, 3, 2)
    whole = whole + np.stack([series, patch_series(series, design)])
    order = FLAT_OF_GRID.ravel()
    stiff = (response.compliance_um_per_n + compliance)[np.ix_(order, order)]
    return replace(
        response,
        quarter_series=whole[:, :, FLAT_OF_GRID],
        quarter_compliance=stiff.reshape((GRID_SIDE,) * 4),
        sha256="",
    )


def other_tables(
    design: FootDesign,
    response: FootResponse,
    each: Callable[[Callable[[Any], Any], Iterable[Any]], list[Any]],
) -> dict[str, FootResponse]:
    """Return the tables of feet with `sheet_off_centre` and `bar_not_bonded`.

    Args:
        design: The released foot.
        response: Its table.
        each: Applies a function to each of some parts, such as `compute_each`.
    """
    feet = {
        "sheet_off_centre": (design, 0.6, 1.0),
        "bar_not_bonded": (design, 0.0, 0.01),
    }
    (series, compliance), *others = each(_solve_whole_foot, [(design, 0.0, 1.0), *feet.values()])
    return {
        name: with_added_response(response, design, own - series, stiff - compliance)
        for name, (own, stiff) in zip(feet, others, strict=True)
    }
