"""Study `solid`: how exact the foot's mechanics and its capacitors are, and what each shortcut costs."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from footsense.foot.gap_contact import ALL_CELLS, CELLS_PER_SIDE
from footsense.foot.hertz import contact_radius_mm
from footsense.foot.response_table import FootResponse
from footsense.lab.fem.centred import Centred, centred_closures
from footsense.lab.fem.fringe import element_pf
from footsense.lab.fem.mesh import COARSE, FINEST, SHIPPED, MeshSize
from footsense.lab.fem.strip import strip_closure_um
from footsense.lab.geometry import Material, SoleDesign
from footsense.lab.response import make_response
from footsense.lab.studies.page import Page, StudyContext, table
from footsense.lab.training.load_cases import paper_training, paper_verification

Vector = NDArray[np.float64]

#: The paper's floor (section III A).
CEMENT = Material(25_000.0, 0.15)
#: The inclined load: the lowest of the paper's.
INCLINED_DEG = 40.0
#: Elements that close less than this share of the most closed one are left out of relative errors.
_COUNTED_REL = 0.05
#: Between SHIPPED and FINEST: what the inclined load, which needs two classes, is judged by.
_FINER = replace(SHIPPED, bar_mm=0.33, layers=2, layer_rel=0.12)
_PLAIN = MeshSize(bar_mm=0.67, layers=0, order=2)
_MESHES = {
    "quadratic, no layers": _PLAIN,
    "quadratic, no layers, finer": replace(_PLAIN, bar_mm=0.33),
    "COARSE": COARSE,
    "SHIPPED": SHIPPED,
    "finer": _FINER,
}
_FIGURE = "solid.png"


@dataclass(frozen=True, slots=True)
class _Run:
    """One mesh with its closures and what they took."""

    name: str
    size: MeshSize
    found: Centred
    wall_s: float
    processor_s: float


def _run(sole: SoleDesign, name: str, size: MeshSize, elevation_deg: tuple[float, ...]) -> _Run:
    """Solve a mesh and time it."""
    before = os.times()
    found = centred_closures(sole, size, elevation_deg)
    after = os.times()
    processor_s = after.user + after.system - before.user - before.system
    return _Run(name, size, found, after.elapsed - before.elapsed, processor_s)


def _worst_rel(closure_um: Vector, best_um: Vector) -> float:
    """Return the largest relative error of the elements that count."""
    counted = np.abs(best_um) > _COUNTED_REL * np.abs(best_um).max()
    return float(np.abs(closure_um / best_um - 1.0)[counted].max())


def _convergence(runs: Sequence[_Run], best: Sequence[Vector]) -> tuple[str, list[list[float]]]:
    """Return the table, and the errors of each run at each elevation."""
    rows, errors = [], []
    for run in runs:
        closures = run.found.closure_um
        rel = [_worst_rel(own, of) for own, of in zip(closures, best, strict=False)]
        errors.append(rel)
        shown = [f"{100.0 * value:.2f}" if value else "-" for value in rel]
        shown += ["-"] * (2 - len(shown))
        work = [str(run.found.unknowns), f"{run.wall_s:.1f}", f"{run.processor_s:.1f}"]
        rows.append([run.name, str(run.size.order), *work, f"{closures[0].max():.3f}", *shown])
    header = ["mesh", "order", "unknowns", "wall [s]", "processor [s]", "corner, upright [um]"]
    return table([*header, "upright, worst [%]", f"{INCLINED_DEG:g} deg, worst [%]"], rows), errors


def _figure(runs: Sequence[_Run], errors: Sequence[Sequence[float]]) -> Figure:
    """Return the error over the processor time of each mesh."""
    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    axes = figure.subplots()
    names = ("upright, 1 N", f"{INCLINED_DEG:g} deg, 1 N")
    for load, (name, marker) in enumerate(zip(names, "os", strict=True)):
        points = [
            (run.processor_s, 100.0 * rel[load])
            for run, rel in zip(runs, errors, strict=True)
            if len(rel) > load and rel[load] > 0.0
        ]
        axes.plot(*zip(*sorted(points), strict=True), marker + "-", label=name, alpha=0.8)
    for run, rel in zip(runs, errors, strict=True):
        if rel[0] > 0.0:
            place = (run.processor_s, 100.0 * rel[0])
            axes.annotate(run.name, place, xytext=(5, 6), textcoords="offset points", fontsize=8)
    axes.axhline(1.0, color="k", lw=0.8, ls="--", label="target")
    axes.set(xscale="log", yscale="log", xlabel="processor time [s]", ylabel="worst error of a closure [%]")
    axes.grid(visible=True, which="both", alpha=0.25)
    axes.margins(x=0.2)
    axes.legend()
    return figure


def _floor(sole: SoleDesign, response: FootResponse) -> tuple[str, float]:
    """Return what a rigid floor costs: radius and closures at 1 N, and the largest change of a closure [1]."""
    rubber = sole.rubber
    both_mpa = 1.0 / (1.0 / rubber.hertz_mpa + 1.0 / CEMENT.hertz_mpa)
    up = np.array([0.0, 0.0, 1.0])
    rows, closures = [], []
    for name, modulus_mpa in (("rigid", rubber.hertz_mpa), ("cement", both_mpa)):
        radius_mm = float(contact_radius_mm(1.0, response.ball_radius_mm, modulus_mpa))
        closures.append(replace(response, hertz_modulus_mpa=modulus_mpa).closure_um(up, up))
        rows.append([name, f"{modulus_mpa:.5f}", f"{radius_mm:.5f}", f"{closures[-1].max():.6f}"])
    text = table(["floor", "E* [MPa]", "patch radius [mm]", "corner [um]"], rows)
    return text, float(np.abs(closures[1] / closures[0] - 1.0).max())


def _fringe(sole: SoleDesign) -> tuple[str, dict[str, float]]:
    """Return what the plate formula leaves out at three closures, and the figures of the text."""
    capacitor, rows = sole.capacitor, []
    rest_pf, plate_pf = element_pf(sole)
    stray_pf = rest_pf - plate_pf
    for closure_um in (0.0, 5.0, 10.0):
        edged_pf, flat_pf = element_pf(sole, closure_um)
        row = [
            f"{closure_um:g}",
            f"{flat_pf:.4f}",
            f"{edged_pf:.4f}",
            f"{100.0 * (edged_pf / flat_pf - 1.0):.2f}",
        ]
        if closure_um:
            change_rel = (edged_pf - rest_pf) / (flat_pf - plate_pf) - 1.0
            read = [
                float(capacitor.closure_um(np.array([edged_pf - own]), np.array([rest_pf - own]))[0])
                for own in (0.0, stray_pf)
            ]
            row += [f"{100.0 * change_rel:.2f}", f"{read[0]:.3f}", f"{read[1]:.3f}"]
        else:
            row += ["-", "-", "-"]
        rows.append(row)
    header = ["closed by [um]", "plates [pF]", "with edges [pF]", "C off by [%]", "change off by [%]"]
    text = table([*header, "read as [um]", "read with the stray taken off [um]"], rows)
    return text, {
        "stray_pf": stray_pf,
        "read_5_um": float(rows[1][5]),
        "read_5_corrected_um": float(rows[1][6]),
    }


def _cells(response: FootResponse) -> tuple[float, float]:
    """Return the largest spread of closure inside a cell [um], and what leaving it out costs a capacitance [1].

    Upright and inclined loads of 1 N. A closure that varies by a standard deviation s inside a cell raises the mean of
    1/D by s^2/D^2; s^2 = (slope x step)^2 / 12 per direction, the slope by differences of neighbouring cells.
    """
    angle = np.radians([90.0, INCLINED_DEG])
    force = np.column_stack([np.cos(angle), np.zeros(2), np.sin(angle)])
    cells_um = np.minimum(response.free_closure_um(force, force), response.design.gap_um)
    grid = cells_um.reshape(2, ALL_CELLS // CELLS_PER_SIDE**2, CELLS_PER_SIDE, CELLS_PER_SIDE)
    variance = sum(np.gradient(grid, axis=axis) ** 2 for axis in (2, 3)) / 12.0
    distance_um = response.design.gap_um + response.design.film_equivalent_um - grid
    lost = (variance / distance_um**3).sum(axis=(2, 3)) / (1.0 / distance_um).sum(axis=(2, 3))
    return float(np.sqrt(variance.max())), float(lost.max())


def page(bench: StudyContext) -> Page:
    """Measure it all; the quick form leaves out the fine meshes and the complete response."""
    both = (90.0, INCLINED_DEG)
    names = ["quadratic, no layers", "COARSE"] if bench.quick else list(_MESHES)
    runs: list[_Run] = []
    for name in names:
        runs.append(_run(bench.sole, name, _MESHES[name], (90.0,) if bench.quick else both))
        bench.say(f"{name}: {runs[-1].found.unknowns} unknowns, {runs[-1].processor_s:.1f} s")
    best = list(runs[-1].found.closure_um)
    if not bench.quick:
        runs.append(_run(bench.sole, "FINEST", FINEST, (90.0,)))
        bench.say(f"FINEST: {runs[-1].found.unknowns} unknowns, {runs[-1].processor_s:.1f} s")
        best[0] = runs[-1].found.closure_um[0]
    convergence, errors = _convergence(runs, best)
    shipped = dict(zip(names, errors, strict=False)).get("SHIPPED", [])
    judged = (
        "Quick form: two coarse meshes, the second judges the first."
        if bench.quick
        else f"The upright load is judged by FINEST, the inclined one by `finer`. SHIPPED is off by at most "
        f"{100.0 * shipped[0]:.2f} % and {100.0 * shipped[1]:.2f} % on an element above "
        f"{100.0 * _COUNTED_REL:g} % of the largest; the target is 1 %."
    )
    speed, seconds = _speed(bench)
    floor, floor_rel = _floor(bench.sole, bench.response)
    law_um, solid_um = (strip_closure_um(bench.sole, solid=solid) for solid in (False, True))
    spacer_rel = law_um / solid_um - 1.0
    fringe, fringe_values = _fringe(bench.sole)
    spread_um, cell_rel = _cells(bench.response)
    stated = bench.response.provenance
    own = [
        ["foot against its transpose", f"{100.0 * stated['mesh_asymmetry_rel']:.3f}"],
        ["samples against series", f"{100.0 * stated['fit_residual_rel']:.3f}"],
        ["series four degrees shorter", f"{100.0 * stated['interpolation_rel']:.3f}"],
        ["cells of 6 x 6: C of an element at 1 N, worst", f"{100.0 * cell_rel:.3f}"],
    ]
    body = f"""\
