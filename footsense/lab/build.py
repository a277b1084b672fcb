"""Build of a foot type's model files: finite element solve, response table, network training, evaluation, export.

Nothing is written before everything is made, and a file appears whole or not at all.
"""

import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import ngsolve as ng
import numpy as np

from footsense.estimation.missing_elements import MAX_OVERLOADED, MISSING_SETS, Imputation
from footsense.estimation.network import steady_windows
from footsense.foot.force_errors import ForceErrors
from footsense.foot.network_card import FORMAT, INPUTS, NETWORK_FILE, OUTPUTS, add_checksum
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Specimen
from footsense.frames import Vector
from footsense.lab.evaluation.evaluate_models import (
    HELD_OUT_CASES,
    HELD_OUT_SEED,
    RESPONSE_FILE,
    as_markdown,
    error_table,
    evaluate_models,
)
from footsense.lab.evaluation.force_range import CENTRED_DEG, LEANS_DEG, force_range
from footsense.lab.fem.mesh import COARSE_MESH, RELEASED_MESH, MeshSize
from footsense.lab.foot_file import FOOT_FILE, load_foot
from footsense.lab.geometry import PAPER_MAX_FORCE_N, FootDesign, LoadRange
from footsense.lab.response import make_response
from footsense.lab.template import render
from footsense.lab.training import load_cases
from footsense.lab.training.export import OnnxNetwork, as_stored, library_versions, load_weights, onnx_model
from footsense.lab.training.gait_readings import concatenate_gaits, random_gaits
from footsense.lab.training.load_cases import random_loads
from footsense.lab.training.train_windowed import WindowTrainingSettings, train_windowed
from footsense.lab.training.walker_gaits import walker_gaits
from footsense.lab.training.windowed_network import Weights, mean_closure_product_matrix, predict
from footsense.lab.walkers.split import training_logs
from footsense.progress import timed_bar

#: Seed of the random loads of the training.
TRAINING_SEED = 1
#: ONNX Runtime may differ from JAX by this much, over the largest force [1]: of 2 N a tenth of a bit on CAN, five times
#: what is seen.
MAX_ONNX_DIFFERENCE_REL = 5e-5
#: Margin around the trained closures within which the daemon uses the network [1]: noise, and drift since the tare.
INPUT_RANGE_MARGIN_REL = 0.02
#: Decimals of the moments, whose largest is about 1.
_MOMENT_DECIMALS = 9


@dataclass(frozen=True, slots=True, kw_only=True)
class BuildSettings:
    """Settings of a build: mesh, numbers of loads and gaits, training protocols.

    Attributes:
        mesh: Resolution of the solid's mesh.
        random_loads: Number of random loads at rest of the training.
        gaits: Number of random gaits of the training, three seconds each, and as many of walking robots.
        released: Training of the released network.
        quick: Whether the model card warns that this is no release.
        start_file: Network whose weights the training starts from; None for random ones.
    """

    mesh: MeshSize
    random_loads: int
    gaits: int
    released: WindowTrainingSettings
    quick: bool = False
    start_file: Path | None = None


#: A short training, from the network of a foot that closes alike: forces are learnt in a unit of the full load.
FULL_BUILD = BuildSettings(
    mesh=RELEASED_MESH,
    random_loads=60_000,
    gaits=4_000,
    released=WindowTrainingSettings(channels=112, steps=20_000, rate=1e-3),
    start_file=Path(__file__).parent / "training" / "start.onnx",
)
#: From nothing, in five times as long.
BUILD_FROM_NOTHING = replace(
    FULL_BUILD, random_loads=200_000, released=WindowTrainingSettings(channels=112), start_file=None
)
#: Every step of the chain in half a minute; its numbers are no release.
QUICK_BUILD = BuildSettings(
    mesh=COARSE_MESH,
    random_loads=10_000,
    gaits=30,
    released=WindowTrainingSettings(channels=8, steps=1_500, batch=256, rate=1e-2),
    quick=True,
)


