"""Study `cramer-rao`: network error over the least error that any unbiased estimator can reach."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from footsense.foot.directions import angles_between_deg, direction_grid, normalized, paper_directions
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.specimen import Foot
from footsense.frames import Vector
from footsense.lab.evaluation.bound_ratio import (
    MAGNITUDES_GF,
    BoundComparison,
    ErrorsAtMagnitude,
    compare_with_cramer_rao_bound,
    leaning_contacts,
)
from footsense.lab.evaluation.cramer_rao import Unknowns, force_bound
from footsense.lab.evaluation.evaluate import rms
from footsense.lab.evaluation.maximum_likelihood import (
    AZIMUTH_DEG,
    Fit,
    ambiguous_load_distance_and_angle,
    clamp_to_min_elevation,
    maximum_likelihood,
)
from footsense.lab.former_page import Plots, Study, StudyContext
from footsense.lab.plots import subplot_row
from footsense.lab.training.load_cases import (
    BASELINE_NOISE_PF,
    NOISE_PF,
    measured_closure_rel,
    sensed_closure_um,
)

#: The project's target of the network's error over the bound [1].
TARGET_CRB_RATIO = 1.2
#: Magnitude of the map [gf], and those of the search for ambiguous loads.
MAP_GF, AMBIGUOUS_GF = 100.0, (20.0, 50.0, 100.0, 150.0)
#: Elevations of the centred loads that the search takes [deg].
AMBIGUITY_ELEVATIONS_DEG = np.arange(40.0, 49.01, 0.5)
#: Rounds of Gauss-Newton after which the fit is evaluated.
GAUSS_NEWTON_ITERATIONS = (1, 2, 4, 12)
#: Largest misfit of an explained scan: of right fits one in twenty thousand has more.
MAX_EXPLAINED_MISFIT = 5.0


@dataclass(frozen=True, slots=True)
class GaussNewtonResult:
    """Force errors after a number of Gauss-Newton rounds, relative to the bound.

    Attributes:
        explained_share: Share of the scans with a misfit below `MAX_EXPLAINED_MISFIT` [1].
        ratio: Rms angle of the explained scans over the bound's [1].
    """

    explained_share: float
    ratio: float


@dataclass(frozen=True, slots=True)
class Ambiguity:
    """Closure distance [noise sigmas] and angle between forces [deg] of ambiguous load pairs, by elevation.

    Attributes:
        distance_in_noise_sigmas: Distance of the closures in standard deviations of the noise.
        angle_between_forces_deg: Angle between the two forces [deg].
    """

    distance_in_noise_sigmas: list[float]
    angle_between_forces_deg: list[float]


@dataclass(frozen=True, kw_only=True)
class Results:
    """Results of the study `cramer-rao`: errors of network and Gauss-Newton relative to the bound, ambiguous loads.

    Attributes:
        crb_ratio_by_magnitude: The network beside the bound.
        crb_ratio: The headline: direction error over the bound's in the worst bin of centred loads [1].
        training_centred_share: Share of centred loads in the network's training [1].
        noiseless_direction_rms_deg: The network's own error [deg], at each magnitude of the ratio.
        gauss_newton: After each of `GAUSS_NEWTON_ITERATIONS`, by kind and magnitude of the loads.
        map_direction_bound_range_deg: Smallest and largest bound on the map [deg].
        ambiguity_by_magnitude: By magnitude [gf].
    """

    crb_ratio_by_magnitude: BoundComparison
    crb_ratio: float
    training_centred_share: float
    noiseless_direction_rms_deg: list[float]
    gauss_newton: dict[str, list[GaussNewtonResult]]
    map_direction_bound_range_deg: tuple[float, float]
    ambiguity_by_magnitude: dict[str, Ambiguity]


def gauss_newton_results(
    context: StudyContext, contacts: tuple[Vector, Vector], magnitude_gf: float, draws: int
) -> list[GaussNewtonResult]:
    """Return direction errors relative to the bound after each of the listed counts of Gauss-Newton iterations.

    Args:
        context: Foot and network.
        contacts: Contact normals and directions of force, shapes (n, 3).
        magnitude_gf: Magnitude [gf].
        draws: Draws of the noise per load.
    """
    foot, design = Foot(context.response), context.response.design
    normal, force = contacts[0], contacts[1] * magnitude_gf * GRAM_FORCE_N
    bound_deg = np.tile(force_bound(foot, normal, force, Unknowns.LEANING).direction_rms_deg, draws)
    closure_um = np.tile(sensed_closure_um(foot, normal, force), (draws, 1))
    measured = measured_closure_rel(design, closure_um, np.random.default_rng(2))
    guess, force = context.network.force_n(measured), np.tile(force, (draws, 1))
    fit = Fit(clamp_to_min_elevation(normalized(guess)), guess, np.zeros(len(guess)))
    after = []
    for more in np.diff([0, *GAUSS_NEWTON_ITERATIONS]).tolist():
        fit = maximum_likelihood(foot, measured * design.gap_um, (fit.normal, fit.force_n), more)
        good = fit.misfit_sigmas < MAX_EXPLAINED_MISFIT
        angle_deg = angles_between_deg(force, fit.force_n)
        ratio = rms(angle_deg[good]) / rms(bound_deg[good]) if good.any() else float("nan")
        after.append(GaussNewtonResult(float(good.mean()), ratio))
    return after


def _noiseless_direction_error_deg(context: StudyContext, magnitude_gf: float) -> float:
    """Return the network's rms direction error without noise on the verification directions [deg]."""
    direction = paper_directions("verification")
    closure_um = sensed_closure_um(Foot(context.response), direction, direction * magnitude_gf * GRAM_FORCE_N)
    estimate = context.network.force_n(closure_um / context.response.design.gap_um)
    return rms(angles_between_deg(direction, estimate))


