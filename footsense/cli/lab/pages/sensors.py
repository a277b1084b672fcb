"""Study `sensors`: effect of the number of elements, on the paper's block and on the whole sensor chain.

The block is `footsense.lab.studies.accuracy.sensors`. The whole chain is a foot with 2 x 2, 3 x 3 or 4 x 4 elements,
its converters, the scan of six legs on one simulated bus, and CAN. The arrays fill the same sheet in the same ball.
Their bars are as wide as those of the foot that the study is about, or wider where larger electrodes would be beyond
the converter.
"""

import math
from dataclasses import dataclass

import msgspec
import numpy as np
from matplotlib.figure import Figure

from firmware_interface.chips import fdc1004
from firmware_interface.wire_timing import can_bits_per_s
from footsense.acquisition.bus_scanner import BusScanner
from footsense.acquisition.scan_plan import scan_plan
from footsense.acquisition.transports import UpstreamBus
from footsense.cli.lab.pages.array_networks import (
    FULL,
    QUICK,
    NetworkErrors,
    TrainingSize,
    train_and_evaluate_network,
)
from footsense.config import DEFAULT
from footsense.foot.capacitor import EPS0_PF_UM_PER_MM2, GAP_CLOSED_THRESHOLD_REL
from footsense.foot.direction_sets import direction_grid, paper_directions
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Foot
from footsense.lab.design.inputs.boards import converter
from footsense.lab.evaluation.cramer_rao import Unknowns, force_bound
from footsense.lab.fem.mesh import COARSE_MESH
from footsense.lab.geometry import FootDesign
from footsense.lab.monte_carlo.statistics import SIGNIFICANT_STANDARD_ERRORS
from footsense.lab.response import make_response
from footsense.lab.studies.accuracy import sensors as block
from footsense.lab.studies.page import Plots, Study, StudyContext
from footsense.lab.studies.plots import subplot_row
from footsense.lab.training.load_cases import FULL_SCALE_PF, NOISE_PF
from footsense.sim.robot import BusWiring, SimulatedRobot
from footsense.sim.scene_files import load_scene

#: Rows of the arrays; the quick form solves the smallest alone, the table of the foot itself being at hand.
ROWS, QUICK_ROWS = (2, 3, 4), (2,)
#: Elevations of the range [deg]: the paper's loads end at 40.
ELEVATIONS_DEG = np.array([90.0, 60.0, 40.0])
#: Azimuths of the range [deg]: the square has the rest by symmetry.
AZIMUTHS_DEG = np.array([0.0, 15.0, 30.0, 45.0])
#: Steps of the range's force over the largest load of the training, and the most that is tried [1].
STEP_REL, MOST_REL = 0.05, 5.0
#: Load of the bound over the largest load of the training [1].
CRAMER_RAO_LOAD_REL = 0.5
#: Scans of the simulated bus: every check has had its turn.
N_SIMULATED_SCANS = 18
#: Time that the host adds to a transaction [us].
HOST_COST_PER_TRANSACTION_US = 40.0
#: Steps in which an electrode's side is rounded down [mm].
_ELECTRODE_SIDE_STEP_MM = 0.05
_MUX_ADDRESS = 0x71


