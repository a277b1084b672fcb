"""Study `shipped`: how good the released network is, what its sigma is worth, and what a missing row costs."""

from dataclasses import asdict
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from footsense.estimation.faults.imputation import Imputation
from footsense.lab.evaluation.evaluate import Errors, coverage, errors
from footsense.lab.evaluation.evaluate_models import (
    HELD_OUT_CASES,
    HELD_OUT_SEED,
    as_markdown,
    evaluate_models,
)
from footsense.lab.monte_carlo.campaign import Tolerances
from footsense.lab.studies.page import Page, Workbench, table
from footsense.lab.training.load_cases import Cases, measured_closure_rel, wide
from footsense.lab.training.train import MASKS
from footsense.sim.foot.fabrication import fabricate

Vector = NDArray[np.float64]

#: What is missing, by index into `MASKS`.
MISSING = {
    "nothing": 0,
    "a corner": 1,
    "an edge": 2,
    "the middle": 5,
    "an outer row": 10,
    "the middle row": 11,
}
#: Feet that the network was not made for: what each batch of them is off by, rms.
FEET = {
    "gaps off by 0.5 um": Tolerances(gap_um=0.5),
    "gaps off by 2 um": Tolerances(gap_um=2.0),
    "strays of 0.01 pF": Tolerances(stray_pf=0.01),
    "strays of 0.1 pF": Tolerances(stray_pf=0.1),
    "stiffness off by 1 %": Tolerances(stiffness_rel=0.01),
    "stiffness off by 5 %": Tolerances(stiffness_rel=0.05),
    "mount off by 1 deg": Tolerances(mount_deg=1.0),
}
#: Feet of each batch, loads on each.
N_FEET, N_LOADS, _FEET_SEED = 20, 500, 7
QUICK_FEET = 2
#: Bins of force for the coverage over the loading range [N].
BINS_N = (0.0, 0.05, 0.2, 0.5, 1.0, 2.0)
_FIGURE = "shipped-sigma.png"


def _held_out(bench: Workbench) -> tuple[Cases, Vector]:
    """Return held-out loads and their noisy closures over the gap."""
    n = 2000 if bench.quick else HELD_OUT_CASES
    cases = wide(bench.response, bench.sole.loads, n, HELD_OUT_SEED)
    rng = np.random.default_rng(HELD_OUT_SEED)
    return cases, measured_closure_rel(bench.response.design, cases.closure_um, rng)


def _masked(
    bench: Workbench, cases: Cases, closure_rel: Vector
) -> dict[str, tuple[Errors, dict[str, list[float]]]]:
    """Return errors and coverage for everything that may be missing."""
    imputation = Imputation(np.array(bench.network.card["moments"]))
    felt = np.linalg.norm(cases.force_n, axis=1) >= bench.sole.loads.judged_from_n
    found = {}
    for name, index in MISSING.items():
        missing = np.tile(MASKS[index], (len(closure_rel), 1))
        force_n, sigma_n = bench.network.estimate(imputation.impute(closure_rel, missing), missing)
        found[name] = (
            errors(cases.force_n[felt], force_n[felt]),
            coverage(cases.force_n, force_n, sigma_n),
        )
    return found


def _feet(bench: Workbench, n_feet: int) -> dict[str, dict[str, list[float]]]:
    """Return the coverage over batches of feet that differ from the design."""
    response, loads = bench.response, bench.sole.loads
    n_loads = 100 if bench.quick else N_LOADS
    found = {}
    for name, tolerances in FEET.items():
        parts = []
        for number in range(n_feet):
            own = fabricate(response, tolerances, _FEET_SEED, number)
            cases = wide(response, loads, n_loads, 1000 + number, own)
            rng = np.random.default_rng((number, _FEET_SEED))
            closure_rel = measured_closure_rel(response.design, cases.closure_um, rng)
            parts.append((cases.force_n, *bench.network.estimate(closure_rel)))
        truth, force_n, sigma_n = (np.concatenate(part) for part in zip(*parts, strict=True))
        found[name] = coverage(truth, force_n, sigma_n)
    return found


