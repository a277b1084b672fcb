"""Computing time and accuracy of one direct solve per load, compared with the table of adjoint solutions."""

import functools
import timeit
from dataclasses import dataclass
from timeit import default_timer

import numpy as np

from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import ContactLoads
from footsense.lab.evaluation.evaluate import rms
from footsense.lab.fem.forward import DirectSolveFoot
from footsense.lab.fem.mesh import MeshSize
from footsense.lab.geometry import FootDesign


@dataclass(frozen=True, slots=True)
class ForwardAgainstTable:
    """Times and differences of one solve per load against the table of adjoint solves.

    Attributes:
        mesh_and_factorise_s: Mesh and three factorisations, which both need [s].
        forward_solve_s_per_load: One load by four solves [s].
        adjoint_solve_s: One adjoint solve, of which a table takes one per cell of the quarter and class [s].
        table_s_per_load: One load by the table, many at once [s].
        closure_difference_rms_rel: Difference of the closures of cells, rms over rms [1].
        closure_difference_max_um: The largest difference of an element's closure [um].
        n: Loads that were solved.
    """

    mesh_and_factorise_s: float
    forward_solve_s_per_load: float
    adjoint_solve_s: float
    table_s_per_load: float
    closure_difference_rms_rel: float
    closure_difference_max_um: float
    n: int

    @property
    def forward_over_table_time(self) -> float:
        """Time of one solve over the time of one table look-up [1]."""
        return self.forward_solve_s_per_load / self.table_s_per_load


def forward_against_table(
    foot_design: FootDesign, size: MeshSize, response: FootResponse, loads: ContactLoads, n: int
) -> ForwardAgainstTable:
    """Return times of direct solves and of the adjoint table, and the difference of their closures.

    Args:
        foot_design: The foot.
        size: Resolution of the mesh of the solves.
        response: The table.
        loads: ContactLoads on which the table is timed.
        n: How many of them, evenly spread, are solved.
    """
    start = default_timer()
    foot = DirectSolveFoot(foot_design, size)
    factorise_s = default_timer() - start
    once = functools.partial(response.free_closure_um, loads.normal, loads.force_n)
    tabled, table_s = once(), min(timeit.repeat(once, repeat=3, number=1)) / len(loads.force_n)
    some = np.linspace(0, len(loads.force_n) - 1, n).round().astype(int)
    functionals = [quarter.closure_functional("cell0", 1.0) for quarter in foot.quarter_per_class]
    start = default_timer()
    for quarter, functional in zip(foot.quarter_per_class, functionals, strict=True):
        quarter.solve(functional)
    adjoint_s = (default_timer() - start) / len(functionals)
    start = default_timer()
    solved = np.stack([foot.cell_closures_um(loads.normal[load], loads.force_n[load]) for load in some])
    forward_s = (default_timer() - start) / n
    difference = solved - tabled[some]
    by_element = difference.reshape(n, 9, -1).mean(axis=-1)
    return ForwardAgainstTable(
        mesh_and_factorise_s=factorise_s,
        forward_solve_s_per_load=forward_s,
        adjoint_solve_s=adjoint_s,
        table_s_per_load=table_s,
        closure_difference_rms_rel=rms(difference) / rms(tabled[some]),
        closure_difference_max_um=float(np.abs(by_element).max()),
        n=n,
    )