@dataclass(frozen=True, slots=True, kw_only=True)
class ArrayResults:
    """Predicted and measured figures of a foot with one array.

    Attributes:
        electrode_mm: Side of an electrode [mm].
        spacer_bar_width_mm: Width of the bars [mm].
        unloaded_pf: Capacitance of an unloaded element [pF].
        half_closed_pf: The same with its gap half closed [pF].
        usable_boards: Boards that read both.
        max_force_per_elevation_n: Least force over the azimuth at which a gap or the converter is at its end, at each
            elevation [N].
        six_leg_scan_ms: Time of a scan of six legs [ms].
        centred_bound_deg: Least rms direction error of one scan, known to be centred [deg].
        leaning_bound_deg: The same for five unknowns; None where there are fewer elements.
        equal_time_centred_bound_deg: As `centred_bound_deg`, if the scan takes as long as that of nine elements.
        equal_time_leaning_bound_deg: As `leaning_bound_deg`, likewise.
        half_range_bound_deg: As `leaning_bound_deg`, at half of the foot's own least range.
        equal_time_half_range_bound_deg: The same, if the scan takes as long as that of nine elements.
        leaning_bound_gf: Least rms magnitude error of one scan, five unknowns [gf]; None as above.
        network_errors: Errors of a network that was trained for it.
        can_bits_per_s: Load of the CAN bus [bit/s].
        max_electrode_mm: Side of an electrode between bars as wide as those of the foot [mm].
        max_electrode_half_closed_pf: Capacitance of such an element with its gap half closed [pF].
    """

    electrode_mm: float
    spacer_bar_width_mm: float
    unloaded_pf: float
    half_closed_pf: float
    usable_boards: list[str]
    max_force_per_elevation_n: list[float]
    six_leg_scan_ms: float
    centred_bound_deg: float
    leaning_bound_deg: float | None
    equal_time_centred_bound_deg: float
    equal_time_leaning_bound_deg: float | None
    half_range_bound_deg: float | None
    equal_time_half_range_bound_deg: float | None
    leaning_bound_gf: float | None
    network_errors: NetworkErrors
    can_bits_per_s: float
    max_electrode_mm: float
    max_electrode_half_closed_pf: float


@dataclass(frozen=True, kw_only=True)
class SensorResults(block.Results):
    """Results of the study `sensors`: errors on the block, and figures of the arrays on the whole chain.

    Attributes:
        cramer_rao_load_n: Load at which the Cramer-Rao bounds are computed [N].
        array_by_rows: Figures by rows.
    """

    cramer_rao_load_n: float
    array_by_rows: dict[int, ArrayResults]


def max_electrode_mm(reference_design: FootDesign, rows: int) -> float:
    """Return the largest electrode side [mm] of an array on the same sheet, with spacer bars of the same width."""
    return (
        reference_design.array_side_mm
        - (rows - 1) * (reference_design.pitch_mm - reference_design.electrode_mm)
    ) / rows


def array_design(reference_design: FootDesign, rows: int) -> FootDesign:
    """Return a foot with another array on the same sheet, electrodes limited by bar width or converter range.

    Args:
        reference_design: The foot.
        rows: Rows of elements, and as many columns.
    """
    if rows == reference_design.rows:
        return reference_design
    half_open_um = 0.5 * reference_design.gap_um + reference_design.capacitor.film_equivalent_um
    read_mm = math.sqrt(fdc1004.capacitance_pf(fdc1004.CODE_MAX) * half_open_um / EPS0_PF_UM_PER_MM2)
    electrode_mm = _ELECTRODE_SIDE_STEP_MM * math.floor(
        min(max_electrode_mm(reference_design, rows), read_mm) / _ELECTRODE_SIDE_STEP_MM + 1e-9
    )
    pitch_mm = (reference_design.array_side_mm - electrode_mm) / (rows - 1)
    return msgspec.structs.replace(reference_design, rows=rows, electrode_mm=electrode_mm, pitch_mm=pitch_mm)


def six_leg_scan_ms(response: FootResponse) -> float:
    """Return the scan time of six legs on one I2C bus at 400 kHz with board `fdc1004` [ms]."""
    scene = msgspec.structs.replace(load_scene("hanging"), host_cost_us=HOST_COST_PER_TRANSACTION_US)
    channels = {leg: channel for channel, leg in enumerate(DEFAULT.legs)}
    [bus] = SimulatedRobot(scene, response, [BusWiring(400_000, _MUX_ADDRESS, channels)]).buses
    plan = scan_plan(DEFAULT.conversion_order, DEFAULT.rate_sps, rows=response.rows)
    scanner = BusScanner(UpstreamBus(bus, _MUX_ADDRESS), bus.clock, channels, plan)
    scanner.start()
    scanner.read_next_element()
    start_ns = bus.clock.now_ns()
    for _ in range(N_SIMULATED_SCANS * response.n_elements):
        scanner.read_next_element()
    return (bus.clock.now_ns() - start_ns) * 1e-6 / N_SIMULATED_SCANS


