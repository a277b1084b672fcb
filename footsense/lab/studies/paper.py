"""Page `paper`: the paper's simulation done again, figure by figure, each beside the paper's own.

Source:
    Aoyagi et al., sections III B to III G, Figs. 5 to 12, 17 and 19.
"""

import jax
import numpy as np
import optax
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure

from footsense.foot.directions import angles_between_deg, directions, paper_directions
from footsense.foot.force_errors import GRAM_FORCE_N, evaluate_force_errors
from footsense.foot.specimen import Specimen
from footsense.frames import Vector
from footsense.lab.ball import elevation_circle_map_radius, map_circle
from footsense.lab.evaluation.evaluate_models import (
    MEASURED_DIRECTION_DEG,
    PAPER_DIRECTION_DEG,
    PAPER_MAGNITUDE_GF,
    capacitance_based_force_estimator,
    elastance_based_force_estimator,
)
from footsense.lab.fem.paper_sensors import (
    BLOCK_MESH,
    COARSE_BLOCK_MESH,
    PAPER_SENSOR_ARRAYS,
    half_thickness_mm,
    pressure_patterns,
    stress_series,
)
from footsense.lab.report import StudyContext, Values
from footsense.lab.training.load_cases import paper_training, paper_verification, sensed_closure_um
from footsense.lab.training.paper_procedure import (
    HIDDEN_NEURONS,
    RPROP,
    NetworkInput,
    PaperTraining,
    network_outputs,
    stack,
    start_weights_by_seed,
    train,
    unstack,
)

TITLE = "The paper's simulation, done again"

_SEEDS, _QUICK_SEEDS = 5, 2
_EPOCHS, _QUICK_EPOCHS = 5000, 500
_INPUTS: tuple[NetworkInput, ...] = ("capacitance", "closure")
_NEURONS, _QUICK_NEURONS = (3, 5, 8, 12, 18, 27, 40), (3, 18)
LEARNING_RATES, _MOMENTUM = (0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.7), 0.9
_RACE_EPOCHS, _QUICK_RACE_EPOCHS = 10_000, 300
_ARRAY_EPOCHS = 2000
#: Random error of each element in the trial of the arrays [1], standard deviation over its own output.
NOISE_REL = 0.05
#: The load of Fig. 17 [deg]; its magnitude is not given, this is that of the verification [gf].
PATTERN_DEG, MAGNITUDE_GF = (0.0, 45.0), 100.0
_MAP_LEVELS_DEG = (0.0, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0)
_MAP_POINTS, _MIN_ELEVATION_DEG = 91, 30.0


def compute(context: StudyContext) -> Values:
    """Do each part of the paper's simulation again; every network from five starts."""
    seeds = _QUICK_SEEDS if context.quick else _SEEDS
    epochs = _QUICK_EPOCHS if context.quick else _EPOCHS
    pattern_pf = _pattern_pf(context)
    procedure = {str(kind): _procedure(context, kind, seeds, epochs) for kind in _INPUTS}
    context.report_progress("the paper's procedure done")
    sizes = _sizes(context, seeds, epochs)
    context.report_progress("layers and neurons done")
    race = _race(context, seeds)
    context.report_progress("RPROP done")
    arrays = _arrays(context, seeds)
    context.drawings["paper-map.png"], error_map = _map(context)
    return {
        "n_seeds": seeds,
        "epochs": epochs,
        "unloaded_pf": context.response.design.unloaded_pf,
        "pattern_pf": pattern_pf,
        "procedure": procedure,
        "sizes": sizes,
        "race": race,
        "arrays": arrays,
        "block_mm": (context.foot_design.sheet_mm, 2.0 * half_thickness_mm(context.foot_design)),
        "map": error_map,
    }


def _pattern_pf(context: StudyContext) -> Vector:
    """Return the changes of capacitance under the load of Fig. 17 [pF], shape (3, 3)."""
    normal = directions(*np.array(PATTERN_DEG)[:, None])
    foot = Specimen(context.response)
    loaded_pf = foot.capacitance_pf(normal, MAGNITUDE_GF * GRAM_FORCE_N * normal)[0]
    change_pf: Vector = (loaded_pf - foot.unloaded_pf).reshape(3, 3)
    return change_pf


