"""Study `cavity`: effect of the air in the cavities (vented, or sealed and at rest) on closures, errors and limits.

Source:
    Aoyagi et al., section IV: "each sealed concave space".
"""

from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

from footsense.foot.directions import normalized, paper_directions
from footsense.foot.force_errors import GRAM_FORCE_N, ForceErrors, evaluate_force_errors
from footsense.foot.gap_contact import CELLS_PER_ELEMENT, element_means
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Foot
from footsense.frames import ELEMENTS, Vector
from footsense.lab.evaluation.cramer_rao import Unknowns, force_bound
from footsense.lab.evaluation.evaluate_models import (
    MEASURED_DIRECTION_DEG,
    MEASURED_MAGNITUDE_GF,
    capacitance_based_force_estimator,
    elastance_based_force_estimator,
)
from footsense.lab.fem.sealed_air import ADIABATIC, AMBIENT_KPA, ROOM_TEMPERATURE_K, SealedFoot
from footsense.lab.former_page import MeanStd, Plots, Study, StudyContext
from footsense.lab.plots import subplot_row
from footsense.lab.studies.mechanics import venting
from footsense.lab.training.load_cases import (
    FULL_SCALE_PF,
    Cases,
    paper_training,
    sensed_closure_um,
)
from footsense.lab.training.paper_procedure import PaperTraining, per_foot_force_n, start_weights_by_seed
from footsense.sim.fabrication import PAPER_TOLERANCES, FootTolerances, draw_deviations
from footsense.sim.loads.press_sequence import paper_presses
from footsense.validation.made_feet import EXACT_CONDITIONS, PressConditions, PressedFoot

#: Feet with the compared cavities.
FEET_BY_CAVITY: dict[str, type[Foot]] = {"vented": Foot, "sealed": SealedFoot}
#: Feet of each kind, training epochs of their networks, and seed.
FEET, QUICK_FEET = 8, 2
EPOCHS, QUICK_EPOCHS = 3000, 300
SEED = 20090304
#: Magnitudes of the bound [gf].
CRAMER_RAO_LOADS_GF = (20.0, 50.0, 100.0, 150.0)
#: Loads of the search for the range [N].
RANGE_SEARCH_LOADS_N = np.geomspace(0.2, 40.0, 120)