def compute(context: StudyContext) -> tuple[Results, Plots]:
    """Return errors of the network and of Gauss-Newton fits relative to the Cramer-Rao bound, with figures."""
    quick, foot, loads = context.quick, Foot(context.response), context.foot_design.loads
    magnitudes, draws = ((20.0, 50.0, 100.0), 8) if quick else (MAGNITUDES_GF, 64)
    ratio = compare_with_cramer_rao_bound(
        context.response, loads, context.network.force_n, draws=draws, magnitudes_gf=magnitudes
    )
    context.report_progress(
        f"cramer-rao: the network is at {ratio.worst_centred_direction_error_ratio:.2f} of the bound in its worst bin"
    )
    straight = paper_directions("verification")
    leaning = leaning_contacts(loads, np.random.default_rng(3), 600)
    tried = [("centred", (straight, straight), gf) for gf in (AMBIGUOUS_GF[:1] if quick else AMBIGUOUS_GF)]
    tried += [] if quick else [("leaning", leaning, gf) for gf in AMBIGUOUS_GF[:2]]
    gauss_newton = {
        f"{what}, {gf:g}": gauss_newton_results(context, where, gf, 1 if quick else 4)
        for what, where, gf in tried
    }
    context.report_progress("cramer-rao: maximum likelihood compared with the bound")
    ambiguous = {}
    for gf in AMBIGUOUS_GF[: 2 if quick else 4]:
        distance, apart_deg = ambiguous_load_distance_and_angle(foot, gf, AMBIGUITY_ELEVATIONS_DEG)
        ambiguous[f"{gf:g}"] = Ambiguity(distance.tolist(), apart_deg.tolist())
    steps = 11 if quick else 37
    azimuth, elevation = np.linspace(0.0, 360.0, 4 * steps + 1), np.linspace(30.0, 90.0, steps)
    direction = direction_grid(azimuth, elevation)
    bound = force_bound(
        foot, direction, direction * MAP_GF * GRAM_FORCE_N, Unknowns.LEANING
    ).direction_rms_deg
    results = Results(
        crb_ratio_by_magnitude=ratio,
        crb_ratio=ratio.worst_centred_direction_error_ratio,
        training_centred_share=loads.centred_share,
        noiseless_direction_rms_deg=[_noiseless_direction_error_deg(context, gf) for gf in magnitudes],
        gauss_newton=gauss_newton,
        map_direction_bound_range_deg=(bound.min(), bound.max()),
        ambiguity_by_magnitude=ambiguous,
    )
    drawing = _bound_map_figure(azimuth, elevation, bound.reshape(len(azimuth), steps), ambiguous)
    return results, {"cramer-rao.png": _error_and_bound_figure(ratio.centred), "cramer-rao-map.png": drawing}


