"""Study `sensors`: direction error by number and size of the elements, on the paper's block.

Source:
    Aoyagi et al., sections III B to III E, Figs. 5, 6 and 8, Table I.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from footsense.foot.directions import paper_directions
from footsense.foot.force_errors import GRAM_FORCE_N, evaluate_force_errors
from footsense.foot.symmetry import mirrored_series
from footsense.frames import Vector
from footsense.lab.fem.mesh import MeshSize
from footsense.lab.fem.other_sensors.block import (
    BLOCK_MESH,
    COARSE_BLOCK_MESH,
    BlockColumn,
    half_thickness_mm,
    solve_column_stress_fields,
)
from footsense.lab.fem.symmetry_classes import single_cell_series, transposed_series
from footsense.lab.former_page import Plots, Study, StudyContext
from footsense.lab.geometry import FootDesign
from footsense.lab.monte_carlo.statistics import SIGNIFICANT_STANDARD_ERRORS, MeanDifference, MeanStd
from footsense.lab.plots import subplot_row
from footsense.lab.response import SERIES_DEGREE, fit_series, mean_over_patch
from footsense.lab.training.paper.mlp import network_outputs, stack, train, unstack
from footsense.lab.training.paper.procedure import HIDDEN_NEURONS, start_weights_by_seed
from footsense.lab.training.paper.rprop import RPROP

#: Force of the contacts [gf]: patterns are divided by their maximum, so that it sets the size of the patch alone.
CONTACT_PATCH_FORCE_GF = 100.0
#: Random error of each element [1], rms of its own output.
NOISE_REL = 0.05
#: Networks for each sensor, and epochs of training.
SEEDS, QUICK_SEEDS = 5, 3
EPOCHS, QUICK_EPOCHS = 2000, 500
#: Seed of the random errors.
NOISE_SEED = 5
#: Saturated is what gains less than this of the step from 4 to 9 elements [1].
SATURATION_MAX_IMPROVEMENT_REL = 0.2

_TRAINING, _TEST = paper_directions("training"), paper_directions("verification")


@dataclass(frozen=True, slots=True)
class SensorArray:
    """Sensor array on the block, as in the paper's Fig. 6: number, side and pitch of the elements.

    Attributes:
        name: The paper's letter.
        elements_per_side: Elements along a side.
        element_side_mm: Side of an element [mm].
        pitch_mm: Distance of neighbouring elements [mm].
    """

    name: str
    elements_per_side: int
    element_side_mm: float
    pitch_mm: float

    def half_axis_element_borders_mm(self) -> list[tuple[float, float]]:
        """Return inner and outer border of each element on the positive half axis [mm], outermost first, at least 0."""
        centres = [
            self.pitch_mm * ((self.elements_per_side - 1) / 2.0 - k)
            for k in range((self.elements_per_side + 1) // 2)
        ]
        return [(max(0.0, c - self.element_side_mm / 2.0), c + self.element_side_mm / 2.0) for c in centres]

    def quarter_element_columns(self) -> list[BlockColumn]:
        """Return the block columns under the quarter's elements, grouped by x."""
        halves = self.half_axis_element_borders_mm()
        return [BlockColumn(x, y) for x in halves for y in halves]


#: A to C have their elements at the centres of F to H, which have the largest that leave bars of 1 mm between them, as
#: G has; D and E reach to the edge of the block.
PAPER_SENSOR_ARRAYS = (
    SensorArray("A", 2, 1.0, 7.5),
    SensorArray("B", 3, 1.0, 5.0),
    SensorArray("C", 5, 1.0, 3.0),
    SensorArray("D", 7, 1.0, 13.0 / 6.0),
    SensorArray("E", 9, 1.0, 13.0 / 8.0),
    SensorArray("F", 2, 6.5, 7.5),
    SensorArray("G", 3, 4.0, 5.0),
    SensorArray("H", 5, 2.0, 3.0),
)
QUICK_SENSOR_NAMES = "ABFG"
#: Pairs with as many elements, the smaller ones first.
SMALL_AND_LARGE_PAIRS = (("A", "F"), ("B", "G"), ("C", "H"))


