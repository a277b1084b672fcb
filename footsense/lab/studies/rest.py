"""Page `rest`: the released network on loads that stand still, beside the least error that nine readings allow."""

from dataclasses import asdict
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from footsense.estimation.network import READINGS, steady_windows
from footsense.estimation.rest import ROUNDS, RefinedAtRest
from footsense.foot.directions import paper_directions, random_directions
from footsense.foot.force_errors import evaluate_force_errors
from footsense.foot.network_card import NETWORK_FILE
from footsense.foot.specimen import Specimen
from footsense.foot.type_folders import released_names
from footsense.frames import Vector
from footsense.lab.evaluation.cramer_rao import errors_over_bound
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
from footsense.lab.report import StudyContext, Values
from footsense.lab.training.load_cases import (
    BASELINE_NOISE_PF,
    NOISE_PF,
    leaning_normals,
    measured_closure_rel,
    paper_verification,
    random_loads,
)
from footsense.ports import LoadEstimate, Window

TITLE = "The released network at rest"

_LEANING, _CENTRED = "leaning, held out", "the paper's 180, without noise"
#: Leaning loads refined at rest, and legs of a call.
_N_REFINED, _N_LEGS = 5000, 50
_FORCE_BINS_N = (0.0, 0.05, 0.2, 0.5, 1.0, 2.0)
_MAGNITUDES_GF = (20.0, 35.0, 50.0, 75.0, 100.0, 125.0, 150.0)
_N_LEANING = 1000
#: Files of a foot that its errors depend on.
_FILES = (FOOT_FILE, RESPONSE_FILE, NETWORK_FILE)


def compute(context: StudyContext) -> Values:
    """Evaluate the network on the paper's and on held-out loads, refined at rest, and beside the bound."""
    network, loads, quick = context.network, context.foot_design.loads, context.quick
    cases = random_loads(context.response, loads, 2000 if quick else HELD_OUT_CASES, HELD_OUT_SEED)
    rng = np.random.default_rng(HELD_OUT_SEED)
    closure_rel = measured_closure_rel(context.response.design, cases.closure_um, rng)
    size = np.linalg.norm(cases.force_n, axis=1)
    force_n, sigma_n = network.estimate(steady_windows(closure_rel))[:2]
    by_force = {
        f"{low:g} to {high:g} N": sigma_coverage_shares(
            *(values[(size >= low) & (size < high)] for values in (cases.force_n, force_n, sigma_n))
        )
        for low, high in pairwise(_FORCE_BINS_N)
    }
    context.report_progress("held-out loads done")
    errors = {name: evaluate_models(foot.files(*_FILES)) for name, foot in _feet(context).items()}
    return {
        "noise_ff": 1e3 * NOISE_PF,
        "baseline_noise_ff": 1e3 * BASELINE_NOISE_PF,
        "weights": network.card["training"]["weights"],
        "min_evaluated_force_n": loads.min_evaluated_force_n,
        "error_tables": {foot: as_markdown(of_foot) for foot, of_foot in errors.items()},
        "paper_network": asdict(next(iter(errors.values()))["paper_network"]),
        "by_force": by_force,
        "bound": _bounds(context),
        "refined": _refined_errors(context),
    }


def shown(values: Values) -> Values:
    """Return the worst error over the bound, of centred loads."""
    return {"over_bound": max(row["over_bound"] for row in values["bound"]["centred"])}


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


def _refined_errors(context: StudyContext) -> Values:
    """Return the errors of the network alone and refined at rest, by loads."""
    response, loads, rng = context.response, context.foot_design.loads, np.random.default_rng(HELD_OUT_SEED)
    leaning = random_loads(response, loads, _N_REFINED // (10 if context.quick else 1), HELD_OUT_SEED)
    counted = np.linalg.norm(leaning.force_n, axis=1) >= loads.min_evaluated_force_n
    read = [measured_closure_rel(response.design, leaning.closure_um[counted], rng) for _ in range(READINGS)]
    centred = paper_verification(response, force_unit=loads.force_unit)
    exact_rel = centred.closure_um / response.design.gap_um
    sets = {
        _LEANING: (leaning.force_n[counted], np.stack(read, axis=1)),
        _CENTRED: (centred.force_n, np.repeat(exact_rel[:, None], READINGS, axis=1)),
    }
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
