"""The ladder: what each model of the foot costs, and what it loses."""

import math
from dataclasses import asdict, dataclass
from timeit import default_timer
from typing import Any

import ngsolve as ng
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from footsense.lab.fem.forward import ForwardFoot
from footsense.lab.fem.mesh import COARSE, MeshSize
from footsense.lab.fidelity.answer import Answer
from footsense.lab.fidelity.compare import (
    Distance,
    ForwardAgainstTable,
    Loads,
    distance,
    forward_against_table,
    mirrored_loads,
    paper_loads,
    timed,
)
from footsense.lab.fidelity.drawing import error_against_time, pattern_tiles
from footsense.lab.fidelity.half_space import HalfSpace
from footsense.lab.fidelity.levels import NAMES, Full, rung
from footsense.lab.studies.page import Page, StudyContext, table

_FIGURE, _PATTERN = "fidelity.png", "fidelity-pattern.png"
#: What the full solve is asked: elevation of contact normal and of force [deg], magnitude [gf]. The load of the
#: paper's Fig. 17, one that leans away from the normal, and two that shut gaps.
_FULL_CASES = ((45.0, 45.0, 100.0), (70.0, 90.0, 100.0), (90.0, 90.0, 150.0), (60.0, 60.0, 150.0))
#: Loads that are solved forward.
_FORWARD_CASES, _FORWARD_CASES_QUICK = 12, 2
#: Adjoint solves of a table: one per cell of the quarter and class.
_ADJOINT_SOLVES = 81 * 3


@dataclass(frozen=True, slots=True, eq=False)
class _Climbed:
    """The rungs on one set of loads.

    Attributes:
        answers: By rung.
        seconds: What each load took [s].
        n: Loads.
    """

    answers: dict[str, Answer]
    seconds: dict[str, float]
    n: int


def _climb(bench: StudyContext, names: tuple[str, ...], loads: Loads) -> _Climbed:
    """Ask the rungs."""
    answers, seconds = {}, {}
    for name in names:
        answers[name], taken_s = timed(
            rung(name, bench.response, bench.sole), loads, repeats=1 if name == "full" else 3
        )
        seconds[name] = taken_s / len(loads)
        bench.say(f"fidelity: {name}, {len(loads)} loads in {taken_s:.2g} s")
    return _Climbed(answers, seconds, len(loads))


def _distances(bench: StudyContext, answers: dict[str, Answer], finest: Answer) -> dict[str, Distance]:
    """Return how far each answer is from the finest."""
    network, design = bench.network.force_n, bench.response.design
    return {name: distance(answer, finest, network, design) for name, answer in answers.items()}


def _distance_table(distances: dict[str, Distance]) -> str:
    """Return a row per answer."""
    header = [
        "",
        "closure, rms",
        "largest [um]",
        "ΔC, rms",
        "largest [pF]",
        "direction [deg]",
        "magnitude [gf]",
    ]
    rows = [
        [
            name,
            f"{apart.closure_rel:.1%}",
            f"{apart.closure_max_um:.2f}",
            f"{apart.capacitance_rel:.1%}",
            f"{apart.capacitance_max_pf:.3f}",
            f"{apart.direction_deg:.2f}",
            f"{apart.magnitude_gf:.2f}",
        ]
        for name, apart in distances.items()
    ]
    return table(header, rows)


def _forward(bench: StudyContext, loads: Loads) -> ForwardAgainstTable:
    """Solve some loads one by one, on the mesh that the table is of; quick: on a coarse one."""
    size = COARSE if bench.quick else MeshSize(**bench.response.provenance["mesh"])
    start = default_timer()
    foot = ForwardFoot(bench.sole, size)
    factorise_s = default_timer() - start
    bench.say(f"fidelity: three classes factorised in {factorise_s:.1f} s")
    n = _FORWARD_CASES_QUICK if bench.quick else _FORWARD_CASES
    return forward_against_table(foot, factorise_s, bench.response, loads, n)