_UPWARD = np.array([[0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True, kw_only=True)
class CavityPerformance:
    """Sensitivity, range and errors of a foot with one kind of cavity.

    Attributes:
        corner_edge_middle_um_per_n: Mean closure of each of these elements under a small upright force [um/N].
        upright_range_n: Largest upright force within the converter's range [N].
        first_cell_closing_force_n: Upright force that closes the first cell [N].
        linear_on_capacitance_errors: Errors of a linear estimator of capacitance changes, exact foot, paper's cases.
        linear_on_elastance_errors: The same of elastance.
        cramer_rao_direction_rms_deg: Rms of the least direction error at each of `CRAMER_RAO_LOADS_GF` [deg].
        cramer_rao_magnitude_rms_gf: Rms of the least magnitude error [gf].
        exact_feet_direction_error_deg: Direction errors of the paper's procedure on exact feet, a network for each.
        exact_feet_magnitude_error_gf: Magnitude errors of it.
        fabricated_feet_direction_error_deg: The same with the paper's tolerances and a careful test stand.
        fabricated_feet_magnitude_error_gf: Magnitude errors of it.
        read_as_vented_direction_error_deg: Errors of the vented design's network on such an exact foot.
        read_as_vented_magnitude_error_gf: Magnitude errors of it.
    """

    corner_edge_middle_um_per_n: tuple[float, float, float]
    upright_range_n: float
    first_cell_closing_force_n: float
    linear_on_capacitance_errors: ForceErrors
    linear_on_elastance_errors: ForceErrors
    cramer_rao_direction_rms_deg: list[float]
    cramer_rao_magnitude_rms_gf: list[float]
    exact_feet_direction_error_deg: MeanStd
    exact_feet_magnitude_error_gf: MeanStd
    fabricated_feet_direction_error_deg: MeanStd
    fabricated_feet_magnitude_error_gf: MeanStd
    read_as_vented_direction_error_deg: float
    read_as_vented_magnitude_error_gf: float


@dataclass(frozen=True, kw_only=True)
class Results:
    """Results of the study `cavity`: stiffness of the air, errors, drift and venting.

    Attributes:
        by_cavity_kind: Figures by kind.
        adiabatic_sealed_closure_um_per_n: Closures of a sealed foot whose air keeps its heat [um/N].
        air_over_solid_stiffness: Stiffness of the air over that of the solid, smallest and largest over the patterns of
            closures [1].
        sealed_drift_ff_per_kpa_drop: Mean change of unloaded readings per kPa less of ambient pressure, sealed [fF].
        sealed_drift_gf_per_kpa_drop: Upright load that changes the mean closure as much [gf].
        sealed_drift_ff_per_kelvin: Mean change of the unloaded readings per kelvin, sealed [fF].
        closure_if_sealed_at_100_c_um: Mean closure at rest of a foot whose air was sealed in at 100 degC [um].
        sorption_half_time_s: Time in which the bare plates take up half of a cavity's excess air [s].
        parylene_time_constant_s: Time constant of a wall of parylene as large as the cavity [s].
        channel_time_constant_s: Time constant of a channel of `VENT_CHANNEL_WIDTH_MM` through a bar [s].
        closure_over_pressure_relaxation: Relaxation time over that of pressures, softest and stiffest pattern [1].
    """

    by_cavity_kind: dict[str, CavityPerformance]
    adiabatic_sealed_closure_um_per_n: tuple[float, float, float]
    air_over_solid_stiffness: tuple[float, float]
    sealed_drift_ff_per_kpa_drop: float
    sealed_drift_gf_per_kpa_drop: float
    sealed_drift_ff_per_kelvin: float
    closure_if_sealed_at_100_c_um: float
    sorption_half_time_s: float
    parylene_time_constant_s: float
    channel_time_constant_s: float
    closure_over_pressure_relaxation: tuple[float, float]


def _corner_edge_middle_means_um(cell_closures_um: Vector) -> tuple[float, float, float]:
    """Return the mean closures of elements 0, 1 and 4 [um] of one load's cells, shape (1, 324)."""
    corner, edge, middle = element_means(cell_closures_um)[0, [0, 1, 4]].tolist()
    return corner, edge, middle


#: A careful test stand: the paper's meter and reference sensor, and a stick set by hand.
CAREFUL_TEST_STAND = replace(
    EXACT_CONDITIONS, reading_noise_pf=1e-3, repeatability_rel=0.02, force_noise_steps=0.5, lean_rms_deg=1.0
)


def paper_procedure_errors(
    foot: Foot, mount: Vector, stand: PressConditions, seed: int, epochs: int
) -> ForceErrors:
    """Return the errors of a plain network trained on 362 cases of the foot, over the 180 test cases.

    Args:
        foot: The foot.
        mount: Rotation on its leg.
        stand: Errors of the test stand.
        seed: Seed of the stand's errors and of the start weights.
        epochs: Training epochs.
    """
    pressed = PressedFoot(foot, mount, stand, np.random.default_rng((SEED, seed)))
    training, test = (pressed.press_with_stick(paper_presses(name)) for name in ("training", "verification"))
    change_pf, test_pf = (one.capacitance_pf - one.baseline_pf for one in (training, test))
    force_n = per_foot_force_n(foot.response.design, seed, epochs, change_pf, training.force_n, test_pf)
    return evaluate_force_errors(test.force_n, force_n)


def errors_over_feet(
    kind: type[Foot],
    response: FootResponse,
    tolerances: FootTolerances,
    stand: PressConditions,
    n_feet: int,
    epochs: int,
) -> tuple[MeanStd, MeanStd]:
    """Return direction [deg] and magnitude errors [gf] of the paper's procedure, statistics over random feet."""
    rows = []
    for number in range(n_feet):
        own = draw_deviations(response, tolerances, SEED, number)
        rows.append(paper_procedure_errors(kind(response, own), own.mount, stand, number, epochs))
    direction_deg, magnitude_gf = zip(*((row.direction_deg, row.magnitude_gf) for row in rows), strict=True)
    return MeanStd.of_values(direction_deg), MeanStd.of_values(magnitude_gf)


def cavity_performance(context: StudyContext, cavity: str) -> CavityPerformance:
    """Return sensitivity, range and errors of the released foot with one kind of cavity."""
    kind, response = FEET_BY_CAVITY[cavity], context.response
    foot, design = kind(response), response.design
    n_feet, epochs = (QUICK_FEET, QUICK_EPOCHS) if context.quick else (FEET, EPOCHS)
    training, test = (
        Cases(force_n, sensed_closure_um(foot, normalized(force_n), force_n))
        for force_n in (paper_presses("training"), paper_presses("verification"))
    )
    small_um = foot.cell_closures_um(_UPWARD, 0.05 * _UPWARD)
    up, loads_n = (
        np.repeat(_UPWARD, len(RANGE_SEARCH_LOADS_N), axis=0),
        RANGE_SEARCH_LOADS_N[:, None] * _UPWARD,
    )
    cell_closures_um = foot.cell_closures_um(up, loads_n)
    beyond = foot.capacitance_pf(up, loads_n).max(axis=1) >= FULL_SCALE_PF
    closed = cell_closures_um.max(axis=1) >= design.gap_um
    direction = paper_directions("verification")
    bounds = [
        force_bound(foot, direction, gf * GRAM_FORCE_N * direction, Unknowns.LEANING)
        for gf in CRAMER_RAO_LOADS_GF
    ]
    own_deg, own_gf = errors_over_feet(kind, response, FootTolerances(), EXACT_CONDITIONS, n_feet, epochs)
    made_deg, made_gf = errors_over_feet(kind, response, PAPER_TOLERANCES, CAREFUL_TEST_STAND, n_feet, epochs)
    designed = PaperTraining(design, paper_training(response)).train(start_weights_by_seed(1), epochs)[0]
    misread = evaluate_force_errors(test.force_n, designed(test.closure_um))
    by_capacitance_n = capacitance_based_force_estimator(design, training)(test.closure_um)
    by_elastance_n = elastance_based_force_estimator(training)(test.closure_um)
    context.report_progress(f"cavity: {cavity} measured")
    return CavityPerformance(
        corner_edge_middle_um_per_n=_corner_edge_middle_means_um(small_um / 0.05),
        upright_range_n=float(
            RANGE_SEARCH_LOADS_N[beyond.argmax()] if beyond.any() else RANGE_SEARCH_LOADS_N[-1]
        ),
        first_cell_closing_force_n=float(
            RANGE_SEARCH_LOADS_N[closed.argmax()] if closed.any() else RANGE_SEARCH_LOADS_N[-1]
        ),
        linear_on_capacitance_errors=evaluate_force_errors(test.force_n, by_capacitance_n),
        linear_on_elastance_errors=evaluate_force_errors(test.force_n, by_elastance_n),
        cramer_rao_direction_rms_deg=[float(np.sqrt(np.mean(b.direction_rms_deg**2))) for b in bounds],
        cramer_rao_magnitude_rms_gf=[float(np.sqrt(np.mean(bound.magnitude_rms_gf**2))) for bound in bounds],
        exact_feet_direction_error_deg=own_deg,
        exact_feet_magnitude_error_gf=own_gf,
        fabricated_feet_direction_error_deg=made_deg,
        fabricated_feet_magnitude_error_gf=made_gf,
        read_as_vented_direction_error_deg=misread.direction_deg,
        read_as_vented_magnitude_error_gf=misread.magnitude_gf,
    )


def compute(context: StudyContext) -> tuple[Results, Plots]:
    """Return the figures of vented and sealed cavities of the released foot."""
    response, design, made = context.response, context.response.design, context.foot_design
    by_cavity_kind = {name: cavity_performance(context, name) for name in FEET_BY_CAVITY}
    sealed = SealedFoot(response)
    low, warm, hot = (
        SealedFoot(response, ambient_kpa=ambient_kpa, gas_kpa=gas_kpa)
        for ambient_kpa, gas_kpa in (
            (AMBIENT_KPA - 1.0, AMBIENT_KPA),
            (AMBIENT_KPA, AMBIENT_KPA * (1.0 + 1.0 / ROOM_TEMPERATURE_K)),
            (AMBIENT_KPA, AMBIENT_KPA * ROOM_TEMPERATURE_K / 373.15),
        )
    )
    area_mm2 = design.electrode_area_mm2 / CELLS_PER_ELEMENT
    by_element = response.compliance_um_per_n.reshape((ELEMENTS, CELLS_PER_ELEMENT) * 2)
    stiffness = (
        np.linalg.eigvalsh(by_element.mean(axis=1).sum(axis=2) * area_mm2)
        * 1e-3
        * AMBIENT_KPA
        / design.gap_um
    )
    thin_pf, warm_pf = (float((one.unloaded_pf - sealed.unloaded_pf).mean()) for one in (low, warm))
    small_pf = float((sealed.capacitance_pf(_UPWARD, GRAM_FORCE_N * _UPWARD) - sealed.unloaded_pf).mean())
    bar_mm = made.pitch_mm - made.electrode_mm
    adiabatic = SealedFoot(response, exponent=ADIABATIC)
    results = Results(
        by_cavity_kind=by_cavity_kind,
        adiabatic_sealed_closure_um_per_n=_corner_edge_middle_means_um(
            adiabatic.cell_closures_um(_UPWARD, 0.05 * _UPWARD) / 0.05
        ),
        air_over_solid_stiffness=(float(stiffness.min()), float(stiffness.max())),
        sealed_drift_ff_per_kpa_drop=1e3 * thin_pf,
        sealed_drift_gf_per_kpa_drop=thin_pf / small_pf,
        sealed_drift_ff_per_kelvin=1e3 * warm_pf,
        closure_if_sealed_at_100_c_um=float(hot.cell_closures_um(_UPWARD, 0.0 * _UPWARD).mean()),
        sorption_half_time_s=venting.sorption_half_time_s(made.gap_um),
        parylene_time_constant_s=venting.parylene_time_constant_s(made.gap_um),
        channel_time_constant_s=venting.channel_time_constant_s(made.gap_um, made.electrode_mm, bar_mm),
        closure_over_pressure_relaxation=(1.0 + float(stiffness.min()), 1.0 + float(stiffness.max())),
    )
    return results, {"cavity.png": _figure(response)}


def _figure(response: FootResponse) -> Figure:
    """Return the figure of closures over the load."""
    figure, (over_load,) = subplot_row(1, 5.0, 3.9)
    loads_n = np.linspace(0.02, 3.0, 40)
    normal = normalized(np.repeat(_UPWARD, len(loads_n), axis=0))
    for colour, (name, kind) in zip(("C0", "C1"), FEET_BY_CAVITY.items(), strict=True):
        foot = kind(response)
        means_um = element_means(foot.cell_closures_um(normal, loads_n[:, None] * normal))
        for element, style, where in ((0, "-", "corner"), (4, "--", "middle")):
            over_load.plot(loads_n, means_um[:, element], style, color=colour, label=f"{name}, {where}")
    over_load.set(xlabel="upright force [N]", ylabel="mean closure [um]")
    over_load.legend(fontsize=8)
    return figure


STUDY = Study(
    name="cavity",
    title="Air in the cavities",
    compute=compute,
    template_names={
        "VENT_CHANNEL_WIDTH_MM": venting.VENT_CHANNEL_WIDTH_MM,
        "MEASURED_DIRECTION_DEG": MEASURED_DIRECTION_DEG,
        "MEASURED_MAGNITUDE_GF": MEASURED_MAGNITUDE_GF,
    },
    uses_network=False,
)
