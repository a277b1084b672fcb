"""Study `floor`: what the Hertz patch, small strain and open gaps cost, each against the full solve on one mesh."""

from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.lab.contact.full_solve import FullFoot, FullSolution
from footsense.lab.contact.mesh import Fineness
from footsense.lab.studies.page import Page, StudyContext, table

_FIGURE = "floor.png"
#: Differences on one mesh need no fine one.
_FINENESS, _QUICK_FINENESS = (
    Fineness(bar_mm=1.0, patch_rel=0.4),
    Fineness(ball_mm=5.0, plate_mm=3.5, bar_mm=4.0, patch_rel=0.8),
)
#: What is left out, and how the full solve is asked for that.
_WITHOUT: dict[str, dict[str, Any]] = {
    "Hertz patch": {"floor": "hertz"},
    "small strain": {"finite_strain": False},
    "both": {"floor": "hertz", "finite_strain": False},
}


class _Load(NamedTuple):
    """A contact in the mirror plane: elevations of its normal and of the force [deg], magnitude [gf]."""

    normal_deg: float
    force_deg: float
    magnitude_gf: float

    @property
    def label(self) -> str:
        """The load in words."""
        lean = self.force_deg - self.normal_deg
        leaning = f", normal {abs(lean):g} deg off" if lean else ""
        return f"{self.force_deg:g} deg, {self.magnitude_gf:g} gf{leaning}"

    def solve(self, foot: FullFoot) -> FullSolution:
        """Return what a foot answers."""
        return foot.solve(
            _upward(self.normal_deg), self.magnitude_gf * GRAM_FORCE_N * _upward(self.force_deg)
        )


#: Upright and inclined, as heavy as the paper's heaviest, and one that leans by 20 deg, a large deformation.
_LOADS = (
    _Load(90.0, 90.0, 150.0),
    _Load(45.0, 45.0, 50.0),
    _Load(45.0, 45.0, 150.0),
    _Load(80.0, 60.0, 60.0),
    _Load(90.0, 90.0, 1000.0),
)


def _upward(elevation_deg: float) -> NDArray[np.float64]:
    """Return the unit vector of an elevation in the plane y = 0."""
    angle = np.radians(elevation_deg)
    return np.array([np.cos(angle), 0.0, np.sin(angle)])


def _difference_rel(other: FullSolution, full: FullSolution) -> float:
    """Return the largest difference of a mean closure, over the largest closure [1]."""
    return float(np.abs(other.closure_um - full.closure_um).max() / full.closure_um.max())


def _figure(loads: list[_Load], found: dict[str, list[float]]) -> Figure:
    """Return the differences as bars."""
    figure = Figure(figsize=(8.0, 3.4), layout="constrained")
    axes = figure.subplots()
    width = 0.8 / len(found)
    for number, (name, differences) in enumerate(found.items()):
        place = np.arange(len(loads)) + (number - (len(found) - 1) / 2.0) * width
        axes.bar(place, 100.0 * np.array(differences), width, label=name)
    axes.axhline(1.0, color="k", ls=":", lw=1, label="accuracy of the table")
    axes.set_xticks(np.arange(len(loads)), [load.label.replace(", normal", ",\nnormal") for load in loads])
    axes.set(yscale="log", ylabel="closure, largest difference [%]")
    axes.grid(axis="y", alpha=0.3)
    axes.legend(fontsize=8, ncols=4)
    return figure


def page(bench: StudyContext) -> Page:
    """Solve every load with everything, and with each part left out."""
    loads = list(_LOADS[:1] if bench.quick else _LOADS)
    fineness = _QUICK_FINENESS if bench.quick else _FINENESS
    found: dict[str, list[float]] = {name: [] for name in _WITHOUT}
    rows, radii = [], []
    for load in loads:
        full = load.solve(FullFoot(bench.sole, fineness=fineness))
        for name, options in _WITHOUT.items():
            found[name].append(
                _difference_rel(load.solve(FullFoot(bench.sole, fineness=fineness, **options)), full)
            )
        hertz_mm = bench.response.patch_radius_mm(
            _upward(load.normal_deg), load.magnitude_gf * GRAM_FORCE_N * _upward(load.force_deg)
        )
        radii.append(full.patch_mm / float(hertz_mm))
        shares = [f"{100.0 * found[name][-1]:.2f}" for name in _WITHOUT]
        rows.append([load.label, *shares, f"{full.patch_mm:.3f} / {hertz_mm:.3f}", f"{full.newton_steps}"])
        bench.say(f"floor: {load.label}, {full.n_unknowns} unknowns, {full.newton_steps} Newton steps")
    quick = "**Quick run: one load on a rough mesh.**\n\n" if bench.quick else ""
    worst = {name: 100.0 * max(differences) for name, differences in found.items()}
    body = f"""{quick}The table of responses puts Hertz's pressure on the ball, along the force, and strains little.
What does that cost? The full solve has neo-Hookean solids, gaps in contact, and a rigid floor with Coulomb friction
(0.7) that comes from below until it exerts the asked force; here it is solved once with everything and once with each
part left out, on one mesh, so that the mesh does not count. Largest difference of a mean closure over the largest:

{table(["load", *(f"{name} [%]" for name in _WITHOUT), "patch, solved / Hertz [mm]", "Newton steps"], rows)}

![]({_FIGURE})

At worst the patch costs {worst["Hertz patch"]:.2f} % and small strain {worst["small strain"]:.2f} %.
"""
    values = {
        "loads": [load._asdict() for load in loads],
        "difference_rel": found,
        "patch_over_hertz": radii,
    }
    return Page(
        name="floor",
        title="What Hertz and small strain cost",
        body=body,
        figures={_FIGURE: _figure(loads, found)},
        values=values,
    )