def _figure(truth: Vector, force_n: Vector, sigma_n: Vector) -> Figure:
    """Return stated sigma against found error, per axis, in bins of equally many cases."""
    figure = Figure(figsize=(8.0, 3.6))
    axes = figure.subplots()
    for axis, name in enumerate("xyz"):
        order = np.array_split(np.argsort(sigma_n[:, axis]), 20)
        stated = [1e3 * np.sqrt(np.mean(sigma_n[part, axis] ** 2)) for part in order]
        error = [1e3 * np.percentile(np.abs((truth - force_n)[part, axis]), 68.3) for part in order]
        axes.loglog(stated, error, "o-", label=f"f{name}")
    low, high = axes.get_xlim()
    axes.loglog([low, high], [low, high], "k:", label="as stated")
    axes.set(xlabel="stated sigma [mN]", ylabel="found error, 68.3 % of cases below [mN]")
    axes.legend()
    axes.grid(visible=True, which="both", alpha=0.3)
    return figure


def _cover_row(cover: dict[str, list[float]]) -> list[str]:
    """Return the two shares per axis as cells."""
    return [" / ".join(f"{100 * value:.0f}" for value in cover[f"within_{k}_sigma"]) for k in (1, 2)]


def page(bench: Workbench) -> Page:
    """Return the page."""
    errors_by_row = evaluate_models(bench.models)
    cases, closure_rel = _held_out(bench)
    bench.say("shipped: held-out loads drawn")
    masked = _masked(bench, cases, closure_rel)
    force_n, sigma_n = bench.network.estimate(closure_rel)
    size = np.linalg.norm(cases.force_n, axis=1)
    bins = {}
    for low, high in pairwise(BINS_N):
        inside = (size >= low) & (size < high)
        bins[f"{low:g} to {high:g}"] = coverage(cases.force_n[inside], force_n[inside], sigma_n[inside])
    n_feet = QUICK_FEET if bench.quick else N_FEET
    feet = _feet(bench, n_feet)
    weights = bench.network.card["training"]["weights"]
    mask_rows = [
        [
            name,
            f"{e.direction_deg:.2f}",
            f"{e.direction_p95_deg:.2f}",
            f"{e.magnitude_gf:.2f}",
            *_cover_row(cover),
        ]
        for name, (e, cover) in masked.items()
    ]
    cover_rows = [[f"design, {name} N", *_cover_row(cover)] for name, cover in bins.items()]
    cover_rows += [[f"feet, {name} rms", *_cover_row(cover)] for name, cover in feet.items()]
    head = ["direction mean [deg]", "p95 [deg]", "magnitude [gf]", "% within 1 sigma, x / y / z", "within 2"]
    quick = "A quick form with few cases.\n\n" if bench.quick else ""
    body = f"""{quick}{weights} weights, symmetric under the square by construction. `paper_*`: the paper's 180
verification cases (100 gf, centred), without noise, gap contact on; `_362`: trained on the paper's 362 cases
alone, fed with unbent closures or with elastance. `wide_*`: held-out random loads from
{bench.sole.loads.judged_from_n:g} N, leaning contacts, the
converter's noise. The paper's figures are those of its simulation (III F).

{as_markdown(errors_by_row)}

What is missing is an input: it is filled in linearly from the rest, said to the network, and the leg is DEGRADED.
Held-out wide loads:

{table(["missing", *head], mask_rows)}

How far sigma holds; 68.3 and 95.4 % would be Gaussian and exact. First the design itself over the loading range, then
held-out feet, {n_feet} a batch, that differ from it: sigma knows the noise and the network, not the foot. The tare
takes off what gaps differ by; strays that nobody subtracts, stiffness and mount are for a calibration to find.

{table(["held-out loads on", "% within 1 sigma, x / y / z", "within 2"], cover_rows)}

![]({_FIGURE})
"""
    values: dict[str, Any] = {
        "errors": {name: asdict(row) for name, row in errors_by_row.items()},
        "weights": weights,
        "missing": {name: {**asdict(e), **cover} for name, (e, cover) in masked.items()},
        "coverage_by_force_n": bins,
        "coverage_on_held_out_feet": feet,
    }
    figures = {_FIGURE: _figure(cases.force_n, force_n, sigma_n)}
    return Page(name="shipped", title="The shipped network", body=body, figures=figures, values=values)
