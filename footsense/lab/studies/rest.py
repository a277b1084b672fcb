"""Page `rest`: the released network on loads that stand still, beside the least error that nine readings allow."""

from dataclasses import asdict
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from footsense.estimation.missing_elements import MISSING_SETS, Imputation
from footsense.estimation.network import READINGS, steady_windows
from footsense.estimation.rest import ROUNDS, RefinedAtRest
from footsense.foot.directions import paper_directions, random_directions
from footsense.foot.force_errors import evaluate_force_errors
from footsense.foot.network_card import NETWORK_FILE
from footsense.foot.specimen import Specimen
from footsense.foot.type_folders import released_names
from footsense.frames import Vector
from footsense.lab.evaluation.cramer_rao import (
    ambiguous_load_distance_and_angle,
    errors_over_bound,
)
from footsense.lab.evaluation.evaluate_models import (
    HELD_OUT_CASES,
    HELD_OUT_SEED,
    RESPONSE_FILE,
    as_markdown,
    evaluate_models,
    sigma_coverage_shares,
)
from footsense.lab.foot_file import FOOT_FILE
from footsense.lab.geometry import LoadRange
from footsense.lab.report import SAME_TABLE, StudyContext, Values, table, target
from footsense.lab.training.load_cases import (
    BASELINE_NOISE_PF,
    NOISE_PF,
    leaning_normals,
    measured_closure_rel,
    paper_verification,
    random_loads,
)
from footsense.ports import LoadEstimate, Window
from footsense.sim.fabrication import PAPER_TOLERANCES, FootTolerances, draw_deviations

TITLE = "The released network at rest"

#: Missing elements, as an index into `MISSING_SETS`.
_MISSING = {
    "nothing": 0,
    "a corner": 1,
    "an edge": 2,
    "the middle": 5,
    "an outer row": 10,
    "the middle row": 11,
}
#: Feet other than the designed one: standard deviations of each batch.
_BATCHES = {
    "gaps off by 0.5 um": FootTolerances(gap_um=0.5),
    "gaps off by 2 um": FootTolerances(gap_um=2.0),
    "strays of 0.01 pF": FootTolerances(stray_pf=0.01),
    "strays of 0.1 pF": FootTolerances(stray_pf=0.1),
    "stiffness off by 1 %": FootTolerances(stiffness_rel=0.01),
    "stiffness off by 5 %": FootTolerances(stiffness_rel=0.05),
    "mount off by 1 deg": FootTolerances(mount_deg=1.0),
}
_N_FEET, _N_LOADS = 20, 500
#: Loads refined at rest: of the designed foot, and of each made one; legs of a call.
_N_REFINED, _N_REFINED_OF_FOOT, _N_LEGS = 5000, 100, 50
#: Targets at rest: leaning loads, mean and 95 % below; the paper's loads without noise, mean and worst [deg].
_LEANING_DEG, _PAPER_DEG = (0.1, 0.3), (0.02, 0.1)
#: Made feet, and their deviations over those tuned to the paper's error [1].
_MADE = {
    "made feet, not calibrated": 1.0,
    "made feet, a tenth of the deviations": 0.1,
    "made feet, a thirtieth": 1.0 / 30.0,
}
_FORCE_BINS_N = (0.0, 0.05, 0.2, 0.5, 1.0, 2.0)
_MAGNITUDES_GF = (20.0, 35.0, 50.0, 75.0, 100.0, 125.0, 150.0)
_N_LEANING = 1000
#: Files of a foot that its errors depend on.
_FILES = (FOOT_FILE, RESPONSE_FILE, NETWORK_FILE)
#: The project's target of the network's error over the bound [1].
_TARGET_OVER_BOUND = 1.2
#: Elevations of the centred loads whose ambiguous partner is sought [deg].
_AMBIGUITY_ELEVATIONS_DEG = np.arange(40.0, 49.01, 0.5)


