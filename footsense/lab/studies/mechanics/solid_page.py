"""The page of the study `solid`: its text, and the study itself."""

from footsense.lab.studies.mechanics.solid import (
    COUNTED_REL,
    FIGURE,
    INCLINED_DEG,
    Edged,
    Mesh,
    Results,
    compute,
)
from footsense.lab.studies.page import Study, table


def _mesh_row(mesh: Mesh) -> list[str]:
    """Return a row of the table of meshes."""
    worst = [f"{100.0 * value:.2f}" if value else "-" for value in mesh.worst_rel]
    work = [str(mesh.unknowns), f"{mesh.wall_s:.1f}", f"{mesh.processor_s:.1f}"]
    return [mesh.name, str(mesh.order), *work, f"{mesh.corner_um:.3f}", *worst, *["-"] * (2 - len(worst))]


def _edge_row(one: Edged, rest: Edged) -> list[str]:
    """Return a row of the table of edges."""
    row = [
        f"{one.closed_um:g}",
        f"{one.plates_pf:.4f}",
        f"{one.edged_pf:.4f}",
        f"{100.0 * (one.edged_pf / one.plates_pf - 1.0):.2f}",
    ]
    if one is rest:
        return [*row, "-", "-", "-"]
    change_rel = (one.edged_pf - rest.edged_pf) / (one.plates_pf - rest.plates_pf) - 1.0
    return [*row, f"{100.0 * change_rel:.2f}", f"{one.read_um:.3f}", f"{one.corrected_um:.3f}"]


def render(results: Results) -> str:
    """Return the page's text."""
    released = [mesh.worst_rel for mesh in results.meshes if mesh.name == "SHIPPED"]
    reference = (
        "The upright load is compared with FINEST, the inclined one with `finer`. SHIPPED is off by at most "
        f"{100.0 * released[0][0]:.2f} % and {100.0 * released[0][1]:.2f} % on an element above "
        f"{100.0 * COUNTED_REL:g} % of the largest; the target is 1 %."
        if released
        else "Quick form: two coarse meshes, the second is the reference of the first."
    )
    header = ["mesh", "order", "unknowns", "wall [s]", "processor [s]", "corner, upright [um]"]
    steps = (
        ("complete response, SHIPPED", results.response, 60),
        (f"{results.n_cases} cases with contact", results.cases, 30),
    )
    step_rows = [
        [name, f"{taken.wall_s:.1f}", f"{taken.processor_s:.1f}", f"{target_s}"]
        if taken
        else [name, "not in the quick form", "-", f"{target_s}"]
        for name, taken, target_s in steps
    ]
    floor_rows = [
        [name, f"{one.modulus_mpa:.5f}", f"{one.radius_mm:.5f}", f"{one.corner_um:.6f}"]
        for name, one in results.floors.items()
    ]
    rest, at_5, *_ = results.edges
    edge_header = ["closed by [um]", "plates [pF]", "with edges [pF]", "C off by [%]", "change off by [%]"]
    edge_header += ["read as [um]", "read with the stray taken off [um]"]
    own_rows = [[name, f"{100.0 * value:.3f}"] for name, value in results.table_rel.items()]
    return f"""
### Mesh

Closures under centred loads of 1 N, free gaps. {reference}

{table([*header, "upright, worst [%]", f"{INCLINED_DEG:g} deg, worst [%]"], map(_mesh_row, results.meshes))}

![]({FIGURE})

### From nothing to the table, and cases with contact

{table(["step", "wall [s]", "processor [s]", "target on two cores [s]"], step_rows)}

### A rigid floor in place of cement

{table(["floor", "E* [MPa]", "patch radius [mm]", "corner [um]"], floor_rows)}

Closures change by at most {100.0 * results.floor_rel:.1e} %.

### The spacer of {1000.0 * results.spacer_mm:g} um as a law

In a cross-section in plane strain, one pitch wide, a cavity under uniform pressure closes by {results.law_um:.4f} um
with the spacer as a law and by {results.solid_um:.4f} um with the spacer meshed as PDMS that may bulge:
{100.0 * (results.law_um / results.solid_um - 1.0):+.3f} %.

### Electrodes have edges

{table(edge_header, [_edge_row(one, rest) for one in results.edges])}

The edges add {rest.edged_pf - rest.plates_pf:.3f} pF that hardly change. Left in, they make {at_5.closed_um:g} um read
as {at_5.read_um:.2f} um; taken off as a stray, {at_5.corrected_um:.2f} um. So the stray of a calibration has to contain
the edges. The simulator's elements have none.

### Errors that the table states

{table(["error, rms over rms unless said", "[%]"], own_rows)}

Inside a cell the closure varies by at most {results.cell_um:.2f} um rms.
"""


STUDY = Study(name="solid", title="How exact the solid is", results=Results, compute=compute, render=render)