def max_force_per_elevation_n(foot: Foot, max_n: float) -> list[float]:
    """Return the force at which a gap or the converter's range ends, least over azimuth, per elevation [N]."""
    direction = direction_grid(AZIMUTHS_DEG, ELEVATIONS_DEG)
    design = foot.response.design
    reached = np.full(len(direction), MOST_REL * max_n)
    for force_n in np.arange(MOST_REL, 0.0, -STEP_REL) * max_n:
        pf = foot.capacitance_pf(direction, force_n * direction)
        closure_um = design.closure_um(pf, foot.unloaded_pf).max(axis=1)
        reached[
            (closure_um > GAP_CLOSED_THRESHOLD_REL * design.gap_um) | (pf.max(axis=1) > FULL_SCALE_PF)
        ] = force_n
    least: list[float] = reached.reshape(len(AZIMUTHS_DEG), -1).min(axis=0).round(3).tolist()
    return least


def _rms_bounds(foot: Foot, load_n: float, noise_pf: float) -> tuple[float, float | None, float | None]:
    """Return the rms Cramer-Rao bounds over the test directions: centred [deg], leaning [deg], leaning [gf]."""
    direction = paper_directions("verification")
    force_n = load_n * direction
    centred = force_bound(foot, direction, force_n, Unknowns.CENTRED, noise_pf=noise_pf)
    centred_bound_deg = float(np.sqrt(np.mean(centred.direction_rms_deg**2)))
    if foot.response.n_elements < Unknowns.LEANING.value:
        return centred_bound_deg, None, None
    leaning = force_bound(foot, direction, force_n, Unknowns.LEANING, noise_pf=noise_pf)
    deg, gf = (
        float(np.sqrt(np.mean(error**2))) for error in (leaning.direction_rms_deg, leaning.magnitude_rms_gf)
    )
    return centred_bound_deg, deg, gf


def evaluate_array(
    reference_design: FootDesign, design: FootDesign, response: FootResponse, training: TrainingSize
) -> ArrayResults:
    """Return all figures of a foot with one array.

    Args:
        reference_design: The foot that the study is about.
        design: The foot with this array.
        response: Its response.
        training: Sizes of the training of its network.
    """
    foot, max_n, capacitor = Foot(response), design.loads.max_n, design.capacitor
    half_pf = float(capacitor.capacitance_pf(np.array([0.5 * design.gap_um]))[0])
    widest = max_electrode_mm(reference_design, response.rows)
    boards = [converter(name) for name in ("fdc1004", "ad7746")]
    # As long a scan as of nine elements leaves each conversion another share of the time; the noise is white.
    same_time_pf = NOISE_PF * math.sqrt(response.n_elements / 9.0)
    centred_bound_deg, leaning_bound_deg, leaning_bound_gf = _rms_bounds(
        foot, CRAMER_RAO_LOAD_REL * max_n, NOISE_PF
    )
    same_centred_deg, same_leaning_deg, _ = _rms_bounds(foot, CRAMER_RAO_LOAD_REL * max_n, same_time_pf)
    max_force_n = max_force_per_elevation_n(foot, max_n)
    own_deg, same_own_deg = (
        _rms_bounds(foot, CRAMER_RAO_LOAD_REL * min(max_force_n), pf)[1] for pf in (NOISE_PF, same_time_pf)
    )
    return ArrayResults(
        electrode_mm=design.electrode_mm,
        spacer_bar_width_mm=design.pitch_mm - design.electrode_mm,
        unloaded_pf=capacitor.unloaded_pf,
        half_closed_pf=half_pf,
        usable_boards=[
            b.name for b in boards if b.min_unloaded_pf <= capacitor.unloaded_pf and half_pf <= b.range_end_pf
        ],
        max_force_per_elevation_n=max_force_n,
        six_leg_scan_ms=six_leg_scan_ms(response),
        centred_bound_deg=centred_bound_deg,
        leaning_bound_deg=leaning_bound_deg,
        equal_time_centred_bound_deg=same_centred_deg,
        equal_time_leaning_bound_deg=same_leaning_deg,
        half_range_bound_deg=own_deg,
        equal_time_half_range_bound_deg=same_own_deg,
        leaning_bound_gf=leaning_bound_gf,
        network_errors=train_and_evaluate_network(response, design.loads, training),
        can_bits_per_s=can_bits_per_s(len(DEFAULT.legs), DEFAULT.forces_hz),
        max_electrode_mm=widest,
        max_electrode_half_closed_pf=half_pf * widest**2 / design.electrode_mm**2,
    )