@dataclass(frozen=True, slots=True)
class BuildResult:
    """Result of a build: error table, network card, and difference between ONNX Runtime and JAX.

    Attributes:
        error_table: Errors by row, of the file as ONNX Runtime computes it.
        card: The network's card.
        onnx_difference_n: Largest difference between JAX and ONNX Runtime [N].
    """

    error_table: dict[str, ForceErrors]
    card: dict[str, Any]
    onnx_difference_n: float


#: Usual time of the response table [s], as in the report.
_EXPECTED_SOLVE_S = 33.0
#: Conversions of a gait.
_CONVERSIONS_PER_GAIT = 1100


def _network_card(
    response: FootResponse,
    loads: LoadRange,
    recipe: BuildSettings,
    weights: Weights,
    seen_rel: Vector,
    moments: Vector,
    table: dict[str, ForceErrors],
) -> dict[str, Any]:
    """Return the network's card: constants that the service needs for the network, and how it was trained."""
    design = response.design
    return {
        "format": FORMAT,
        "foot_type": response.foot_type,
        "inputs": [msgspec.structs.asdict(signal) for signal in INPUTS],
        "outputs": [msgspec.structs.asdict(signal) for signal in OUTPUTS],
        **asdict(design),
        "closure_rel_min": np.round(seen_rel.min(axis=0) - INPUT_RANGE_MARGIN_REL, 6).tolist(),
        "closure_rel_max": np.round(seen_rel.max(axis=0) + INPUT_RANGE_MARGIN_REL, 6).tolist(),
        "moments": moments.tolist(),
        "response_sha256": response.sha256,
        "training": {
            "random_loads": {
                "cases": recipe.random_loads,
                "seed": TRAINING_SEED,
                **msgspec.structs.asdict(loads),
                "full_scale_pf": load_cases.FULL_SCALE_PF,
                "noise_pf": load_cases.NOISE_PF,
                "baseline_noise_pf": load_cases.BASELINE_NOISE_PF,
            },
            "random_gaits": {
                "gaits": recipe.gaits,
                "gaits_of_robots": recipe.gaits,
                "conversions": _CONVERSIONS_PER_GAIT,
                "seed": TRAINING_SEED,
            },
            "held_out": {"cases": HELD_OUT_CASES, "seed": HELD_OUT_SEED},
            "released": recipe.released.card(),
            "weights": weights.n_weights,
            **({} if recipe.start_file is None else {"started_from": recipe.start_file.name}),
        },
        "errors": {name: asdict(row) for name, row in table.items()},
        "built_with": {**library_versions(), "ngsolve": ng.__version__},
    }


def response_in_force_unit(response: FootResponse, unit: float) -> FootResponse:
    """Return the response table for forces divided by a unit: the same closures, smaller forces.

    Args:
        response: The foot.
        unit: The unit [1]; a foot of unit 1 is returned unchanged.
    """
    return replace(
        response,
        hertz_modulus_mpa=response.hertz_modulus_mpa / unit,
        quarter_series=response.quarter_series * unit,
        quarter_compliance=response.quarter_compliance * unit,
    )


def _onnx_difference_n(network: OnnxNetwork, weights: Weights, unit: float, closure_rel: Any) -> float:
    """Return the largest difference of forces between ONNX Runtime and JAX [N], over all sets of missing elements."""
    window = steady_windows(closure_rel, MISSING_SETS[np.arange(len(closure_rel)) % len(MISSING_SETS)])
    pairs = zip(network.estimate(window)[:2], predict(weights, window)[:2], strict=True)
    return max(float(np.abs(one - unit * other).max()) for one, other in pairs)


def readme(
    foot_design: FootDesign,
    response: FootResponse,
    card: dict[str, Any],
    table: dict[str, ForceErrors],
    onnx_difference_n: float,
    *,
    quick: bool,
) -> str:
    """Return the README of a foot type's model files as Markdown."""
    names = {
        "foot_design": foot_design,
        "response": response,
        "card": card,
        "error_table": as_markdown(table),
        "onnx_difference_n": onnx_difference_n,
        "quick": quick,
        "range": force_range(Specimen(response), foot_design.loads.max_n),
        "CENTRED_DEG": CENTRED_DEG,
        "LEANS_DEG": LEANS_DEG,
        "force_unit": foot_design.loads.force_unit,
        "FOOT_FILE": FOOT_FILE,
        "HELD_OUT_CASES": HELD_OUT_CASES,
    }
    return render("lab/model_card.md", names)


