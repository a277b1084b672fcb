"""Study `floor`: errors by assuming a Hertz patch or small strain, each against the finite-strain contact solve."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from footsense.lab.contact.full_solve import FootContactModel
from footsense.lab.contact.mesh import ContactMeshSize
from footsense.lab.fidelity.loads import loads_in_mirror_plane
from footsense.lab.former_page import Plots, Study, StudyContext
from footsense.lab.plots import subplot_row

#: Differences on one mesh need no fine one.
_SIZE, _QUICK_SIZE = (
    ContactMeshSize(bar_mm=1.0, patch_element_rel=0.4),
    ContactMeshSize(ball_mm=5.0, plate_mm=3.5, bar_mm=4.0, patch_element_rel=0.8),
)
#: Options of the full solve with a part left out.
SIMPLIFICATIONS: dict[str, dict[str, Any]] = {
    "Hertz patch": {"floor": "hertz"},
    "small strain": {"finite_strain": False},
    "both": {"floor": "hertz", "finite_strain": False},
}


#: Elevation of contact normal and of force [deg], magnitude [gf]. Upright and inclined, as heavy as the paper's
#: heaviest, one that leans by 20 deg, and a large deformation.
_LOADS = (
    (90.0, 90.0, 150.0),
    (45.0, 45.0, 50.0),
    (45.0, 45.0, 150.0),
    (80.0, 60.0, 60.0),
    (90.0, 90.0, 1000.0),
)


def _load_label(normal_deg: float, force_deg: float, magnitude_gf: float) -> str:
    """Return the label of a load: elevation [deg], magnitude [gf], tilt of the normal against the force [deg]."""
    lean = force_deg - normal_deg
    leaning = f", normal {abs(lean):g} deg off" if lean else ""
    return f"{force_deg:g} deg, {magnitude_gf:g} gf{leaning}"


@dataclass(frozen=True, kw_only=True)
class LoadComparison:
    """Finite-strain contact solution under one load, and the error of each simplification.

    Attributes:
        load: In words.
        max_closure_difference_rel: Largest difference of a mean closure over the largest closure [1], by what is left
            out.
        patch_radius_mm: Radius of the patch of the full solve [mm].
        hertz_radius_mm: Hertz's radius [mm].
        newton_steps: Steps of the full solve.
    """

    load: str
    max_closure_difference_rel: dict[str, float]
    patch_radius_mm: float
    hertz_radius_mm: float
    newton_steps: int


@dataclass(frozen=True, kw_only=True)
class Results:
    """Results of the study `floor`: one comparison per load."""

    loads: list[LoadComparison]


def compute(context: StudyContext) -> tuple[Results, Plots]:
    """Return the errors of each simplification under every load, against the full physics, with a figure."""
    size = _QUICK_SIZE if context.quick else _SIZE
    solved = []
    cases = _LOADS[:1] if context.quick else _LOADS
    loads = loads_in_mirror_plane(cases)
    for case, normal, force_n in zip(cases, loads.normal, loads.force_n, strict=True):
        full = FootContactModel(context.foot_design, mesh_size=size).solve(normal, force_n)
        others = {
            name: FootContactModel(context.foot_design, mesh_size=size, **options).solve(normal, force_n)
            for name, options in SIMPLIFICATIONS.items()
        }
        one = LoadComparison(
            load=_load_label(*case),
            max_closure_difference_rel={
                name: float(np.abs(other.closure_um - full.closure_um).max() / full.closure_um.max())
                for name, other in others.items()
            },
            patch_radius_mm=full.patch.radius_mm,
            hertz_radius_mm=float(context.response.patch_radius_mm(normal, force_n)),
            newton_steps=full.newton_steps,
        )
        solved.append(one)
        context.report_progress(
            f"floor: {one.load}, {full.n_unknowns} unknowns, {full.newton_steps} Newton steps"
        )
    return Results(loads=solved), {"floor.png": _figure(solved)}


def _figure(loads: list[LoadComparison]) -> Figure:
    """Return the bar chart of the errors of each simplification."""
    figure, (axes,) = subplot_row(1, 8.0, 3.4)
    axes.grid(visible=False, axis="x")
    width = 0.8 / len(SIMPLIFICATIONS)
    for number, name in enumerate(SIMPLIFICATIONS):
        place = np.arange(len(loads)) + (number - (len(SIMPLIFICATIONS) - 1) / 2.0) * width
        axes.bar(place, [100.0 * load.max_closure_difference_rel[name] for load in loads], width, label=name)
    axes.axhline(1.0, color="k", ls=":", lw=1, label="accuracy of the table")
    axes.set_xticks(np.arange(len(loads)), [load.load.replace(", normal", ",\nnormal") for load in loads])
    axes.set(yscale="log", ylabel="closure, largest difference [%]")
    axes.legend(fontsize=8, ncols=4)
    return figure


STUDY = Study(
    name="floor", title="The error of Hertz's patch and of small strain", compute=compute, uses_network=False
)