def _error_and_bound_figure(bins: Sequence[ErrorsAtMagnitude]) -> Figure:
    """Return the figure of network error and bound over the force magnitude, centred loads."""
    figure, row = subplot_row(2, 8.6, 3.9)
    gf = [one.magnitude_gf for one in bins]
    quantities = (
        ("direction_rms_deg", "rms direction error [deg]"),
        ("magnitude_rms_gf", "rms magnitude error [gf]"),
    )
    for axes, (name, label) in zip(row, quantities, strict=True):
        network, five, three = (
            np.array([getattr(getattr(one, of), name) for one in bins])
            for of in ("estimator_errors", "bound_five_unknowns", "bound_three_unknowns")
        )
        axes.loglog(gf, network, "o-C3", label="network")
        axes.loglog(gf, TARGET_CRB_RATIO * five, ":k", label=f"target, {TARGET_CRB_RATIO:g} of the bound")
        axes.loglog(gf, five, "s-C0", label="bound, five unknowns")
        axes.loglog(gf, three, "^--C2", label="bound, known to be centred")
        axes.set(xlabel="force [gf]", ylabel=label)
        axes.set_xticks(gf, [f"{g:g}" for g in gf])
        axes.minorticks_off()
    row[0].legend(fontsize=8)
    return figure


def _bound_map_figure(
    azimuth: Vector, elevation: Vector, bound_deg: Vector, ambiguous: dict[str, Ambiguity]
) -> Figure:
    """Return the figure of a ball map of the bound, and of the distance to ambiguous loads over the elevation."""
    figure = Figure(figsize=(9.2, 4.1), layout="constrained")
    polar = figure.add_subplot(1, 2, 1, projection="polar")
    filled = polar.contourf(np.radians(azimuth), 90.0 - elevation, bound_deg.T, levels=16, cmap="viridis")
    polar.set_yticks([15.0, 30.0, 45.0, 60.0], ["75", "60", "45", "30 deg"], color="w", fontsize=8)
    polar.set_title(f"bound of the direction at {MAP_GF:g} gf, rms", fontsize=10)
    figure.colorbar(filled, ax=polar, label="[deg]", shrink=0.8)
    axes = figure.add_subplot(1, 2, 2)
    for gf, found in ambiguous.items():
        axes.semilogy(
            AMBIGUITY_ELEVATIONS_DEG, np.maximum(found.distance_in_noise_sigmas, 0.1), ".-", label=f"{gf} gf"
        )
    axes.axhline(4.0, color="k", ls=":", lw=1)
    axes.set(
        xlabel=f"elevation of a centred load, azimuth {AZIMUTH_DEG:g} deg [deg]",
        ylabel="distance of its ambiguous load [standard deviations]",
    )
    axes.legend(fontsize=8)
    axes.grid(alpha=0.3)
    return figure


STUDY = Study(
    name="cramer-rao",
    title="The Cramer-Rao bound",
    compute=compute,
    template_names={"BASELINE_NOISE_PF": BASELINE_NOISE_PF, "NOISE_PF": NOISE_PF},
)