def build(foot_file: Path, output: Path, recipe: BuildSettings, report: Callable[[str], None]) -> BuildResult:
    """Build and write all model files of a foot type: response table, network, card.

    Args:
        foot_file: Description of the foot.
        output: Folder for response.npz, the network, a copy of the description, and README.md; made if missing.
        recipe: How fine and how long.
        report: Receives a line after each step.

    Returns:
        Errors, card and parity.

    Raises:
        ConfigError: The description does not fit.
        ArithmeticError: ONNX Runtime and JAX differ too much.
        ModelError: The foot cannot be solved, or its loads are beyond the converter.
    """
    foot_design, description = load_foot(foot_file), foot_file.read_bytes()
    with timed_bar("solid", _EXPECTED_SOLVE_S):
        made = make_response(foot_design, recipe.mesh, report)
    report(f"response table: {made.provenance}")
    output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=output) as temporary:
        made.save(Path(temporary) / RESPONSE_FILE)
        response = FootResponse.load(Path(temporary) / RESPONSE_FILE)
        design, loads = response.design, foot_design.loads
        unit = loads.force_unit
        response_in_unit = response_in_force_unit(response, unit)
        loads_unit = msgspec.structs.replace(loads, max_n=PAPER_MAX_FORCE_N)
        cases = random_loads(
            response_in_unit, loads_unit, recipe.random_loads, TRAINING_SEED, max_overloaded=MAX_OVERLOADED
        )
        report(f"{recipe.random_loads} random loads, gaps in contact")
        closure_rel = cases.closure_um / design.gap_um
        seen_rel = cases.with_symmetric_copies().closure_um / design.gap_um
        moments = np.round(mean_closure_product_matrix(seen_rel), _MOMENT_DECIMALS)
        own, robots = (
            make(TRAINING_SEED, recipe.gaits, _CONVERSIONS_PER_GAIT, PAPER_MAX_FORCE_N, jobs=2)
            for make in (
                partial(random_gaits, response_in_unit),
                partial(walker_gaits, response_in_unit, training_logs(report, quick=recipe.quick), unit),
            )
        )
        gaits = concatenate_gaits([own, robots])
        report(f"{recipe.gaits} random gaits and as many of robots, of {_CONVERSIONS_PER_GAIT} conversions")
        start = None if recipe.start_file is None else load_weights(recipe.start_file)
        weights = as_stored(
            train_windowed(gaits, cases, design, recipe.released, Imputation(moments), report, start)
        )
        report(f"trained on them: {weights.n_weights} weights")
        # The card needs the errors before the file exists, so JAX computes them; the printed ones are of the file.
        table = error_table(
            response,
            loads,
            lambda closure_um: unit * predict(weights, steady_windows(closure_um / design.gap_um)).force_n,
        )
        card = _network_card(response, loads, recipe, weights, seen_rel, moments, table)
        network = add_checksum(onnx_model(weights, card, unit).SerializeToString())
        (Path(temporary) / NETWORK_FILE).write_bytes(network)
        parity = _onnx_difference_n(OnnxNetwork(Path(temporary) / NETWORK_FILE), weights, unit, closure_rel)
        most_n = MAX_ONNX_DIFFERENCE_REL * loads.max_n
        if not parity <= most_n:
            raise ArithmeticError(f"ONNX Runtime and JAX differ by {parity:.2e} N, more than {most_n:.0e} N")
        (Path(temporary) / FOOT_FILE).write_bytes(description)
        table = evaluate_models(Path(temporary))
        text = readme(foot_design, made, card, table, parity, quick=recipe.quick)
        (Path(temporary) / "README.md").write_text(text, encoding="utf-8")
        for name in (FOOT_FILE, RESPONSE_FILE, NETWORK_FILE, "README.md"):
            (Path(temporary) / name).replace(output / name)
    return BuildResult(table, card, parity)