def _procedure(context: StudyContext, kind: NetworkInput, seeds: int, epochs: int) -> Values:
    """Return the errors of networks of every start at three forces, and of a linear estimate at 100 gf."""
    response = context.response
    networks = PaperTraining(response.design, paper_training(response), kind).train(
        start_weights_by_seed(seeds), epochs
    )
    found: Values = {"direction_deg": {}, "magnitude_gf": {}}
    for magnitude_gf in (50.0, MAGNITUDE_GF, 150.0):
        cases = paper_verification(response, force_unit=magnitude_gf / MAGNITUDE_GF)
        errors = [evaluate_force_errors(cases.force_n, network(cases.closure_um)) for network in networks]
        found["direction_deg"][f"{magnitude_gf:g}"] = [one.direction_deg for one in errors]
        found["magnitude_gf"][f"{magnitude_gf:g}"] = [one.magnitude_gf for one in errors]
    training = paper_training(response)
    linear = (
        elastance_based_force_estimator(training)
        if kind == "closure"
        else capacitance_based_force_estimator(response.design, training)
    )
    cases = paper_verification(response)
    alone = evaluate_force_errors(cases.force_n, linear(cases.closure_um))
    return found | {"linear_direction_deg": alone.direction_deg, "linear_magnitude_gf": alone.magnitude_gf}


def _sizes(context: StudyContext, seeds: int, epochs: int) -> list[Values]:
    """Return the errors at 100 gf of networks of one and two hidden layers of several widths, by start."""
    response, neurons = context.response, _QUICK_NEURONS if context.quick else _NEURONS
    training = PaperTraining(response.design, paper_training(response))
    cases, rows = paper_verification(response), []
    for depth in (1, 2):
        for n in neurons:
            own = [
                evaluate_force_errors(cases.force_n, network(cases.closure_um))
                for network in training.train(start_weights_by_seed(seeds, (9, *[n] * depth, 3)), epochs)
            ]
            rows.append(
                {
                    "layers": depth,
                    "neurons": n,
                    "direction_deg": [one.direction_deg for one in own],
                    "magnitude_gf": [one.magnitude_gf for one in own],
                }
            )
    return rows


def _race(context: StudyContext, seeds: int) -> list[Values]:
    """Return by how much fewer epochs and time RPROP needs to the loss at which gradient descent ends, by start."""
    epochs = _QUICK_RACE_EPOCHS if context.quick else _RACE_EPOCHS
    training = PaperTraining(context.response.design, paper_training(context.response))
    starts = start_weights_by_seed(seeds)
    rprop = train(RPROP, stack(starts), training.inputs, training.targets, epochs)
    rows = []
    for name, momentum in (("back-propagation", 0.0), (f"the same with momentum {_MOMENTUM:g}", _MOMENTUM)):
        rule = optax.inject_hyperparams(optax.sgd)(learning_rate=0.0, momentum=momentum)
        layers = stack([start for _ in LEARNING_RATES for start in starts])
        state = jax.vmap(rule.init)(layers)
        state.hyperparams["learning_rate"] = np.repeat(LEARNING_RATES, seeds).astype(np.float32)
        descent = train(rule, layers, training.inputs, training.targets, epochs, state)
        losses = descent.losses.reshape(len(LEARNING_RATES), seeds, epochs)
        # A rate at which the loss of one start overflows is of no use.
        sound = np.isfinite(losses[:, :, -1]).all(axis=1)
        best = int(
            np.where(sound, np.median(np.nan_to_num(losses[:, :, -1], nan=np.inf), axis=1), np.inf).argmin()
        )
        goal = losses[best, :, -1]
        epoch_s = [run.processor_s / run.losses.size for run in (descent, rprop)]
        slow, fast = _epochs_to(losses[best], goal), _epochs_to(rprop.losses, goal)
        rows.append(
            {
                "rule": name,
                "rate": LEARNING_RATES[best],
                "epochs": epochs,
                "times_fewer": slow / fast,
                "n_reached": int((rprop.losses.min(axis=1) <= goal).sum()),
                "times_faster": slow / fast * epoch_s[0] / epoch_s[1],
            }
        )
    return rows


def _epochs_to(losses: Vector, goal: Vector) -> Vector:
    """Return the epochs until each network reaches its goal, shape (starts,); all of them if never."""
    there = losses <= goal[:, None]
    return np.asarray(np.where(there.any(axis=1), there.argmax(axis=1), losses.shape[1]), float)


