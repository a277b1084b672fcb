"""Study `error-causes`: contributions of error causes to the paper's measured error, with the paper's own procedure.

The paper trained a plain network on changes of capacitance of the very foot that it then tested (section V C): 362
presses, 180 test loads. Fabrication and test stand are chosen so that this procedure errs on simulated feet as it did
on the paper's, and the share of each cause is shown: alone, and as what remains without it.

Source:
    Aoyagi et al., section V C; tables I and II.
"""

from dataclasses import asdict, dataclass, replace

import numpy as np
from joblib import Parallel, delayed

from footsense.foot.force_errors import evaluate_force_errors
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Foot
from footsense.lab.evaluation import evaluate
from footsense.lab.former_page import Plots, Study, StudyContext
from footsense.lab.monte_carlo.resumable_run import Tolerances
from footsense.lab.monte_carlo.specimens import measure_foot
from footsense.lab.monte_carlo.statistics import MeanStd
from footsense.lab.monte_carlo.sweeps import NO_DEVIATIONS, PAPER_LIKE_TOLERANCES, SEED
from footsense.lab.training.load_cases import paper_training, paper_verification
from footsense.lab.training.paper.per_foot_network import per_foot_force_n
from footsense.lab.training.paper.procedure import EPOCHS, QUICK_EPOCHS
from footsense.sim.fabrication import draw_deviations

#: Feet of a full run and of a quick one; processes.
N_FEET, QUICK_N_FEET, _PROCESSES = 20, 2, 2
#: The causes by the names of the tolerances, in words with a unit, and the factor to that unit.
ERROR_CAUSES = {
    "gap_um": ("gap of each element [um]", 1.0),
    "film_um": ("film of each element [um]", 1.0),
    "stray_pf": ("stray of each element [pF]", 1.0),
    "stiffness_rel": ("stiffness of the foot [%]", 100.0),
    "mount_deg": ("mount [deg]", 1.0),
    "reading_noise_pf": ("reading [fF]", 1e3),
    "repeatability_rel": ("creep while nine elements are read one by one [% of ΔC]", 100.0),
    "reference_error_resolutions": ("reference, read once [resolutions of 4, 4, 12 gf]", 1.0),
    "press_lean_deg": ("stick set by hand [deg]", 1.0),
}
#: Names of the rows that are no cause.
NONE, ALL = "none", "all"


@dataclass(frozen=True, kw_only=True)
class CauseErrors:
    """Force errors over all feet with one set of error causes.

    Attributes:
        direction_error_deg: Mean angle [deg].
        magnitude_error_gf: Mean magnitude error [gf].
    """

    direction_error_deg: MeanStd
    magnitude_error_gf: MeanStd


@dataclass(frozen=True, kw_only=True)
class ErrorCausesResults:
    """Results of the study `error-causes`: force errors with each cause alone, and with each cause left out.

    Attributes:
        n_feet: Feet of each row.
        alone: By cause: errors with that cause alone; also `none` and `all`.
        without: By cause: errors with all others.
    """

    n_feet: int
    alone: dict[str, CauseErrors]
    without: dict[str, CauseErrors]


def foot_trained_network_errors(
    response: FootResponse, tolerances: Tolerances, number: int, epochs: int
) -> tuple[float, float]:
    """Return direction [deg] and magnitude error [gf] of a plain network trained on one foot's loads.

    Args:
        response: Response of the type.
        tolerances: Of foot and test stand.
        number: Number of the foot.
        epochs: Training epochs.
    """
    own = draw_deviations(response, tolerances, SEED, number)
    foot, rng = Foot(response, own), np.random.default_rng((SEED, number, 1))
    training, test = (
        measure_foot(foot, own.mount, cases(response).force_n, tolerances, rng)
        for cases in (paper_training, paper_verification)
    )
    estimate_n = per_foot_force_n(
        response.design, training.change_pf, training.reference_force_n, test.change_pf, epochs
    )
    row = evaluate_force_errors(test.reference_force_n, estimate_n)
    return row.direction_deg, row.magnitude_gf


def compute(context: StudyContext) -> tuple[ErrorCausesResults, Plots]:
    """Return the errors of a network per foot and per set of causes."""
    n_feet, epochs = (QUICK_N_FEET, QUICK_EPOCHS) if context.quick else (N_FEET, EPOCHS)
    exact, whole = asdict(NO_DEVIATIONS), asdict(PAPER_LIKE_TOLERANCES)
    alone = {NONE: NO_DEVIATIONS, ALL: PAPER_LIKE_TOLERANCES} | {
        name: replace(NO_DEVIATIONS, **{name: whole[name]}) for name in ERROR_CAUSES
    }
    without = {name: replace(PAPER_LIKE_TOLERANCES, **{name: exact[name]}) for name in ERROR_CAUSES}
    sets = [*alone.values(), *without.values()]
    run = Parallel(n_jobs=1 if context.quick else _PROCESSES)
    found: list[tuple[float, float]] = run(
        delayed(foot_trained_network_errors)(context.response, one, number, epochs)
        for one in sets
        for number in range(n_feet)
    )

    def row(number: int) -> CauseErrors:
        """Return the errors for the set of causes with this number."""
        feet = found[number * n_feet : (number + 1) * n_feet]
        directions, magnitudes = zip(*feet, strict=True)
        return CauseErrors(
            direction_error_deg=MeanStd.of_values(directions),
            magnitude_error_gf=MeanStd.of_values(magnitudes),
        )

    rows = [row(number) for number in range(len(sets))]
    results = ErrorCausesResults(
        n_feet=n_feet,
        alone=dict(zip(alone, rows, strict=False)),
        without=dict(zip(without, rows[len(alone) :], strict=True)),
    )
    reached = results.alone[ALL]
    context.report_progress(
        f"error-causes: {reached.direction_error_deg} deg, {reached.magnitude_error_gf} gf; the paper "
        f"{evaluate.MEASURED_DIRECTION_DEG} deg, {evaluate.MEASURED_MAGNITUDE_GF} gf"
    )
    return results, {}


STUDY = Study(
    name="error-causes",
    title="The causes of the paper's error: its procedure on simulated feet",
    compute=compute,
    template_names={"PAPER_LIKE_TOLERANCES": PAPER_LIKE_TOLERANCES},
    uses_network=False,
)