def evaluate_arrays(context: StudyContext) -> dict[int, ArrayResults]:
    """Return the results of every array by its number of rows, after solving the foot on the coarse mesh."""
    arrays, training = {}, QUICK if context.quick else FULL
    for rows in QUICK_ROWS if context.quick else ROWS:
        design = array_design(context.foot_design, rows)
        arrays[rows] = evaluate_array(
            context.foot_design, design, make_response(design, COARSE_MESH), training
        )
        context.report_progress(f"sensors: {rows} x {rows} elements on the whole chain")
    if context.quick:
        arrays[context.foot_design.rows] = evaluate_array(
            context.foot_design, context.foot_design, context.response, training
        )
    return arrays


def error_bound_and_force_range_figure(arrays: dict[int, ArrayResults]) -> Figure:
    """Return the figure of least direction error and largest force over the number of elements."""
    drawing, (error, reach) = subplot_row(2, 8.2, 3.6)
    number = [rows**2 for rows in arrays]
    lines = (
        ("centred_bound_deg", "o-C0", "centred, 400 conversions/s"),
        ("equal_time_centred_bound_deg", "o:C0", "centred, same time of a scan"),
        ("leaning_bound_deg", "s-C3", "leaning, 400 conversions/s"),
        ("equal_time_leaning_bound_deg", "s:C3", "leaning, same time of a scan"),
    )
    for name, style, label in lines:
        values = [getattr(one, name) for one in arrays.values()]
        error.plot(number, [np.nan if value is None else value for value in values], style, label=label)
    error.set(xlabel="elements", ylabel="least rms direction error [deg]", ylim=(0.0, None))
    error.legend(fontsize=8)
    for place, elevation in enumerate(ELEVATIONS_DEG):
        reach.plot(
            number,
            [one.max_force_per_elevation_n[place] for one in arrays.values()],
            "o-",
            label=f"{elevation:g} deg",
        )
    reach.set(xlabel="elements", ylabel="largest force [N]", ylim=(0.0, None))
    reach.legend(fontsize=8, title="elevation")
    for axes in (error, reach):
        axes.set_xticks(number)
        axes.minorticks_off()
    return drawing


def compute(context: StudyContext) -> tuple[SensorResults, Plots]:
    """Return the errors of every sensor on the block, and the figures of every array on the foot."""
    on_block, plots = block.compute(context)
    arrays = evaluate_arrays(context)
    bound_load_n = CRAMER_RAO_LOAD_REL * context.foot_design.loads.max_n
    results = SensorResults(**vars(on_block), cramer_rao_load_n=bound_load_n, array_by_rows=arrays)
    return results, plots | {"sensors-arrays.png": error_bound_and_force_range_figure(arrays)}


STUDY = Study(
    name="sensors",
    title="How many elements, and how large",
    compute=compute,
    template_names=vars(block) | {"SIGNIFICANT_STANDARD_ERRORS": SIGNIFICANT_STANDARD_ERRORS},
    uses_network=False,
)