def _series_of_all_elements(quarter: Vector, elements_per_side: int) -> Vector:
    """Return the response series of all elements, (products, n, n, 3), mirrored from the quarter's.

    The two or four parts of an element that a mirror plane cuts are as large, so that it feels their mean.
    """
    half = np.concatenate([quarter, mirrored_series(quarter, SERIES_DEGREE, 0)[:, ::-1]], axis=1)
    parts = np.concatenate([half, mirrored_series(half, SERIES_DEGREE, 1)[:, :, ::-1]], axis=2)
    for axis in (1, 2) if elements_per_side % 2 else ():
        middle = elements_per_side // 2
        mean = parts.take([middle, middle + 1], axis).mean(axis=axis, keepdims=True)
        outer = (parts.take(range(middle), axis), parts.take(range(middle + 2, elements_per_side + 1), axis))
        parts = np.concatenate([outer[0], mean, outer[1]], axis=axis)
    return parts


def stress_series(
    foot_design: FootDesign, sensors: Sequence[SensorArray], size: MeshSize
) -> dict[str, Vector]:
    """Return each sensor's mean element stress as response series [MPa/N], shapes (products, n, n, 3)."""
    fields = solve_column_stress_fields(
        foot_design, [column for sensor in sensors for column in sensor.quarter_element_columns()], size
    )
    fitted = {parity: fit_series(field) for parity, field in fields.items()}
    series, first = {}, 0
    for sensor in sensors:
        m = len(sensor.half_axis_element_borders_mm())
        own = {parity: part[:, first : first + m * m].reshape(-1, m, m, 3) for parity, part in fitted.items()}
        first += m * m
        raw = single_cell_series(own, SERIES_DEGREE)
        series[sensor.name] = _series_of_all_elements(
            (raw + transposed_series(raw, SERIES_DEGREE)) / 2.0, sensor.elements_per_side
        )
    return series


def pressure_patterns(foot_design: FootDesign, series: Vector, direction: Vector) -> Vector:
    """Return the element pressures [MPa], (n, elements), under centred Hertz contacts."""
    force_n = CONTACT_PATCH_FORCE_GF * GRAM_FORCE_N
    patch_mm = foot_design.hertz_patch_radius_mm(force_n)
    unit = mean_over_patch(series.reshape(len(series), -1), direction, patch_mm, foot_design)
    stress_mpa = (unit.reshape(len(direction), -1, 3) * direction[:, None, :]).sum(axis=2)
    pressure_mpa: Vector = -force_n * stress_mpa
    return pressure_mpa


def network_direction_errors(
    training: Vector, test: Vector, noise_rel: float, seeds: int, epochs: int
) -> MeanStd:
    """Return the direction error [deg] of networks, as mean and standard deviation over start weights.

    Args:
        training: Pressures of the training directions, shape (181, elements).
        test: Pressures of the test directions, shape (180, elements).
        noise_rel: Random error of both [1].
        seeds: Networks.
        epochs: Training epochs.
    """
    rng = np.random.default_rng(NOISE_SEED)

    def inputs(pressure: Vector) -> Vector:
        """Return the network's inputs from pressures, with random error."""
        erring = pressure * (1.0 + noise_rel * rng.normal(size=pressure.shape))
        normalised: Vector = erring / np.abs(erring).max(axis=1, keepdims=True)
        return normalised

    training_inputs, test_inputs = inputs(training), inputs(test).astype(np.float32)
    starts = stack(start_weights_by_seed(seeds, (training.shape[1], *HIDDEN_NEURONS, 3)))
    networks = unstack(train(RPROP, starts, training_inputs, _TRAINING, epochs).layers)
    return MeanStd.of_values(
        evaluate_force_errors(_TEST, np.asarray(network_outputs(network, test_inputs), float)).direction_deg
        for network in networks
    )


@dataclass(frozen=True, kw_only=True)
class Results:
    """Results of the study: direction errors [deg] of all sensor arrays on the block.

    Attributes:
        block_side_mm: Side of the block [mm].
        block_thickness_mm: Thickness of the block [mm].
        epochs: Training epochs.
        seeds: Networks for each sensor.
        noiseless_error_deg: Without random error, by sensor.
        noisy_error_deg: With random error, by sensor.
    """

    block_side_mm: float
    block_thickness_mm: float
    epochs: int
    seeds: int
    noiseless_error_deg: dict[str, MeanStd]
    noisy_error_deg: dict[str, MeanStd]


