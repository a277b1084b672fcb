"""Study `limit`: how well nine noisy capacitances can know the force at all, and how near the network comes."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from footsense.foot.specimen import Foot
from footsense.lab.evaluation.cramer_rao import (
    MAGNITUDES_GF,
    CrbRatio,
    Rung,
    Unknowns,
    closure_sigma_um,
    crb_ratio,
    force_bound,
    jacobian_um,
    leaning_contacts,
    tangents,
    verification_directions,
)
from footsense.lab.studies.page import Page, StudyContext, table
from footsense.lab.training.load_cases import (
    BASELINE_NOISE_PF,
    GRAM_FORCE_N,
    NOISE_PF,
    directions,
    measured_closure_rel,
    sensed_closure_um,
)

Vector = NDArray[np.float64]

#: Network error over the bound that the project aims at [1].
TARGET_RATIO = 1.2
#: Magnitude that the map is drawn for [gf], and those of the search for twins.
MAP_GF, TWIN_GF = 100.0, (20.0, 50.0, 100.0, 150.0)
#: A twin of a centred load on the diagonal: azimuth and elevations where it is looked for, and where it starts [deg].
TWIN_AZIMUTH_DEG, TWIN_ELEVATIONS_DEG = 45.0, np.arange(40.0, 49.01, 0.5)
TWIN_START_DEG, TWIN_CONTACT_DEG = (225.0, 50.0), (225.0, 57.0)
#: Rounds of Gauss-Newton after which the fit is judged.
ROUNDS = (1, 2, 4, 12)
#: A scan counts as explained from this misfit down: of right fits one in twenty thousand has more.
EXPLAINED = 5.0
#: Largest step of a Gauss-Newton round, of the force relative to itself and of the normal [rad].
_LONGEST_STEP = 0.2
#: Elevation that no contact normal may be moved below [deg], so that differences stay within the table.
_LOWEST_DEG = 26.0

_CURVES, _MAP = "limit.png", "limit-map.png"


class Fit(NamedTuple):
    """Loads that explain measured closures best, near where the search began.

    Attributes:
        normal: Contact normals, shape (n, 3).
        force_n: Forces [N], shape (n, 3).
        misfit: Distance left between measured and explained closures, in their standard deviations, shape (n,).
    """

    normal: Vector
    force_n: Vector
    misfit: Vector


def maximum_likelihood(foot: Foot, closure_um: Vector, start: tuple[Vector, Vector], rounds: int = 8) -> Fit:
    """Fit force and contact normal to measured closures, by Gauss-Newton steps of limited length.

    Args:
        foot: The specimen.
        closure_um: Measured closures [um], shape (n, 9).
        start: Contact normals and forces [N] to begin with, shapes (n, 3).
        rounds: Steps.
    """
    design, lowest = foot.response.design, np.sin(np.radians(_LOWEST_DEG))
    normal, force = start
    for _ in range(rounds):
        explained = sensed_closure_um(foot, normal, force)
        sigma = closure_sigma_um(design, explained)[..., None]
        slope = jacobian_um(foot, normal, force, Unknowns.LEANING) / sigma
        step = (np.linalg.pinv(slope) @ ((closure_um - explained)[..., None] / sigma))[..., 0]
        step *= np.minimum(
            1.0, _LONGEST_STEP / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-12)
        )
        turned = normal + np.einsum("na,nai->ni", step[:, 3:], tangents(normal))
        force = force + np.linalg.norm(force, axis=1, keepdims=True) * step[:, :3]
        normal = _kept_above(turned / np.linalg.norm(turned, axis=1, keepdims=True), lowest)
    explained = sensed_closure_um(foot, normal, force)
    misfit = np.linalg.norm((closure_um - explained) / closure_sigma_um(design, explained), axis=1)
    return Fit(normal, force, misfit)


def _kept_above(normal: Vector, lowest_z: float) -> Vector:
    """Return unit vectors, those below a height lifted to it."""
    z = np.maximum(normal[:, 2:], lowest_z)
    flat = np.linalg.norm(normal[:, :2], axis=1, keepdims=True)
    return np.concatenate([normal[:, :2] * np.sqrt(1.0 - z**2) / np.maximum(flat, 1e-12), z], axis=1)


def _angle_deg(force: Vector, other: Vector) -> Vector:
    """Return the angles between vectors [deg], shape (n,)."""
    sine = np.linalg.norm(np.cross(force, other), axis=-1)
    angle: Vector = np.degrees(np.arctan2(sine, (force * other).sum(axis=-1)))
    return angle


def twins_of(foot: Foot, magnitude_gf: float, elevation_deg: Vector) -> tuple[Vector, Vector]:
    """Return how far the closures of centred loads on the diagonal are from those of a quite different load.

    Args:
        foot: The specimen.
        magnitude_gf: Magnitude of the centred loads [gf].
        elevation_deg: Their elevations [deg], shape (n,).

    Returns:
        Distance in standard deviations of the noise, and angle between the two forces [deg], shapes (n,).
    """
    alike = np.ones_like(elevation_deg)
    direction = directions(TWIN_AZIMUTH_DEG * alike, elevation_deg)
    force = direction * magnitude_gf * GRAM_FORCE_N
    other = directions(TWIN_START_DEG[0] * alike, TWIN_START_DEG[1] * alike)
    normal = directions(TWIN_CONTACT_DEG[0] * alike, TWIN_CONTACT_DEG[1] * alike)
    start = (normal, other * 0.88 * magnitude_gf * GRAM_FORCE_N)
    fit = maximum_likelihood(foot, sensed_closure_um(foot, direction, force), start, rounds=25)
    return fit.misfit, _angle_deg(force, fit.force_n)


def refined(
    context: StudyContext, contacts: tuple[Vector, Vector], magnitude_gf: float, draws: int
) -> list[tuple[float, float]]:
    """Return what becomes of the network's estimate after `ROUNDS` of Gauss-Newton.

    Args:
        context: Foot and network.
        contacts: Contact normals and directions of force, shapes (n, 3).
        magnitude_gf: Magnitude [gf].
        draws: Draws of the noise per load.

    Returns:
        For each number of rounds the share of the scans that are explained to within `EXPLAINED`, and the rms angle of
        those over the bound's.
    """
    foot, design = Foot(context.response), context.response.design
    normal, force = contacts[0], contacts[1] * magnitude_gf * GRAM_FORCE_N
    bound_deg = np.tile(force_bound(foot, normal, force, Unknowns.LEANING).direction_rms_deg, draws)
    closure_um = np.tile(sensed_closure_um(foot, normal, force), (draws, 1))
    seen = measured_closure_rel(design, closure_um, np.random.default_rng(2))
    guess, force = context.network.force_n(seen), np.tile(force, (draws, 1))
    begin = _kept_above(guess / np.linalg.norm(guess, axis=1, keepdims=True), np.sin(np.radians(_LOWEST_DEG)))
    fit = Fit(begin, guess, np.zeros(len(guess)))
    found = []
    for more in np.diff([0, *ROUNDS]).tolist():
        fit = maximum_likelihood(foot, seen * design.gap_um, (fit.normal, fit.force_n), more)
        good = fit.misfit < EXPLAINED
        angle, least = _angle_deg(force, fit.force_n)[good], bound_deg[good]
        ratio = float(np.sqrt(np.mean(angle**2) / np.mean(least**2))) if good.any() else float("nan")
        found.append((float(good.mean()), ratio))
    return found


def _curves(ratio: CrbRatio) -> Figure:
    """Return bound and network against the magnitude, centred loads."""
    figure = Figure(figsize=(8.6, 3.9), layout="constrained")
    gf = [rung.magnitude_gf for rung in ratio.centred]
    quantities = (
        ("direction_rms_deg", "rms direction error [deg]"),
        ("magnitude_rms_gf", "rms magnitude error [gf]"),
    )
    for axes, (name, label) in zip(figure.subplots(1, 2), quantities, strict=True):
        five = np.array([getattr(rung.leaning, name) for rung in ratio.centred])
        axes.loglog(gf, [getattr(rung.network, name) for rung in ratio.centred], "o-C3", label="network")
        axes.loglog(gf, TARGET_RATIO * five, ":k", label=f"target, {TARGET_RATIO:g} of the bound")
        axes.loglog(gf, five, "s-C0", label="bound, five unknowns")
        three = [getattr(rung.centred, name) for rung in ratio.centred]
        axes.loglog(gf, three, "^--C2", label="bound, known to be centred")
        axes.set(xlabel="force [gf]", ylabel=label)
        axes.set_xticks(gf, [f"{g:g}" for g in gf])
        axes.minorticks_off()
        axes.grid(alpha=0.3)
    figure.axes[0].legend(fontsize=8)
    return figure


def _map(foot: Foot, twins: dict[float, tuple[Vector, Vector]], steps: int) -> tuple[Figure, Vector]:
    """Return the bound over the hemisphere beside the distance of twins, and the bound on the map's grid [deg]."""
    azimuth, elevation = np.linspace(0.0, 360.0, 4 * steps + 1), np.linspace(30.0, 90.0, steps)
    t1, t2 = np.meshgrid(azimuth, elevation, indexing="ij")
    direction = directions(t1.ravel(), t2.ravel())
    bound = force_bound(foot, direction, direction * MAP_GF * GRAM_FORCE_N, Unknowns.LEANING)
    degrees = bound.direction_rms_deg.reshape(t1.shape)
    figure = Figure(figsize=(9.2, 4.1), layout="constrained")
    polar = figure.add_subplot(1, 2, 1, projection="polar")
    filled = polar.contourf(np.radians(t1), 90.0 - t2, degrees, levels=16, cmap="viridis")
    polar.set_yticks([15.0, 30.0, 45.0, 60.0], ["75", "60", "45", "30 deg"], color="w", fontsize=8)
    polar.set_title(f"bound of the direction at {MAP_GF:g} gf, rms", fontsize=10)
    figure.colorbar(filled, ax=polar, label="[deg]", shrink=0.8)
    axes = figure.add_subplot(1, 2, 2)
    for gf, (distance, _) in twins.items():
        axes.semilogy(TWIN_ELEVATIONS_DEG, np.maximum(distance, 0.1), ".-", label=f"{gf:g} gf")
    axes.axhline(4.0, color="k", ls=":", lw=1)
    axes.set(
        xlabel=f"elevation of a centred load, azimuth {TWIN_AZIMUTH_DEG:g} deg [deg]",
        ylabel="distance of its twin [standard deviations]",
    )
    axes.legend(fontsize=8)
    axes.grid(alpha=0.3)
    return figure, degrees


