"""Reference estimators, and the error table of a foot type on the paper's cases and on random loads."""

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from footsense.errors import ModelError
from footsense.foot.capacitor import Capacitor
from footsense.foot.force_errors import ForceErrors, evaluate_force_errors
from footsense.foot.network_card import NETWORK_FILE
from footsense.foot.response_table import FootResponse
from footsense.frames import Vector
from footsense.lab.foot_file import FOOT_FILE, load_foot
from footsense.lab.geometry import FootDesign, LoadRange
from footsense.lab.response import film_provenance
from footsense.lab.training.export import OnnxNetwork
from footsense.lab.training.load_cases import (
    Cases,
    measured_closure_rel,
    paper_training,
    paper_verification,
    random_loads,
)

#: The paper's errors on its verification cases: section III F (simulation) [deg, gf].
PAPER_DIRECTION_DEG, PAPER_MAGNITUDE_GF = 2.4, 5.3
#: The paper's mean errors on its fabricated foot: section V C (experiment) [deg, gf].
MEASURED_DIRECTION_DEG, MEASURED_MAGNITUDE_GF = 15.9, 18.7

#: Makes forces [N], shape (n, 3), of closures [um], shape (n, 9).
ForceEstimator = Callable[[Vector], Vector]


def rms(values: Vector) -> float:
    """Return the root mean square of all values."""
    return float(np.sqrt(np.mean(values**2)))


def _fit_least_squares(features: Vector, force_n: Vector) -> Vector:
    """Return the least-squares matrix from features to forces, without offset."""
    matrix, *_ = np.linalg.lstsq(features, force_n, rcond=None)
    return np.asarray(matrix, dtype=np.float64)


def capacitance_based_force_estimator(design: Capacitor, training: Cases) -> ForceEstimator:
    """Return the least-squares force estimator from capacitance changes, the inputs of the paper's network."""

    def change_pf(closure_um: Vector) -> Vector:
        """Return the capacitance changes [pF] of closures [um]."""
        return design.capacitance_pf(closure_um) - design.unloaded_pf

    matrix = _fit_least_squares(change_pf(training.closure_um), training.force_n)
    return lambda closure_um: change_pf(closure_um) @ matrix


def elastance_based_force_estimator(training: Cases) -> ForceEstimator:
    """Return the least-squares force estimator from gap closures, which elastance (1/C) measures."""
    matrix = _fit_least_squares(training.closure_um, training.force_n)
    return lambda closure_um: closure_um @ matrix


def sigma_coverage_shares(truth_n: Vector, estimate_n: Vector, sigma_n: Vector) -> dict[str, list[float]]:
    """Return the shares of errors within one and two sigma, per axis; 0.683 and 0.954 if Gaussian.

    Args:
        truth_n: True forces [N], shape (n, 3).
        estimate_n: Estimates [N], shape (n, 3).
        sigma_n: Standard deviations that the estimator states [N], shape (n, 3).
    """
    off = np.abs(estimate_n - truth_n) / sigma_n
    return {f"within_{k}_sigma": np.mean(off < k, axis=0).round(4).tolist() for k in (1, 2)}


#: Name of the released table.
RESPONSE_FILE = "response.npz"
#: Seed and size of the held-out random loads.
HELD_OUT_SEED, HELD_OUT_CASES = 2, 10_000


def error_table(
    response: FootResponse,
    loads: LoadRange,
    released: ForceEstimator,
) -> dict[str, ForceErrors]:
    """Return the force errors of every estimator on the paper's cases and on random loads.

    Args:
        response: The foot.
        loads: Range of the training loads.
        released: The network trained on random loads.

    Returns:
        Rows by name: `paper_*` on the 180 verification cases without noise, `random_*` on held-out random loads
        with the converter's noise, from a tenth of the largest.
    """
    unit = loads.force_unit
    training = paper_training(response, force_unit=unit)
    verification = paper_verification(response, force_unit=unit)
    rng = np.random.default_rng(HELD_OUT_SEED)
    held_out = random_loads(response, loads, HELD_OUT_CASES, HELD_OUT_SEED)
    counted = np.linalg.norm(held_out.force_n, axis=1) >= loads.min_evaluated_force_n
    noisy_um = measured_closure_rel(response.design, held_out.closure_um, rng) * response.design.gap_um
    test = Cases(held_out.force_n[counted], noisy_um[counted])
    estimators: dict[str, tuple[ForceEstimator, Cases]] = {
        "paper_linear_dc": (capacitance_based_force_estimator(response.design, training), verification),
        "paper_linear_elastance": (elastance_based_force_estimator(training), verification),
        "paper_network": (released, verification),
        "random_linear_elastance": (
            elastance_based_force_estimator(random_loads(response, loads, HELD_OUT_CASES, 3)),
            test,
        ),
        "random_network": (released, test),
    }
    return {
        name: evaluate_force_errors(cases.force_n, read(cases.closure_um))
        for name, (read, cases) in estimators.items()
    }