def _forward_text(found: ForwardAgainstTable, n: int, *, quick: bool) -> str:
    """Return the part on solving every load."""
    made_s = _ADJOINT_SOLVES * found.adjoint_s
    table_s = found.factorise_s + made_s + n * found.table_s
    forward_s = found.factorise_s + n * found.forward_s
    paid_back = math.ceil(made_s / (found.forward_s - found.table_s))
    mesh = (
        "a coarser mesh than the table's, so the difference is that of the meshes"
        if quick
        else "the table's mesh"
    )
    rows = [
        ["solved, four symmetry classes", f"{1e3 * found.forward_s:.3g} ms", f"{forward_s:.3g} s"],
        ["looked up in the table of adjoint solves", f"{1e3 * found.table_s:.3g} ms", f"{table_s:.3g} s"],
    ]
    header = ["all gaps open, 324 cells", "a load", f"{n} loads, with all that comes before"]
    return f"""
### Solving every load

The same weak form on {mesh}, loaded by the Hertz patch itself: {found.n} loads of the {n}, evenly spread. Once made,
the table answers {found.ratio:.0f} times as fast. Its {_ADJOINT_SOLVES} adjoint solves of
{1e3 * found.adjoint_s:.3g} ms are paid back after {paid_back} loads. The closures of the cells differ by
{found.closure_rel:.2%} rms, those of the elements by {found.closure_max_um:.3f} um at most.

{table(header, rows)}
"""


def _half_space_text(bench: StudyContext, loads: Loads, contact: Answer) -> str:
    """Return the part on the formula."""
    sole = bench.sole
    alone = HalfSpace(sole, balanced=False)
    answers = {
        "half-space": HalfSpace(sole),
        "without statics": alone,
        "with PDMS for the rubber": HalfSpace(replace(sole, rubber=sole.pdms)),
    }
    apart = _distances(
        bench, {name: one.answer(loads.normal, loads.force_n) for name, one in answers.items()}, contact
    )
    edge_mm = (sole.sheet_mm - sole.pitch_mm) / 2.0
    side_mm = [edge_mm, sole.pitch_mm, edge_mm]
    area_mm2 = np.outer(side_mm, side_mm).ravel()
    carried = (alone.pressure_mpa(loads.normal, loads.force_n) @ area_mm2) / loads.force_n[:, 2]
    return f"""
### The formula

Boussinesq's point force on a half-space, a lattice of bars, and statics; nothing is fitted. On the {len(loads)} loads,
against contact:

{_distance_table(apart)}

By the stress formula alone the sheet would carry {carried.min():.0%} to {carried.max():.0%} of the vertical force: a
half-space goes on where the ball ends. Statics mends that. What stays: it is too stiff, since the cavities lie between
plates of PDMS, which is {sole.rubber.hertz_mpa / sole.pdms.hertz_mpa:.1f} times as soft as the rubber that it takes
them for, and the outer cavities are open at the edge.
"""


def _full_text(
    bench: StudyContext, full: _Climbed, distances: dict[str, Distance]
) -> tuple[str, dict[str, Any]]:
    """Return the part on the full solve, and its numbers."""
    one = mirrored_loads(_FULL_CASES[:1])
    reduced, taken_s = timed(Full(bench.sole, reduced=True), one)
    bench.say(f"fidelity: full without finite strain and floor, in {taken_s:.1f} s")
    first = Answer(full.answers["full"].closure_um[:1], full.answers["full"].capacitance_pf[:1])
    contact = Answer(full.answers["contact"].closure_um[:1], full.answers["contact"].capacitance_pf[:1])
    parts = _distances(bench, {"contact": contact}, reduced)["contact"]
    physics = _distances(bench, {"reduced": reduced}, first)["reduced"]
    cases = "; ".join(f"{normal:g}/{force:g} deg, {size:g} gf" for normal, force, size in _FULL_CASES)
    text = f"""
### Against the full solve

Finite strain and a floor with friction, {full.seconds["full"]:.0f} s a load, so {full.n} loads (elevation of normal and
force, magnitude): {cases}. All lie in a mirror plane, of which the full solve meshes half. Against full:

{_distance_table(distances)}

Part of that is the mesh, which has to be coarser there. At the first load, the full solve with small strain and Hertz's
patch, that is with the physics of contact, leaves {parts.closure_rel:.1%} rms between the closures of the two meshes;
finite strain and the floor, on one mesh, change them by {physics.closure_rel:.1%}. The changes of the nine capacitances
at that load, by all four:

![]({_PATTERN})
"""
    return text, {"mesh_at_first": parts.json(), "physics_at_first": physics.json()}