def compute(context: StudyContext) -> Values:
    """Evaluate the network on the paper's and on held-out loads, with missing elements, and on other feet."""
    network, loads, quick = context.network, context.foot_design.loads, context.quick
    cases = random_loads(context.response, loads, 2000 if quick else HELD_OUT_CASES, HELD_OUT_SEED)
    rng = np.random.default_rng(HELD_OUT_SEED)
    closure_rel = measured_closure_rel(context.response.design, cases.closure_um, rng)
    size = np.linalg.norm(cases.force_n, axis=1)
    counted = size >= loads.min_evaluated_force_n
    imputation = Imputation(np.array(network.card["moments"]))
    missing = []
    for name, index in _MISSING.items():
        mask = np.tile(MISSING_SETS[index], (len(closure_rel), 1))
        force_n, sigma_n = network.estimate(steady_windows(imputation.impute(closure_rel, mask), mask))[:2]
        off = evaluate_force_errors(cases.force_n[counted], force_n[counted])
        missing.append(
            {
                "missing": name,
                "direction_deg": off.direction_deg,
                "direction_p95_deg": off.direction_p95_deg,
                "magnitude_gf": off.magnitude_gf,
                **sigma_coverage_shares(cases.force_n, force_n, sigma_n),
            }
        )
    force_n, sigma_n = network.estimate(steady_windows(closure_rel))[:2]
    by_force = {
        f"{low:g} to {high:g} N": sigma_coverage_shares(
            *(values[(size >= low) & (size < high)] for values in (cases.force_n, force_n, sigma_n))
        )
        for low, high in pairwise(_FORCE_BINS_N)
    }
    context.report_progress("held-out loads done")
    n_feet = 2 if quick else _N_FEET
    errors = {name: evaluate_models(foot.files(*_FILES)) for name, foot in _feet(context).items()}
    paper = next(iter(errors.values()))["paper_network"]
    bound = _bounds(context)
    refined = _refined_errors(context, n_feet)
    leaning, centred = (
        refined["leaning, held out"]["refined"],
        refined["the paper's 180, without noise"]["refined"],
    )
    worst = max(row["over_bound"] for row in bound["centred"])
    return {
        "weights": network.card["training"]["weights"],
        "min_evaluated_force_n": loads.min_evaluated_force_n,
        "errors": {
            foot: {name: asdict(row) for name, row in of_foot.items()} for foot, of_foot in errors.items()
        },
        "error_tables": {foot: as_markdown(of_foot) for foot, of_foot in errors.items()},
        "missing": missing,
        "n_feet": n_feet,
        "by_force": by_force,
        "by_batch": {name: _coverage_of_feet(context, batch, n_feet) for name, batch in _BATCHES.items()},
        "bound": bound,
        "ambiguity": _ambiguity(context),
        "refined": refined,
        "targets": [
            target(
                "leaning loads at rest, direction, mean / 95 % below",
                f"{_LEANING_DEG[0]:g} / {_LEANING_DEG[1]:g} deg",
                f"{leaning['direction_deg']:.3f} / {leaning['direction_p95_deg']:.2f} deg",
                met=leaning["direction_deg"] <= _LEANING_DEG[0]
                and leaning["direction_p95_deg"] <= _LEANING_DEG[1],
            ),
            target(
                "the paper's 180 loads without noise, at rest, direction, mean / worst",
                f"{_PAPER_DEG[0]:g} / {_PAPER_DEG[1]:g} deg",
                f"{centred['direction_deg']:.3f} / {centred['direction_max_deg']:.2f} deg",
                met=centred["direction_deg"] <= _PAPER_DEG[0]
                and centred["direction_max_deg"] <= _PAPER_DEG[1],
            ),
            target(
                "released network, the paper's 180 loads without noise, mean (one network)",
                "2.4 deg, 5.3 gf (the paper, simulated)",
                f"{paper.direction_deg:.2f} deg, {paper.magnitude_gf:.2f} gf; "
                f"worst load {paper.direction_max_deg:.1f} deg, {paper.magnitude_max_gf:.1f} gf",
                met=paper.direction_deg <= 2.4 and paper.magnitude_gf <= 5.3,
            ),
            target(
                "direction error at rest over the Cramer-Rao bound, rms, worst magnitude",
                f"{_TARGET_OVER_BOUND:g}",
                f"{worst:.0f}",
                met=worst <= _TARGET_OVER_BOUND,
            ),
        ],
    }