### Mesh

Closures under centred loads of 1 N, free gaps. {judged}

{convergence}

![]({_FIGURE})

### From nothing to the table, and cases with contact

{speed}

### A rigid floor in place of cement

{floor}

Closures change by at most {100.0 * floor_rel:.1e} %.

### The spacer of {1000.0 * bench.sole.spacer_mm:g} um as a law

In a cross-section in plane strain, one pitch wide, a cavity under uniform pressure closes by {law_um:.4f} um with the
spacer as a law and by {solid_um:.4f} um with the spacer meshed as PDMS that may bulge: {100.0 * spacer_rel:+.3f} %.

### Electrodes have edges

{fringe}

The edges add {fringe_values["stray_pf"]:.3f} pF that hardly change. Left in, they make 5 um read as
{fringe_values["read_5_um"]:.2f} um; taken off as a stray, {fringe_values["read_5_corrected_um"]:.2f} um. So a
calibration's stray has to hold the edges. The simulator's elements have none.

### What the table says of itself

{table(["error, rms over rms unless said", "[%]"], own)}

Inside a cell the closure varies by at most {spread_um:.2f} um rms.
"""
    values = {
        "worst_rel": {run.name: rel for run, rel in zip(runs, errors, strict=True)},
        "processor_s": {run.name: round(run.processor_s, 2) for run in runs},
        "spacer_law_rel": spacer_rel,
        "rigid_floor_rel": floor_rel,
        "cells_rel": cell_rel,
        **seconds,
        **fringe_values,
    }
    return Page(
        name="solid",
        title="How exact the solid is",
        body=body,
        figures={_FIGURE: _figure(runs, errors)},
        values=values,
    )


def _speed(bench: StudyContext) -> tuple[str, dict[str, float]]:
    """Return what the response and 542 cases take: the table, and seconds of wall by step."""
    marks = [os.times()]
    if not bench.quick:
        make_response(bench.sole, SHIPPED, bench.say)
    marks.append(os.times())
    n = len(paper_training(bench.response).force_n) + len(paper_verification(bench.response).force_n)
    marks.append(os.times())
    rows, seconds = [], {}
    steps = (("complete response, SHIPPED", 60.0, "response_s"), (f"{n} cases with contact", 30.0, "cases_s"))
    for (name, target_s, key), before, after in zip(steps, marks[:-1], marks[1:], strict=True):
        if bench.quick and key == "response_s":
            rows.append([name, "not in the quick form", "-", f"{target_s:g}"])
            continue
        processor_s = after.user + after.system - before.user - before.system
        seconds[key] = round(after.elapsed - before.elapsed, 2)
        rows.append([name, f"{seconds[key]:.1f}", f"{processor_s:.1f}", f"{target_s:g}"])
    return table(["step", "wall [s]", "processor [s]", "target on two cores [s]"], rows), seconds