_BOUND_HEADER = [
    "force [gf]",
    "3: direction rms [deg]",
    "3: magnitude rms [gf]",
    "5: direction rms [deg]",
    "5: mean [deg]",
    "5: magnitude rms [gf]",
    "5: fx / fy / fz [mN]",
]


def _bound_rows(rungs: Sequence[Rung]) -> list[list[str]]:
    """Return the table of the bound, centred loads."""
    return [
        [
            f"{rung.magnitude_gf:g}",
            *(
                [f"{three.direction_rms_deg:.4f}", f"{three.magnitude_rms_gf:.4f}"]
                if (three := rung.centred)
                else []
            ),
            f"{rung.leaning.direction_rms_deg:.4f}",
            f"{rung.leaning.direction_mean_deg:.4f}",
            f"{rung.leaning.magnitude_rms_gf:.4f}",
            " / ".join(f"{1e3 * part:.2f}" for part in rung.leaning.component_rms_n),
        ]
        for rung in rungs
    ]


def _ratio_rows(rungs: Sequence[Rung]) -> list[list[str]]:
    """Return the table of a read-out over the bound."""
    return [
        [
            f"{rung.magnitude_gf:g}",
            f"{rung.n} ({rung.n_saturated})",
            f"{rung.network.direction_rms_deg:.3f}",
            f"{rung.direction_ratio:.2f}",
            f"{rung.network.direction_mean_deg / rung.leaning.direction_mean_deg:.2f}",
            f"{rung.typical_ratio:.2f}",
            f"{rung.network.magnitude_rms_gf:.3f}",
            f"{rung.magnitude_ratio:.2f}",
            "met"
            if rung.direction_ratio <= TARGET_RATIO
            else f"missed by {rung.direction_ratio / TARGET_RATIO:.1f}x",
        ]
        for rung in rungs
    ]


