"""Response tables of feet whose geometry or materials differ from the released design, for the study `mismatch`.

A change of a thickness, a modulus or the assembly is solved twice on one coarse mesh size, as designed and changed. The
difference is added to the released table, so that the error of the coarse mesh cancels to first order.
"""

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np

from footsense.foot.response_table import FootResponse
from footsense.frames import Vector
from footsense.lab.fem.mesh import COARSE_MESH, MeshSize
from footsense.lab.fem.whole import NO_IMPERFECTION, Imperfection, solve_whole_foot, with_added_response
from footsense.lab.geometry import FootDesign, ThinFilm
from footsense.lab.response import make_response

#: Mesh of the row `mesh`: as fine as the released one, with other elements.
ALTERNATIVE_MESH = MeshSize(
    ball_mm=6.0,
    plate_mm=2.5,
    surface_mm=3.5,
    bar_mm=0.6,
    grading=0.7,
    edge_layer_rel=0.12,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignVariant:
    """Changes of the released foot design: thickness, materials, assembly errors, or mesh; none by default.

    Attributes:
        plate_thickness_factor: Thickness of the plates over that designed [1].
        sheet_modulus_factor: Young's modulus of the sheet over that designed [1].
        rubber_poisson: Poisson's ratio of the rubber; None for that designed.
        gold: Electrodes that stiffen the plates; None for those designed.
        imperfection: Assembly errors.
        mesh_size: Mesh that the whole table is solved on; None for a difference on coarse meshes.
    """

    plate_thickness_factor: float = 1.0
    sheet_modulus_factor: float = 1.0
    rubber_poisson: float | None = None
    gold: ThinFilm | None = None
    imperfection: Imperfection = NO_IMPERFECTION
    mesh_size: MeshSize | None = None

    def changed_design(self, design: FootDesign) -> FootDesign:
        """Return the given foot design with the changed thickness, materials and electrodes."""
        stiffer = msgspec.structs.replace(
            design.pdms, youngs_mpa=design.pdms.youngs_mpa * self.sheet_modulus_factor
        )
        poisson = design.rubber.poisson if self.rubber_poisson is None else self.rubber_poisson
        softer = msgspec.structs.replace(design.rubber, poisson=poisson)
        plate_mm = design.plate_mm * self.plate_thickness_factor
        gold = self.gold or design.gold
        return msgspec.structs.replace(design, plate_mm=plate_mm, pdms=stiffer, rubber=softer, gold=gold)


#: The released solid.
AS_DESIGNED = DesignVariant()


def variant_response(
    solid: DesignVariant, response: FootResponse, design: FootDesign, folder: Path
) -> FootResponse:
    """Return the response table of a changed foot design, read from a cache file or solved.

    Args:
        solid: The solid.
        response: The released table.
        design: Its foot.
        folder: Where solved tables are kept.

    Raises:
        ModelError: The foot cannot be meshed.
    """
    if solid == AS_DESIGNED:
        return response
    digest = hashlib.sha256(f"{solid} {response.sha256}".encode()).hexdigest()[:16]
    path = folder / f"response-{digest}.npz"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".partial")
        _solve_response(solid, response, design, folder).save(part)
        part.replace(path)
    return FootResponse.load(path)


def _solve_response(
    solid: DesignVariant, response: FootResponse, design: FootDesign, folder: Path
) -> FootResponse:
    if solid.mesh_size is not None:
        return make_response(solid.changed_design(design), solid.mesh_size)
    if solid.imperfection != NO_IMPERFECTION:
        series, compliance = _cached_whole_foot_solution(design, solid.imperfection, folder)
        designed, designed_compliance = _cached_whole_foot_solution(design, NO_IMPERFECTION, folder)
        return with_added_response(response, design, series - designed, compliance - designed_compliance)
    changed, coarse = (make_response(one, COARSE_MESH) for one in (solid.changed_design(design), design))
    return replace(
        response,
        hertz_modulus_mpa=changed.hertz_modulus_mpa,
        quarter_series=response.quarter_series + changed.quarter_series - coarse.quarter_series,
        quarter_compliance=response.quarter_compliance
        + changed.quarter_compliance
        - coarse.quarter_compliance,
    )


def _cached_whole_foot_solution(
    design: FootDesign, imperfection: Imperfection, folder: Path
) -> tuple[Vector, Vector]:
    """Return response series and compliance of an unsymmetric foot, solved once and then read from a file."""
    path = folder / f"whole-{hashlib.sha256(f'{design} {imperfection}'.encode()).hexdigest()[:16]}.npz"
    if not path.exists():
        series, compliance = solve_whole_foot(design, imperfection)
        np.savez(path, series=series, compliance=compliance)
    with np.load(path) as kept:
        return kept["series"], kept["compliance"]