def _feet(context: StudyContext) -> dict[str, StudyContext]:
    """Return the studied foot and the other released ones."""
    studied = context.foot_design.foot_type
    return {studied: context} | {name: context.foot(name) for name in released_names() if name != studied}


class _Known(NamedTuple):
    """Estimator whose answer to one window is known."""

    load: LoadEstimate

    def estimate(self, window: Window) -> LoadEstimate:  # noqa: ARG002 - of a port
        """Return it."""
        return self.load


def _refined(context: StudyContext, window: Window, load: LoadEstimate) -> LoadEstimate:
    """Return the network's loads refined as the service does while the legs stand still."""
    parts = []
    for first in range(0, len(window.missing), _N_LEGS):
        legs = slice(first, first + _N_LEGS)
        known = _Known(LoadEstimate(*(part[legs] for part in load)))
        readings = Window(window.closure_rel[legs], window.age_s[legs], window.missing[legs])
        n_legs = len(readings.missing)
        estimator = RefinedAtRest(known, context.response, context.trained_inputs, n_legs)
        for _ in range(ROUNDS * n_legs):
            refined = estimator.estimate(readings)
        parts.append(refined)
    return LoadEstimate(*map(np.concatenate, zip(*parts, strict=True)))


def _refined_errors(context: StudyContext, n_feet: int) -> Values:
    """Return the errors of the network alone and refined at rest, by loads."""
    response, loads, rng = context.response, context.foot_design.loads, np.random.default_rng(HELD_OUT_SEED)
    noisy = {
        "leaning, held out": [
            random_loads(response, loads, _N_REFINED // (10 if context.quick else 1), HELD_OUT_SEED)
        ]
    }
    for name, share in _MADE.items():
        levels = FootTolerances(**{key: share * level for key, level in asdict(PAPER_TOLERANCES).items()})
        feet = [draw_deviations(response, levels, 0, foot) for foot in range(n_feet)]
        noisy[name] = [
            random_loads(response, loads, _N_REFINED_OF_FOOT, 2000 + number, foot)
            for number, foot in enumerate(feet)
        ]
    sets = {}
    for name, cases in noisy.items():
        force_n, closure_um = (
            np.concatenate([getattr(one, part) for one in cases]) for part in ("force_n", "closure_um")
        )
        counted = np.linalg.norm(force_n, axis=1) >= loads.min_evaluated_force_n
        read = [measured_closure_rel(response.design, closure_um[counted], rng) for _ in range(READINGS)]
        sets[name] = force_n[counted], np.stack(read, axis=1)
    centred = paper_verification(response, force_unit=loads.force_unit)
    exact_rel = centred.closure_um / response.design.gap_um
    sets["the paper's 180, without noise"] = centred.force_n, np.repeat(exact_rel[:, None], READINGS, axis=1)
    errors: Values = {}
    for name, (force_n, read_rel) in sets.items():
        window = steady_windows(read_rel[:, 0])._replace(closure_rel=read_rel)
        load = context.network.estimate(window)
        refined = _refined(context, window, load)
        row: Values = {"share": float((refined.force_n != load.force_n).any(axis=1).mean())}
        for kind, one in (("network", load), ("refined", refined)):
            within = np.mean(sigma_coverage_shares(force_n, one.force_n, one.sigma_n)["within_2_sigma"])
            row[kind] = asdict(evaluate_force_errors(force_n, one.force_n)) | {"within_2": float(within)}
        errors[name] = row
    context.report_progress("loads at rest refined")
    return errors


def _coverage_of_feet(context: StudyContext, batch: FootTolerances, n_feet: int) -> Values:
    """Return the sigma coverage over random feet, and that of the foot with the least within two sigma."""
    response, design = context.response, context.response.design
    feet = []
    for foot in range(n_feet):
        deviations = draw_deviations(response, batch, 0, foot)
        cases = random_loads(response, context.foot_design.loads, _N_LOADS, 1000 + foot, deviations)
        closure_rel = measured_closure_rel(design, cases.closure_um, np.random.default_rng((foot, 0)))
        feet.append((cases.force_n, *context.network.estimate(steady_windows(closure_rel))[:2]))
    least = min(np.mean(sigma_coverage_shares(*foot)["within_2_sigma"]) for foot in feet)
    pooled = (np.concatenate(part) for part in zip(*feet, strict=True))
    return {**sigma_coverage_shares(*pooled), "least_within_2": float(least)}


def _leaning_contacts(loads: LoadRange, rng: np.random.Generator, n: int) -> tuple[Vector, Vector]:
    """Return contact normals and force directions, drawn as for the training, shapes (m, 3), m <= n."""
    direction = random_directions(rng, n, loads.min_elevation_deg)
    normal = leaning_normals(loads, rng, direction)
    reached = normal[:, 2] >= np.sin(np.radians(loads.min_elevation_deg))
    return normal[reached], direction[reached]


def _bounds(context: StudyContext) -> Values:
    """Return the network's errors under noise beside the bound, by magnitude, for centred and leaning loads."""
    rng, magnitudes_gf = np.random.default_rng(1), _MAGNITUDES_GF[:: 3 if context.quick else 1]
    straight, foot = paper_directions("verification"), Specimen(context.response)
    loads = {
        "centred": (straight, straight),
        "leaning": _leaning_contacts(context.foot_design.loads, rng, _N_LEANING),
    }
    return {
        name: [
            errors_over_bound(foot, context.network.force_n, contacts, gf, 8 if context.quick else 64, rng)
            for gf in magnitudes_gf
        ]
        for name, contacts in loads.items()
    }


def _ambiguity(context: StudyContext) -> list[Values]:
    """Return for some magnitudes the centred load near a diagonal whose readings are most like another load's."""
    foot, rows = Specimen(context.response), []
    for magnitude_gf in (20.0, 50.0, 100.0, 150.0)[: 1 if context.quick else None]:
        distance, apart_deg = ambiguous_load_distance_and_angle(foot, magnitude_gf, _AMBIGUITY_ELEVATIONS_DEG)
        nearest = int(np.argmin(distance))
        rows.append(
            {
                "magnitude_gf": magnitude_gf,
                "distance_sigmas": distance[nearest],
                "elevation_deg": _AMBIGUITY_ELEVATIONS_DEG[nearest],
                "force_apart_deg": apart_deg[nearest],
            }
        )
    return rows


_WITHIN_HEADING = "within 1 sigma, x / y / z | within 2"
_WITHIN = (
    "{within_1_sigma[0]:.0%} / {within_1_sigma[1]:.0%} / {within_1_sigma[2]:.0%}"
    " | {within_2_sigma[0]:.0%} / {within_2_sigma[1]:.0%} / {within_2_sigma[2]:.0%}"
)


def text(values: Values) -> str:
    """Return the page's Markdown."""
    both = [row for rows in values["bound"].values() for row in rows]
    missing = table(
        f"missing, {SAME_TABLE} | direction mean [deg] | 95 % below [deg] | magnitude [gf] | {_WITHIN_HEADING}",
        values["missing"],
        "{missing} | {direction_deg:.2f} | {direction_p95_deg:.2f} | {magnitude_gf:.2f} | " + _WITHIN,
    )
    by_force = table(
        f"held-out loads, {SAME_TABLE} | {_WITHIN_HEADING}", values["by_force"], "{name} | " + _WITHIN
    )
    by_batch = table(
        f"{values['n_feet']} feet with, {SAME_TABLE} | {_WITHIN_HEADING} | within 2, worst foot",
        values["by_batch"],
        "{name} | " + _WITHIN + " | {least_within_2:.0%}",
    )
    bounds = table(
        f"loads, {SAME_TABLE} | force [gf] | number (beyond range) | direction rms [deg] | without noise | bound | over bound | typical"
        " | magnitude rms [gf] | bound",
        [{"loads": loads} | row for loads, rows in values["bound"].items() for row in rows],
        "{loads} | {magnitude_gf:g} | {n} ({n_beyond_range}) | {direction_rms_deg:.2f} | {noiseless_direction_rms_deg:.2f}"
        " | {bound_deg:.3f} | {over_bound:.1f} | {median_over_bound:.1f} | {magnitude_rms_gf:.2f} | {bound_gf:.3f}",
    )
    ambiguity = table(
        "force [gf] | nearest other load [sigma] | at elevation [deg] | its force aside by [deg]",
        values["ambiguity"],
        "{magnitude_gf:g} | {distance_sigmas:.1f} | {elevation_deg:g} | {force_apart_deg:.0f}",
    )
    rest = table(
        f"loads, {SAME_TABLE} | force | direction mean [deg] | 95 % below | worst | magnitude [gf] | within 2 sigma",
        [
            {"name": name, "kind": kind if kind == "network" else f"refined, {row['share']:.0%} of the loads"}
            | row[kind]
            for name, row in values["refined"].items()
            for kind in ("network", "refined")
        ],
        "{name} | {kind} | {direction_deg:.3f} | {direction_p95_deg:.3f} | {direction_max_deg:.2f} | {magnitude_gf:.3f}"
        " | {within_2:.1%}",
    )
    tables = "\n\n".join(
        f"### {foot}\n\n{error_table.strip()}" for foot, error_table in values["error_tables"].items()
    )
    return f"""
One released network of {values["weights"]} weights, symmetric under the square by construction. Training, held-out loads and this
page use one response table, with vented cavities: what a made foot adds is on the page [experiment](experiment.md).

## Errors

`paper_*`: the paper's 180 verification loads (100 gf, centred), without noise. `random_*`: held-out random loads from
{values["min_evaluated_force_n"]:g} N up, leaning contacts, the converter's noise; loads beyond the converter's range are drawn again, so
they are not in these figures. The paper's figures are those of its simulation (section III F).

{tables}

## Refined at rest

While a foot stands still, the service fits its load to the readings on the response table, from the network's answer on
(ADR 0029). Three readings of each element with noise, leaning loads; {values["n_feet"]} made feet a row, with the deviations of the
page [experiment](experiment.md) or a share of them, and without a calibration. Where the table does not explain the
readings, the network's answer stays. Rubber that creeps is on no row.

{rest}

The other tables are of the network alone.

## Missing elements

The closure of a missing element is imputed linearly from the others, the network receives the mask, and the leg says
`Degraded`. Held-out random loads:

{missing}

## Sigma

68.3 and 95.4 % would be Gaussian and exact. First the design over the loading range, then {values["n_feet"]} held-out feet a row that
differ from it by random deviations of this standard deviation: sigma contains the noise and the network's error, not
the foot's deviations. A tare removes differences of the gaps; strays, stiffness and mount need a calibration.

{by_force}

{by_batch}

## The Cramer-Rao bound

The least error of any unbiased estimate from nine readings: {1e3 * NOISE_PF:g} fF rms of white noise on each capacitance and
{1e3 * BASELINE_NOISE_PF:g} fF on its baseline. The contact is unknown (force and two angles of the normal), so five unknowns. Centred are
the paper's 180 directions; leaning loads are drawn as in the training. *Typical* is the median over the loads of the
ratio load by load, which leaves a few bad directions out. The project's target of {_TARGET_OVER_BOUND:g} is met at {sum(row["over_bound"] <= _TARGET_OVER_BOUND for row in both)} of {len(both)} magnitudes.

{bounds}

The network's own error, not noise, makes most of it: see the column without noise. Twelve rounds of
Gauss-Newton on the response table, started at the network's estimate, reached 0.97 to 1.02 times the bound in 99 % of
the scans of six of these rows (measured once, by this page of commit d4c1e1a7; readings and fit used one table).

## Where one scan is ambiguous

Near the diagonals a quite different load, its force far aside and its contact leaning a little, closes all nine gaps
nearly alike. At a distance of 4 standard deviations of the noise one is mistaken for the other in 2 % of the scans even
by the best estimate, at 1 in 31 %.

{ambiguity}
"""