_RATIO_HEADER = [
    "force [gf]",
    "loads (beyond range)",
    "direction rms [deg]",
    "over bound",
    "means over bound",
    "typical load",
    "magnitude rms [gf]",
    "over bound",
    f"target {TARGET_RATIO:g}",
]


_TWIN_HEADER = [
    "force [gf]",
    "nearest twin [sigma]",
    "at elevation [deg]",
    "it is aside by [deg]",
    "at 45 deg [sigma]",
]


def _twin_rows(twins: dict[float, tuple[Vector, Vector]]) -> list[list[str]]:
    """Return the table of the nearest twins, and of those of the paper's direction at 45 deg."""
    rows = []
    for gf, (distance, aside_deg) in twins.items():
        k = int(distance.argmin())
        paper = float(distance[np.abs(TWIN_ELEVATIONS_DEG - 45.0).argmin()])
        place = f"{TWIN_ELEVATIONS_DEG[k]:g}"
        rows.append([f"{gf:g}", f"{distance[k]:.1f}", place, f"{aside_deg[k]:.0f}", f"{paper:.1f}"])
    return rows


def page(context: StudyContext) -> Page:
    """Return the page."""
    quick = context.quick
    foot, loads = Foot(context.response), context.sole.loads
    magnitudes, draws = ((20.0, 50.0, 100.0), 8) if quick else (MAGNITUDES_GF, 64)
    ratio = crb_ratio(context.response, loads, context.network.force_n, draws=draws, magnitudes_gf=magnitudes)
    context.say(f"limit: the network is at {ratio.worst:.2f} of the bound in its worst bin")
    straight, leaning = verification_directions(), leaning_contacts(loads, np.random.default_rng(3), 600)
    tried = [("centred", (straight, straight), gf) for gf in (TWIN_GF[:1] if quick else TWIN_GF)]
    tried += [] if quick else [("leaning", leaning, gf) for gf in TWIN_GF[:2]]
    fitted = {f"{what}, {gf:g}": refined(context, where, gf, 1 if quick else 4) for what, where, gf in tried}
    context.say("limit: maximum likelihood held against the bound")
    twins = {gf: twins_of(foot, gf, TWIN_ELEVATIONS_DEG) for gf in TWIN_GF[: 2 if quick else 4]}
    drawing, degrees = _map(foot, twins, 11 if quick else 37)
    floors = _floors(context, foot, magnitudes)
    refined_header = ["loads, force [gf]", *(f"{n} rounds" if n > 1 else "1 round" for n in ROUNDS)]
    refined_rows = [
        [what, *(f"{r:.2f} ({100 * part:.0f} %)" for part, r in row)] for what, row in fitted.items()
    ]
    own_share = [
        (floor / rung.network.direction_rms_deg) ** 2
        for floor, rung in zip(floors, ratio.centred, strict=True)
    ]
    body = f"""
{"**Quick run: few magnitudes and draws. The figures are not those of the study.**" if quick else ""}

How well can nine noisy capacitances know the force at all? The Cramer-Rao bound answers for every unbiased read-out of
one scan: {1e3 * NOISE_PF:g} fF rms of white noise on each capacitance and {1e3 * BASELINE_NOISE_PF:g} fF on its
baseline, carried into the nine closures that the network is fed with; gaps may shut. It is drawn for two states of
knowledge: the load is *known* to be centred (three unknowns), or the contact may lean (five: the force and two angles
of the normal). The 180 directions are the paper's verification directions, centred.

{table(_BOUND_HEADER, _bound_rows(ratio.centred))}

![]({_CURVES})

### The network over the bound

A network that has to be right on leaning contacts cannot know that a load is centred, so the five-unknown bound is its
bound; {context.sole.loads.centred_share:.0%} of the loads that it learnt from were centred, though, so nothing forbids a
ratio a little below one.
Both are rms over all loads and noise of a bin, which counts every bad place and the network's own error; *typical load*
is the median over the loads of the ratio load by load, which shows what is left when a few bad places are not counted.

{table(_RATIO_HEADER, _ratio_rows(ratio.centred))}

**Headline: `crb_ratio` {ratio.worst:.2f}**, the worst bin, direction, rms, five unknowns; the target is
{TARGET_RATIO:g}. Without any noise the network's direction is wrong by {floors[0]:.3f} deg rms at {magnitudes[0]:g} gf
and by {floors[-1]:.3f} deg at {magnitudes[-1]:g} gf: the network's own error makes {100 * own_share[0]:.0f} % of the
squared error at the one and {100 * own_share[-1]:.0f} % at the other; the rest is noise.

Random leaning loads, as the network learnt from (loads beyond the converter's range are left out):

{table(_RATIO_HEADER, _ratio_rows(ratio.leaning))}

### Is the bound in reach?

Rounds of Gauss-Newton on the response table (five unknowns, started at the network's estimate as if it were centred)
bring the rms direction error to this multiple of the five-unknown bound; in brackets the share of the scans that the
fit explains, its misfit below {EXPLAINED:g} standard deviations. The others ended elsewhere, show it by their misfit,
and are not in the multiple.

{table(refined_header, refined_rows)}

### Where one scan cannot tell

Over the hemisphere at {MAP_GF:g} gf the bound lies between {degrees.min():.3f} and {degrees.max():.3f} deg. But it only
looks at neighbours. Near the diagonals a quite different load, its force far aside and its contact leaning a little,
closes all nine gaps nearly alike. The distance between the two in standard deviations of the noise says how often one
is mistaken for the other: at a distance of 4 (dotted) in 2 % of the scans even by the best read-out, at 1 in 31 %.

![]({_MAP})

{table(_TWIN_HEADER, _twin_rows(twins))}
"""
    values = {
        "quick": quick,
        "crb_ratio": ratio.worst,
        "target": TARGET_RATIO,
        "noiseless_direction_rms_deg": {f"{gf:g}": deg for gf, deg in zip(magnitudes, floors, strict=True)},
        "gauss_newton": {
            what: [{"explained_rel": p, "ratio": r} for p, r in row] for what, row in fitted.items()
        },
        "twin_distance_sigma": {f"{gf:g}": distance.tolist() for gf, (distance, _) in twins.items()},
        "bins": {name: [asdict(rung) for rung in getattr(ratio, name)] for name in ("centred", "leaning")},
    }
    figures = {_CURVES: _curves(ratio), _MAP: drawing}
    return Page(name="limit", title="How near the limit", body=body, figures=figures, values=values)


def _floors(context: StudyContext, foot: Foot, magnitudes_gf: Sequence[float]) -> list[float]:
    """Return the network's rms direction error without noise [deg], by magnitude, on the verification directions."""
    direction = verification_directions()
    floors = []
    for magnitude_gf in magnitudes_gf:
        force = direction * magnitude_gf * GRAM_FORCE_N
        estimate = context.network.force_n(
            sensed_closure_um(foot, direction, force) / context.response.design.gap_um
        )
        floors.append(float(np.sqrt(np.mean(_angle_deg(force, estimate) ** 2))))
    return floors