def compute(context: StudyContext) -> tuple[Results, Plots]:
    """Return the direction errors of networks trained on the pressure patterns of every sensor array, with figure."""
    foot_design, quick = context.foot_design, context.quick
    sensors = [sensor for sensor in PAPER_SENSOR_ARRAYS if not quick or sensor.name in QUICK_SENSOR_NAMES]
    seeds, epochs = (QUICK_SEEDS, QUICK_EPOCHS) if quick else (SEEDS, EPOCHS)
    series = stress_series(foot_design, sensors, COARSE_BLOCK_MESH if quick else BLOCK_MESH)
    context.report_progress(f"sensors: stresses of {len(sensors)} sensors solved")
    clean, noisy = {}, {}
    for name in series:
        training, test = (
            pressure_patterns(foot_design, series[name], direction) for direction in (_TRAINING, _TEST)
        )
        clean[name] = network_direction_errors(training, test, 0.0, seeds, epochs)
        noisy[name] = network_direction_errors(training, test, NOISE_REL, seeds, epochs)
        context.report_progress(f"sensors: {name} trained")
    results = Results(
        block_side_mm=foot_design.sheet_mm,
        block_thickness_mm=2.0 * half_thickness_mm(foot_design),
        epochs=epochs,
        seeds=seeds,
        noiseless_error_deg=clean,
        noisy_error_deg=noisy,
    )
    return results, {"sensors.png": _figure(results)}


def _figure(results: Results) -> Figure:
    """Return the figure of direction error over number of elements, small and large ones, with and without noise."""
    figure, row = subplot_row(2, 8.2, 3.9)
    quarter_element_columns = (
        ("no random error", results.noiseless_error_deg),
        (f"{NOISE_REL:.0%} random error", results.noisy_error_deg),
    )
    for axes, (title, errors_deg) in zip(row, quarter_element_columns, strict=True):
        for names, marker, label in (("ABCDE", "o-", "1 mm elements"), ("FGH", "s--", "larger elements")):
            drawn = [
                sensor for sensor in PAPER_SENSOR_ARRAYS if sensor.name in names and sensor.name in errors_deg
            ]
            number = [sensor.elements_per_side**2 for sensor in drawn]
            mean, std = ([getattr(errors_deg[one.name], of) for one in drawn] for of in ("mean", "std"))
            axes.errorbar(number, mean, std, fmt=marker, capsize=3, ms=5, label=label)
            for sensor, x, y in zip(drawn, number, mean, strict=True):
                axes.annotate(sensor.name, (x, y), xytext=(4, 5), textcoords="offset points", fontsize=8)
        axes.set(title=title, xlabel="elements", ylabel="mean direction error [deg]", xscale="log")
        axes.set_xticks([4, 9, 25, 49, 81], ["4", "9", "25", "49", "81"])
        axes.minorticks_off()
        axes.set_ylim(bottom=0.0)
    row[-1].legend(fontsize=8)
    return figure


def error_reductions_by_larger_elements(errors_deg: dict[str, MeanStd]) -> dict[str, MeanDifference]:
    """Return the error reduction by larger elements, for each of `SMALL_AND_LARGE_PAIRS` [deg]."""
    return {
        f"{s} minus {b}": errors_deg[s].difference_from(errors_deg[b])
        for s, b in SMALL_AND_LARGE_PAIRS
        if b in errors_deg
    }


def noise_error_factors(results: Results) -> dict[str, float]:
    """Return the error with noise over the error without noise [1], by sensor."""
    return {
        name: results.noisy_error_deg[name].mean / clean.mean
        for name, clean in results.noiseless_error_deg.items()
    }


STUDY = Study(
    name="sensors",
    title="How many elements, and how large",
    compute=compute,
    template_names={
        "CONTACT_PATCH_FORCE_GF": CONTACT_PATCH_FORCE_GF,
        "HIDDEN_NEURONS": HIDDEN_NEURONS,
        "NOISE_REL": NOISE_REL,
        "PAPER_SENSOR_ARRAYS": PAPER_SENSOR_ARRAYS,
        "SATURATION_MAX_IMPROVEMENT_REL": SATURATION_MAX_IMPROVEMENT_REL,
        "SIGNIFICANT_STANDARD_ERRORS": SIGNIFICANT_STANDARD_ERRORS,
        "error_reductions_by_larger_elements": error_reductions_by_larger_elements,
        "noise_error_factors": noise_error_factors,
    },
    uses_network=False,
)