def _first_changes_pf(bench: StudyContext, climbed: _Climbed) -> dict[str, NDArray[np.float64]]:
    """Return the changes of capacitance at the first load, shape (3, 3), by rung."""
    rest_pf = bench.response.design.rest_pf
    return {name: one.capacitance_pf[0].reshape(3, 3) - rest_pf for name, one in climbed.answers.items()}


def page(bench: StudyContext) -> Page:
    """Return the page."""
    ng.ngsglobals.msg_level = 0
    loads = paper_loads(bench.response)
    cheap = _climb(bench, NAMES[:3], loads)
    forward = _forward(bench, loads)
    finest, seconds = "contact", dict(cheap.seconds)
    apart = _distances(
        bench, {name: cheap.answers[name] for name in ("half-space", "linear")}, cheap.answers["contact"]
    )
    shown, full_text = apart, ""
    values: dict[str, Any] = {}
    if not bench.quick:
        full = _climb(bench, NAMES, mirrored_loads(_FULL_CASES))
        finest, seconds["full"] = "full", full.seconds["full"]
        shown = _distances(bench, {name: full.answers[name] for name in NAMES[:3]}, full.answers["full"])
        full_text, values = _full_text(bench, full, shown)
        values["full_closure_um"] = full.answers["full"].closure_um.tolist()
        values["full_capacitance_pf"] = full.answers["full"].capacitance_pf.tolist()
        values["against_full"] = {name: one.json() for name, one in shown.items()}
    figures = {_FIGURE: error_against_time(seconds, shown, finest, forward, len(loads))}
    if not bench.quick:
        figures[_PATTERN] = pattern_tiles(_first_changes_pf(bench, full))
    formula_text = _half_space_text(bench, loads, cheap.answers["contact"])
    forward_text = _forward_text(forward, len(loads), quick=bench.quick)
    rows = [[name, f"{1e3 * each:.3g} ms", f"{each * len(loads):.3g} s"] for name, each in seconds.items()]
    scaled = "" if bench.quick else f" That of `full` is scaled from {len(_FULL_CASES)} loads."
    body = f"""
{"**Quick run: without the full solve, and one solve per load on a coarse mesh.**" if bench.quick else ""}

Four models answer the same question: what does a contact do to nine gaps? What does each cost, and what does it lose?
Direction and magnitude are differences between the forces that the shipped network reads from both capacitances.

{table(["time", "a load", f"{len(loads)} loads"], rows)}

The loads are the paper's 362 and 180.{scaled} The table that `linear`
and `contact` stand on is made once and not counted.

![]({_FIGURE})

### Against contact

On the {len(loads)} loads:

{_distance_table(apart)}
{full_text}{formula_text}{forward_text}
"""
    return Page(
        name="fidelity",
        title="The ladder of models",
        body=body,
        figures=figures,
        values={
            "quick": bench.quick,
            "n_loads": len(loads),
            "seconds_per_load": seconds,
            "against_contact": {name: one.json() for name, one in apart.items()},
            "forward": {**asdict(forward), "ratio": forward.ratio},
            **values,
        },
    )
