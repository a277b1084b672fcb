"""Page `physics`: the solid against finer meshes, and what each simplification of it costs."""

from dataclasses import replace
from itertools import chain
from time import process_time

import msgspec
import numpy as np

from footsense.frames import Vector
from footsense.lab.fem.centred import (
    MIN_COUNTED_REL,
    largest_change,
    solve_centred_closures,
)
from footsense.lab.fem.mesh import COARSE_MESH, FINEST_MESH, RELEASED_MESH, MeshSize
from footsense.lab.geometry import ThinFilm
from footsense.lab.report import StudyContext, Values

TITLE = "How exact the solid is"

#: The films on the faces of the paper's cavities (section IV).
_FILMS = {
    "gold": ThinFilm(thickness_um=0.1, youngs_mpa=79e3, poisson=0.42),
    "parylene": ThinFilm(thickness_um=1.0, youngs_mpa=2.8e3, poisson=0.4),
}
#: Upright, and the lowest of the paper's loads [deg].
_ELEVATIONS_DEG = (90.0, 40.0)
_RELEASED = "the released table's"
_UNREFINED_MESH = MeshSize(bar_mm=0.67, edge_layers=0, order=2)
_MESHES = {
    "no layers at the edges": _UNREFINED_MESH,
    "coarse, of the quick forms": COARSE_MESH,
    _RELEASED: RELEASED_MESH,
    "finer": replace(RELEASED_MESH, bar_mm=0.33, edge_layers=2, edge_layer_rel=0.12),
    "finest": FINEST_MESH,
}
_QUICK_MESHES = {
    "as coarse as can be": replace(_UNREFINED_MESH, bar_mm=1.0, ball_mm=7.0, surface_mm=5.0),
    "no layers at the edges": _UNREFINED_MESH,
}
#: Errors that a table states of itself.
_STATED = ("mesh_asymmetry_rel", "fit_residual_rel", "interpolation_rel")


def compute(context: StudyContext) -> Values:
    """Solve the foot on several meshes and with other materials; compare."""
    meshes, closure_um_per_n = _meshes(context)
    return {
        "meshes": meshes,
        "films": _films(context, closure_um_per_n),
        "min_counted_rel": MIN_COUNTED_REL,
        "stated": {name: context.response.provenance[name] for name in _STATED},
    }


def shown(values: Values) -> Values:
    """Return the worst error on the released mesh; NaN on a quick page, which does not solve it."""
    released = [row["error_rel"] for row in values["meshes"] if row["mesh"] == _RELEASED]
    return {"released_error_rel": max(chain(*released), default=np.nan)}


def _meshes(context: StudyContext) -> tuple[list[Values], Vector]:
    """Return unknowns, time and errors of each mesh, and the released mesh's closures; the first one's if quick.

    Upright loads are compared with the last mesh, inclined ones with the last but one.
    """
    solved = []
    for name, size in (_QUICK_MESHES if context.quick else _MESHES).items():
        elevations_deg = _ELEVATIONS_DEG[: 1 if context.quick or size is FINEST_MESH else 2]
        before_s = process_time()
        closures_um, n_unknowns = solve_centred_closures(context.foot_design, size, elevations_deg)
        processor_s = process_time() - before_s
        solved.append((name, size.order, n_unknowns, processor_s, closures_um))
        context.report_progress(f"mesh {name}: {n_unknowns} unknowns, {processor_s:.1f} s")
    best = [solved[-1][-1][0], None if context.quick else solved[-2][-1][1]]
    rows = [
        {
            "mesh": name,
            "order": order,
            "unknowns": unknowns,
            "processor_s": processor_s,
            "corner_um": closures_um[0].max(),
            "error_rel": [
                abs(largest_change(own, of))
                for own, of in zip(closures_um, best, strict=False)
                if own is not of and not np.array_equal(own, of)
            ],
        }
        for name, order, unknowns, processor_s, closures_um in solved
    ]
    (released_um,) = (one[-1] for one in solved if one[0] in (_RELEASED, next(iter(_QUICK_MESHES))))
    return rows, released_um


def _films(context: StudyContext, bare_um: Vector) -> Values:
    """Return the largest change of a closure by each thin film, upright and inclined, on the same mesh."""
    size = next(iter(_QUICK_MESHES.values())) if context.quick else RELEASED_MESH
    elevations_deg = _ELEVATIONS_DEG[: 1 if context.quick else 2]
    changes = {}
    for name, film in list(_FILMS.items())[: 1 if context.quick else None]:
        design = msgspec.structs.replace(context.foot_design, **{name: film})
        with_um, _ = solve_centred_closures(design, size, elevations_deg)
        changes[name] = [largest_change(own, of) for own, of in zip(with_um, bare_um, strict=True)]
        context.report_progress(f"film {name} solved")
    return changes
