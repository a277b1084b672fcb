"""Study `floor`: errors of the Hertz patch and of small strain, each against the full solve on one mesh."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from footsense.foot.directions import directions
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.lab.contact.full_solve import FullFoot, FullSolution
from footsense.lab.contact.mesh import ContactMeshSize
from footsense.lab.studies.page import Figures, Study, StudyContext, panels

Vector = NDArray[np.float64]

_FIGURE = "floor.png"
#: Differences on one mesh need no fine one.
_SIZE, _QUICK_SIZE = (
    ContactMeshSize(bar_mm=1.0, patch_rel=0.4),
    ContactMeshSize(ball_mm=5.0, plate_mm=3.5, bar_mm=4.0, patch_rel=0.8),
)
#: Options of the full solve with a part left out.
WITHOUT: dict[str, dict[str, Any]] = {
    "Hertz patch": {"floor": "hertz"},
    "small strain": {"finite_strain": False},
    "both": {"floor": "hertz", "finite_strain": False},
}


class _Load(NamedTuple):
    """A contact in the mirror plane: normal elevation [deg], force elevation [deg] and force magnitude [gf]."""

    normal_deg: float
    force_deg: float
    magnitude_gf: float

    @property
    def label(self) -> str:
        """The load in words: elevation [deg], magnitude [gf], and tilt of the normal against the force [deg]."""
        lean = self.force_deg - self.normal_deg
        leaning = f", normal {abs(lean):g} deg off" if lean else ""
        return f"{self.force_deg:g} deg, {self.magnitude_gf:g} gf{leaning}"

    @property
    def normal(self) -> Vector:
        """Inward unit normal at the contact, shape (3,)."""
        return directions(0.0, self.normal_deg)

    @property
    def force_n(self) -> Vector:
        """Ground reaction on the foot [N], shape (3,)."""
        return self.magnitude_gf * GRAM_FORCE_N * directions(0.0, self.force_deg)

    def solve(self, foot: FullFoot) -> FullSolution:
        """Solve the contact of a foot under this load."""
        return foot.solve(self.normal, self.force_n)


#: Upright and inclined, as heavy as the paper's heaviest, and one that leans by 20 deg, a large deformation.
_LOADS = (
    _Load(90.0, 90.0, 150.0),
    _Load(45.0, 45.0, 50.0),
    _Load(45.0, 45.0, 150.0),
    _Load(80.0, 60.0, 60.0),
    _Load(90.0, 90.0, 1000.0),
)


def _difference_rel(other: FullSolution, full: FullSolution) -> float:
    """Return the largest difference of a mean closure, over the largest closure [1]."""
    return float(np.abs(other.closure_um - full.closure_um).max() / full.closure_um.max())


@dataclass(frozen=True, kw_only=True)
class Solved:
    """Patch radius and Newton steps of the full solve under one load, and the error of each simplification.

    Attributes:
        load: In words.
        difference_rel: Largest difference of a mean closure over the largest closure [1], by what is left out.
        patch_mm: Radius of the patch of the full solve [mm].
        hertz_mm: Hertz's radius [mm].
        newton_steps: Steps of the full solve.
    """

    load: str
    difference_rel: dict[str, float]
    patch_mm: float
    hertz_mm: float
    newton_steps: int


@dataclass(frozen=True, kw_only=True)
class Results:
    """Results of the study `floor`: the solution under each load."""

    loads: list[Solved]


def compute(context: StudyContext) -> tuple[Results, Figures]:
    """Solve every load with everything, and with each part left out."""
    size = _QUICK_SIZE if context.quick else _SIZE
    solved = []
    for load in _LOADS[:1] if context.quick else _LOADS:
        full = load.solve(FullFoot(context.foot_design, size=size))
        others = {
            name: load.solve(FullFoot(context.foot_design, size=size, **options))
            for name, options in WITHOUT.items()
        }
        one = Solved(
            load=load.label,
            difference_rel={name: _difference_rel(other, full) for name, other in others.items()},
            patch_mm=full.patch_mm,
            hertz_mm=float(context.response.patch_radius_mm(load.normal, load.force_n)),
            newton_steps=full.newton_steps,
        )
        solved.append(one)
        context.say(f"floor: {load.label}, {full.n_unknowns} unknowns, {full.newton_steps} Newton steps")
    return Results(loads=solved), {_FIGURE: _figure(solved)}


def _figure(loads: list[Solved]) -> Figure:
    """Draw the differences as bars."""
    figure, (axes,) = panels(1, 8.0, 3.4)
    axes.grid(visible=False, axis="x")
    width = 0.8 / len(WITHOUT)
    for number, name in enumerate(WITHOUT):
        place = np.arange(len(loads)) + (number - (len(WITHOUT) - 1) / 2.0) * width
        axes.bar(place, [100.0 * load.difference_rel[name] for load in loads], width, label=name)
    axes.axhline(1.0, color="k", ls=":", lw=1, label="accuracy of the table")
    axes.set_xticks(np.arange(len(loads)), [load.load.replace(", normal", ",\nnormal") for load in loads])
    axes.set(yscale="log", ylabel="closure, largest difference [%]")
    axes.legend(fontsize=8, ncols=4)
    return figure


STUDY = Study(
    name="floor",
    title="The error of Hertz's patch and of small strain",
    results=Results,
    compute=compute,
)