def open_models(folder: Path) -> tuple[FootResponse, OnnxNetwork]:
    """Return response table and network from the folder of a foot type.

    Args:
        folder: The folder.

    Raises:
        ConfigError: The foot's description is missing, or does not fit.
        ModelError: A file is missing or corrupt, the network was trained on another response, or the two are of another
            foot than the one described beside them.
    """
    response = FootResponse.load(folder / RESPONSE_FILE)
    network = OnnxNetwork(folder / NETWORK_FILE)
    require_same_foot(load_foot(folder / FOOT_FILE), response, network.card, folder)
    if network.card.get("response_sha256") != response.sha256:
        raise ModelError(
            f"{folder / NETWORK_FILE} was not trained on {folder / RESPONSE_FILE}: "
            "the card names another hash; rebuild both with `footsense lab build`"
        )
    return response, network


def require_same_foot(
    foot_design: FootDesign, response: FootResponse, card: dict[str, Any], folder: Path
) -> None:
    """Raise an error unless response table and network belong to the foot described in their folder.

    Raises:
        ModelError: They are of another.
    """
    described = {
        "foot_type": foot_design.foot_type,
        **asdict(foot_design.capacitor),
        "ball_radius_mm": foot_design.ball_radius_mm,
        "hertz_modulus_mpa": foot_design.rubber.plane_strain_modulus_mpa,
    }
    tabled = {"foot_type": response.foot_type, **asdict(response.design)}
    films = film_provenance(foot_design)
    described |= {name: films.get(name) for name in ("gold", "parylene")}
    tabled |= {name: response.provenance.get(name) for name in ("gold", "parylene")}
    tabled |= {name: getattr(response, name) for name in ("ball_radius_mm", "hertz_modulus_mpa")}
    trained = card["training"]["random_loads"]
    described |= (loads := msgspec.structs.asdict(foot_design.loads))
    tabled |= {name: trained.get(name) for name in loads}
    for name, value in described.items():
        if tabled[name] != value:
            raise ModelError(
                f"{folder / FOOT_FILE}: {name} is {value}, table and network beside it were made for {tabled[name]}; "
                "rebuild both with `footsense lab build --foot`"
            )


def evaluate_models(folder: Path) -> dict[str, ForceErrors]:
    """Return the error table of released files.

    Args:
        folder: The folder of a foot type.
    """
    response, network = open_models(folder)
    loads, gap_um = load_foot(folder / FOOT_FILE).loads, response.design.gap_um
    return error_table(response, loads, lambda closure_um: network.force_n(closure_um / gap_um))


def as_markdown(table: dict[str, ForceErrors]) -> str:
    """Return the error table as Markdown, with the paper's errors as first row."""
    lines = [
        "| read-out, *same table* | cases | direction mean / p95 / max [deg] | magnitude mean / p95 / max [gf] |",
        "|---|---:|---:|---:|",
        f"| the paper (simulation) | 180 | {PAPER_DIRECTION_DEG} / - / - | {PAPER_MAGNITUDE_GF} / - / - |",
    ]
    for name, row in sorted(table.items()):
        direction = f"{row.direction_deg:.3f} / {row.direction_p95_deg:.3f} / {row.direction_max_deg:.2f}"
        magnitude = f"{row.magnitude_gf:.3f} / {row.magnitude_p95_gf:.3f} / {row.magnitude_max_gf:.2f}"
        lines.append(f"| {name} | {row.n} | {direction} | {magnitude} |")
    return "\n".join(lines)
