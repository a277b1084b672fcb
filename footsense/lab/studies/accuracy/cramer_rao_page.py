"""The page of the study `cramer-rao`: its text, and the study itself."""

import numpy as np

from footsense.lab.evaluation.bound_ratio import MagnitudeBin
from footsense.lab.studies.accuracy.cramer_rao import (
    CURVES,
    ELEVATIONS_DEG,
    EXPLAINED,
    MAP,
    MAP_GF,
    ROUNDS,
    TARGET_RATIO,
    Ambiguity,
    Results,
    compute,
)
from footsense.lab.studies.page import Study, table
from footsense.lab.training.load_cases import BASELINE_NOISE_PF, NOISE_PF

_BOUND_HEADER = [
    "force [gf]",
    "3: direction rms [deg]",
    "3: magnitude rms [gf]",
    "5: direction rms [deg]",
    "5: mean [deg]",
    "5: magnitude rms [gf]",
    "5: fx / fy / fz [mN]",
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
_AMBIGUOUS_HEADER = [
    "force [gf]",
    "nearest ambiguous load [sigma]",
    "at elevation [deg]",
    "force aside by [deg]",
    "at 45 deg [sigma]",
]


def _bound_row(one: MagnitudeBin) -> list[str]:
    """Return a row of the table of the bound, centred loads."""
    three, five = one.centred or one.leaning, one.leaning
    return [
        f"{one.magnitude_gf:g}",
        f"{three.direction_rms_deg:.4f}",
        f"{three.magnitude_rms_gf:.4f}",
        f"{five.direction_rms_deg:.4f}",
        f"{five.direction_mean_deg:.4f}",
        f"{five.magnitude_rms_gf:.4f}",
        " / ".join(f"{1e3 * part:.2f}" for part in five.component_rms_n),
    ]


def _ratio_row(one: MagnitudeBin) -> list[str]:
    """Return a row of the table of the network over the bound."""
    met = one.direction_ratio <= TARGET_RATIO
    return [
        f"{one.magnitude_gf:g}",
        f"{one.n} ({one.n_saturated})",
        f"{one.network.direction_rms_deg:.3f}",
        f"{one.direction_ratio:.2f}",
        f"{one.network.direction_mean_deg / one.leaning.direction_mean_deg:.2f}",
        f"{one.typical_ratio:.2f}",
        f"{one.network.magnitude_rms_gf:.3f}",
        f"{one.magnitude_ratio:.2f}",
        "met" if met else f"missed by {one.direction_ratio / TARGET_RATIO:.1f}x",
    ]


def _ambiguous_row(gf: str, found: Ambiguity) -> list[str]:
    """Return a row of the table of the nearest ambiguous loads, and of those at the paper's 45 deg."""
    k, at_45 = int(np.argmin(found.distance_sigma)), int(np.abs(ELEVATIONS_DEG - 45.0).argmin())
    nearest = [f"{found.distance_sigma[k]:.1f}", f"{ELEVATIONS_DEG[k]:g}", f"{found.apart_deg[k]:.0f}"]
    return [gf, *nearest, f"{found.distance_sigma[at_45]:.1f}"]


def render(results: Results) -> str:
    """Return the page's text."""
    ratio, own_deg = results.ratio, results.noiseless_direction_rms_deg
    first, last = ratio.centred[0], ratio.centred[-1]
    own_rel = [
        (deg / one.network.direction_rms_deg) ** 2 for deg, one in ((own_deg[0], first), (own_deg[-1], last))
    ]
    refined_header = ["loads, force [gf]", *(f"{n} rounds" if n > 1 else "1 round" for n in ROUNDS)]
    refined_rows = [
        [what, *(f"{one.ratio:.2f} ({100 * one.explained_rel:.0f} %)" for one in row)]
        for what, row in results.gauss_newton.items()
    ]
    low_deg, high_deg = results.bound_range_deg
    return f"""
What is the least error of nine noisy capacitances? The Cramer-Rao bound answers for every unbiased read-out of
one scan: {1e3 * NOISE_PF:g} fF rms of white noise on each capacitance and {1e3 * BASELINE_NOISE_PF:g} fF on its
baseline, carried into the nine closures that are the network's input; gaps may close. Two states of knowledge: the load
is *known* to be centred (three unknowns), or the contact may lean (five: the force and two angles of the normal). The
180 directions are the paper's verification directions, centred.

{table(_BOUND_HEADER, map(_bound_row, ratio.centred))}

![]({CURVES})

### The network over the bound

A network that has to be right on leaning contacts cannot know that a load is centred, so the five-unknown bound is its
bound; {results.centred_share:.0%} of its training loads were centred, though, so a ratio a little below one is
possible. Both are rms over all loads and noise of a bin, which counts every bad direction and the network's own error;
*typical load* is the median over the loads of the ratio load by load, which leaves a few bad directions out.

{table(_RATIO_HEADER, map(_ratio_row, ratio.centred))}

**Headline: `crb_ratio` {ratio.worst:.2f}**, the worst bin, direction, rms, five unknowns; the target is
{TARGET_RATIO:g}. Without any noise the network's direction is wrong by {own_deg[0]:.3f} deg rms at
{first.magnitude_gf:g} gf and by {own_deg[-1]:.3f} deg at {last.magnitude_gf:g} gf: the network's own error makes
{100 * own_rel[0]:.0f} % of the squared error at {first.magnitude_gf:g} gf and {100 * own_rel[-1]:.0f} % at
{last.magnitude_gf:g} gf; the rest is noise.

Random leaning loads, drawn like those of the training (loads beyond the converter's range are left out):

{table(_RATIO_HEADER, map(_ratio_row, ratio.leaning))}

### Can a read-out reach the bound?

Rounds of Gauss-Newton on the response table (five unknowns, started at the network's estimate as if it were centred)
bring the rms direction error to this multiple of the five-unknown bound; in brackets the share of the scans that the
fit explains, its misfit below {EXPLAINED:g} standard deviations. The others ended elsewhere, which their misfit shows,
and are not in the multiple.

{table(refined_header, refined_rows)}

### Where one scan is ambiguous

Over the hemisphere at {MAP_GF:g} gf the bound lies between {low_deg:.3f} and {high_deg:.3f} deg. But it only
looks at neighbours. Near the diagonals a quite different load, its force far aside and its contact leaning a little,
closes all nine gaps nearly alike. The distance between the two in standard deviations of the noise says how often one
is mistaken for the other: at a distance of 4 (dotted) in 2 % of the scans even by the best read-out, at 1 in 31 %.

![]({MAP})

{table(_AMBIGUOUS_HEADER, [_ambiguous_row(gf, found) for gf, found in results.ambiguous.items()])}
"""


STUDY = Study(
    name="cramer-rao", title="The Cramer-Rao bound", results=Results, compute=compute, render=render
)
