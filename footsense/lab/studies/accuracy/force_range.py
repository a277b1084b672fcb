"""Study `force-range`: largest measurable force by direction, and the leg state that larger forces produce.

With growing force a gap begins to close at its middle, reads as closed, or the converter ends. Where gaps are closed in
part, different loads have nearly the same closures: an ambiguous region, in which the network is used, too.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from footsense.estimation.calibrated_feet import CalibratedFeet
from footsense.estimation.elements import ConsistencyTest
from footsense.estimation.missing_elements import Imputation
from footsense.estimation.network import steady_windows
from footsense.foot.capacitor import GAP_CLOSED_THRESHOLD_REL
from footsense.foot.directions import angles_between_deg, direction_grid, random_directions
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.gap_contact import N_CELLS
from footsense.foot.network_card import TrainedInputs
from footsense.foot.parameters import FootParameters
from footsense.foot.specimen import Deviations, Foot
from footsense.frames import Mask, Vector
from footsense.lab.former_page import Plots, Study, StudyContext
from footsense.lab.training.load_cases import FULL_SCALE_PF, leaning_normals
from footsense.sim.fabrication import PAPER_TOLERANCES, draw_deviations

#: Azimuths over an eighth of the square, elevations [deg] and forces of the map [N].
AZIMUTHS_DEG, ELEVATIONS_DEG = (0.0, 15.0, 30.0, 45.0), tuple(float(e) for e in range(35, 91, 5))
_FORCE_STEP_N = 0.02
#: Borders of the bands of the largest closure over the element's real gap [1].
CLOSURE_BAND_EDGES_REL = (0.0, 0.5, 0.7, 0.8, 0.9, GAP_CLOSED_THRESHOLD_REL, np.inf)
#: Feet made like the paper's, loads of each, their lowest elevation [deg] and the seed.
_FEET, _QUICK_FEET, _LOADS, _MIN_ELEVATION_DEG, _SEED = 20, 1, 600, 32.0, 8
#: Lower border of the ambiguous region [1], and an error that is too large to be used [deg].
AMBIGUOUS_REL, TOO_LARGE_DEG = 0.8, 5.0
_FIGURE_FILE = "force-range.png"


@dataclass(frozen=True, kw_only=True)
class ClosureBandErrors:
    """Errors of the loads whose largest relative closure lies in one band.

    Attributes:
        share_of_loads: Of all loads [1].
        mean_force_gf: Mean force [gf].
        readable_share: Share of them with a force [1].
        mean_direction_error_deg: Mean direction error of those [deg].
        direction_error_p95_deg: 95th percentile [deg].
        median_sigma_deg: Median sigma as an angle [deg].
        within_2_sigma_share: Share of the components within two sigma [1].
        large_direction_error_share: Share with an error above `TOO_LARGE_DEG` [1].
        reported_large_error_share: Share of these that the residual test finds inconsistent [1]; None without any.
    """

    share_of_loads: float
    mean_force_gf: float
    readable_share: float
    mean_direction_error_deg: float = 0.0
    direction_error_p95_deg: float = 0.0
    median_sigma_deg: float = 0.0
    within_2_sigma_share: float = 0.0
    large_direction_error_share: float = 0.0
    reported_large_error_share: float | None = None


@dataclass(frozen=True, kw_only=True)
class ForceRangeResults:
    """Results of the study `force-range`: force limits under centred loads, errors by closure band.

    Attributes:
        force_limits_n: By limit (`contact`, `closed`, `saturated`): lowest force of it over the elevations [N], the
            smallest over the azimuths.
        n_fabricated_feet: Feet made like the paper's.
        max_training_force_n: Largest force of the network's training [N].
        on_designed_foot: Errors of the designed foot, in the order of the bands.
        on_fabricated_feet: Errors of made feet whose parameters are known exactly.
    """

    force_limits_n: dict[str, list[float]]
    n_fabricated_feet: int
    max_training_force_n: float
    on_designed_foot: list[ClosureBandErrors | None]
    on_fabricated_feet: list[ClosureBandErrors | None]


def _force_limits_n(foot: Foot, max_n: float) -> dict[str, Vector]:
    """Return the lowest force that reaches each limit [N], (azimuths, elevations); 2 `max_n` where never reached."""
    direction = direction_grid(AZIMUTHS_DEG, ELEVATIONS_DEG)
    design = foot.response.design
    reached = {name: np.full(len(direction), 2.0 * max_n) for name in ("contact", "closed", "saturated")}
    for force_n in np.arange(_FORCE_STEP_N, 2.0 * max_n, _FORCE_STEP_N)[::-1]:
        loads_n = force_n * direction
        free_um = foot.response.free_closure_um(direction, loads_n).reshape(-1, N_CELLS)
        pf = foot.capacitance_pf(direction, loads_n)
        closure_um = design.closure_um(pf, foot.unloaded_pf).max(axis=1)
        for name, beyond in (
            ("contact", free_um.max(axis=1) > design.gap_um),
            ("closed", closure_um > GAP_CLOSED_THRESHOLD_REL * design.gap_um),
            ("saturated", pf.max(axis=1) > FULL_SCALE_PF),
        ):
            reached[name][beyond] = force_n
    shape = (len(AZIMUTHS_DEG), len(ELEVATIONS_DEG))
    return {name: force.reshape(shape) for name, force in reached.items()}


def _estimate_loads_on_foot(
    context: StudyContext, trained: TrainedInputs, deviations: Deviations, normal: Vector, force_n: Vector
) -> tuple[Vector, Mask, Vector, Vector, Mask]:
    """Return for loads on a foot: relative closure, readable mask, force [N], sigma [N], inconsistent mask."""
    foot, design = Foot(context.response, deviations), trained.design
    gap_um = np.broadcast_to(design.gap_um + deviations.gap_um, foot.unloaded_pf.shape)
    known = FootParameters(
        stray_pf=np.broadcast_to(deviations.stray_pf, gap_um.shape),
        unloaded_pf=foot.unloaded_pf,
        gap_um=gap_um,
        stiffness_rel=deviations.stiffness_rel,
        mount=deviations.mount,
    )
    pf = foot.capacitance_pf(normal, force_n)
    closure_um = design.closure_um(pf - deviations.stray_pf, foot.unloaded_pf - deviations.stray_pf)
    closure_rel = closure_um / design.gap_um
    read = (closure_rel <= trained.max_usable_closure_rel(gap_um)).all(axis=1) & (
        pf.max(axis=1) < FULL_SCALE_PF
    )
    inputs = np.where(read[:, None], closure_rel, 0.0)
    load = CalibratedFeet(context.network, [known] * len(pf)).estimate(steady_windows(inputs))
    test = ConsistencyTest(len(pf), Imputation(trained.moments), 1)
    none, still = np.zeros(inputs.shape, bool), np.zeros(len(pf))
    result: Any = None
    for t_ns in range(4):
        result = test.test(inputs, still, none, t_ns)
    said = test.unexplained_legs | result.missing.any(axis=1)
    return (closure_um / gap_um).max(axis=1), read, load.force_n, load.sigma_n, said


def _band_errors(in_band: Mask, parts: tuple[Any, ...]) -> ClosureBandErrors | None:
    """Return the errors of the loads in one closure band; None if it holds no load."""
    if not in_band.any():
        return None
    read, true_n, force_n, sigma_n, said = (part[in_band] for part in parts)
    size_n = np.linalg.norm(true_n, axis=1)
    known = np.flatnonzero(read)
    share, mean_force_gf = float(in_band.mean()), float(size_n.mean() / GRAM_FORCE_N)
    if len(known) == 0:
        return ClosureBandErrors(share_of_loads=share, mean_force_gf=mean_force_gf, readable_share=0.0)
    angle_deg = angles_between_deg(true_n[known], force_n[known])
    sigma_deg = np.degrees(np.linalg.norm(sigma_n[known], axis=1) / size_n[known])
    large = angle_deg > TOO_LARGE_DEG
    return ClosureBandErrors(
        share_of_loads=share,
        mean_force_gf=mean_force_gf,
        readable_share=len(known) / len(read),
        mean_direction_error_deg=float(angle_deg.mean()),
        direction_error_p95_deg=float(np.percentile(angle_deg, 95)),
        median_sigma_deg=float(np.median(sigma_deg)),
        within_2_sigma_share=float((np.abs(force_n - true_n) <= 2.0 * sigma_n)[known].mean()),
        large_direction_error_share=float(large.mean()),
        reported_large_error_share=float(said[known][large].mean()) if large.any() else None,
    )


def _errors_by_band(context: StudyContext, feet: list[Deviations]) -> list[ClosureBandErrors | None]:
    """Return the errors in each closure band, over random leaning loads on several feet."""
    loads, trained = context.foot_design.loads, context.trained_inputs
    rng = np.random.default_rng(_SEED)
    collected: list[tuple[Any, ...]] = []
    for deviations in feet:
        direction = random_directions(rng, 2 * _LOADS, _MIN_ELEVATION_DEG)
        normal = leaning_normals(loads, rng, direction)
        reached = np.flatnonzero(normal[:, 2] >= np.sin(np.radians(_MIN_ELEVATION_DEG)))[:_LOADS]
        force_n = direction[reached] * rng.uniform(0.1 * loads.max_n, loads.max_n, (len(reached), 1))
        rel, read, estimate_n, sigma_n, said = _estimate_loads_on_foot(
            context, trained, deviations, normal[reached], force_n
        )
        collected.append((rel, read, force_n, estimate_n, sigma_n, said))
    rel, *parts = (np.concatenate(part) for part in zip(*collected, strict=True))
    return [
        _band_errors((rel >= low) & (rel < high), tuple(parts))
        for low, high in pairwise(CLOSURE_BAND_EDGES_REL)
    ]


def _figure(limits_n: dict[str, Vector], max_n: float) -> Figure:
    """Return the figure of the force limits over elevation, as bands over the azimuths."""
    figure = Figure(figsize=(7.5, 4.2), layout="constrained")
    axes = figure.subplots()
    words = {
        "contact": "a gap begins to close",
        "closed": "a gap reads as closed",
        "saturated": "converter at its end",
    }
    for name, label in words.items():
        low, high = limits_n[name].min(axis=0), limits_n[name].max(axis=0)
        axes.fill_between(ELEVATIONS_DEG, low, high, alpha=0.4, label=label)
    axes.axhline(max_n, color="k", ls=":", label="largest force of the training")
    axes.set(xlabel="elevation of a centred force [deg]", ylabel="force [N]", ylim=(0.0, 1.5 * max_n))
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    return figure


def compute(context: StudyContext) -> tuple[ForceRangeResults, Plots]:
    """Return the force limits of the designed foot, and errors by closure on it and on fabricated feet, with figure."""
    loads = context.foot_design.loads
    limits_n = _force_limits_n(Foot(context.response), loads.max_n)
    feet = _QUICK_FEET if context.quick else _FEET
    made = [draw_deviations(context.response, PAPER_TOLERANCES, _SEED, number) for number in range(feet)]
    results = ForceRangeResults(
        force_limits_n={
            name: [round(float(v), 2) for v in force.min(axis=0)] for name, force in limits_n.items()
        },
        n_fabricated_feet=feet,
        max_training_force_n=loads.max_n,
        on_designed_foot=_errors_by_band(context, [Deviations()] * feet),
        on_fabricated_feet=_errors_by_band(context, made),
    )
    context.report_progress(
        f"force-range: a gap begins to close at {min(results.force_limits_n['contact']):.2f} N"
    )
    return results, {_FIGURE_FILE: _figure(limits_n, loads.max_n)}


STUDY = Study(name="force-range", title="The force that a foot can tell", compute=compute)