def _arrays(context: StudyContext, seeds: int) -> list[Values]:
    """Return the direction errors of the paper's sensors A to H, without and with random error, by start."""
    arrays = [array for array in PAPER_SENSOR_ARRAYS if not context.quick or array.name in "AF"]
    epochs = _QUICK_EPOCHS if context.quick else _ARRAY_EPOCHS
    series = stress_series(context.foot_design, arrays, COARSE_BLOCK_MESH if context.quick else BLOCK_MESH)
    training, test, rows = paper_directions("training"), paper_directions("verification"), []
    for array in arrays:
        patterns = [
            pressure_patterns(context.foot_design, series[array.name], each) for each in (training, test)
        ]
        errors = {}
        for noise_rel in (0.0, NOISE_REL):
            rng = np.random.default_rng(0)
            fed = []
            for pattern in patterns:
                erring = pattern * (1.0 + noise_rel * rng.normal(size=pattern.shape))
                fed.append(erring / np.abs(erring).max(axis=1, keepdims=True))
            starts = stack(start_weights_by_seed(seeds, (fed[0].shape[1], *HIDDEN_NEURONS, 3)))
            networks = unstack(train(RPROP, starts, fed[0], training, epochs).layers)
            errors[f"{noise_rel:g}"] = [
                evaluate_force_errors(
                    test, np.asarray(network_outputs(network, fed[1].astype(np.float32)), float)
                ).direction_deg
                for network in networks
            ]
        rows.append(
            {
                "sensor": array.name,
                "elements": array.elements_per_side**2,
                "side_mm": array.element_side_mm,
                "pitch_mm": array.pitch_mm,
                "direction_deg": errors,
            }
        )
        context.report_progress(f"sensor {array.name} done")
    return rows


def _map(context: StudyContext) -> tuple[Figure, Values]:
    """Return the released network's direction error over the ball, without noise, as figure and in numbers."""
    radius = elevation_circle_map_radius(_MIN_ELEVATION_DEG)
    along = np.linspace(-radius, radius, _MAP_POINTS)
    right, up = np.meshgrid(along, along)
    squared = right**2 + up**2
    normal = np.stack([-2.0 * up, -2.0 * right, 1.0 - squared], axis=-1) / (1.0 + squared)[..., None]
    on_map = normal[..., 2] >= np.sin(np.radians(_MIN_ELEVATION_DEG))
    force_n = normal[on_map] * MAGNITUDE_GF * GRAM_FORCE_N
    closure_um = sensed_closure_um(Specimen(context.response), normal[on_map], force_n)
    found_n = context.network.force_n(closure_um / context.response.design.gap_um)
    error_deg = np.full(right.shape, np.nan)
    error_deg[on_map] = angles_between_deg(force_n, found_n)
    figure = Figure(figsize=(5.4, 4.7), layout="constrained")
    axes = figure.subplots()
    norm = BoundaryNorm(_MAP_LEVELS_DEG, 256)
    filled = axes.contourf(right, up, error_deg, levels=_MAP_LEVELS_DEG, norm=norm, extend="max")
    (middle,) = directions(np.array([0.0]), np.array([60.0]))
    for radius_deg, style, what in (
        (PAPER_DIRECTION_DEG, "-", "simulation"),
        (MEASURED_DIRECTION_DEG, "--", "experiment"),
    ):
        axes.plot(*map_circle(middle, radius_deg), "r" + style, label=f"{radius_deg} deg, {what}")
    for elevation_deg in (30.0, 50.0, 70.0):
        axes.plot(*map_circle(np.array([0.0, 0.0, 1.0]), 90.0 - elevation_deg), color="w", lw=0.8, ls=":")
    axes.set(aspect="equal", xticks=[], yticks=[], frame_on=False, title="forward", xlabel="rear")
    axes.legend(title="the paper's mean error", fontsize=8, title_fontsize=8, loc="lower left")
    figure.colorbar(filled, ax=axes, label="direction error [deg]", shrink=0.8)
    worst = normal[np.unravel_index(np.nanargmax(error_deg), error_deg.shape)]
    return figure, {
        "mean_deg": np.nanmean(error_deg),
        "max_deg": np.nanmax(error_deg),
        "worst_azimuth_deg": np.degrees(np.arctan2(worst[1], worst[0])),
        "worst_elevation_deg": np.degrees(np.arcsin(worst[2])),
    }


def shown(values: Values) -> Values:
    """Return the best size, and where constants are."""
    own_deg = values["procedure"]["capacitance"]["direction_deg"]["100"]
    return {
        "own": {"mean": np.mean(own_deg), "deviation": np.std(own_deg, ddof=1), "worst": max(own_deg)},
        "best": min(values["sizes"], key=lambda row: np.mean(row["direction_deg"])),
        "largest_pf": np.max(values["pattern_pf"]),
        "paper_errors": (PAPER_DIRECTION_DEG, PAPER_MAGNITUDE_GF),
        "hidden": HIDDEN_NEURONS,
    }
