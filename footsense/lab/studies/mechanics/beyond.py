"""Study `beyond`: what the paper leaves for later (end of III A): forces past the centre, and a second load beside."""

from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from numpy.typing import NDArray

from footsense.foot import gap_contact
from footsense.foot.directions import directions
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.response_table import FootResponse
from footsense.lab.evaluation.evaluate import Errors, Readout, elastance_readout, errors
from footsense.lab.studies.page import Page, StudyContext, table
from footsense.lab.training.load_cases import (
    FULL_SCALE_PF,
    measured_closure_rel,
    paper_training,
    random_loads,
)

Vector = NDArray[np.float64]

#: Leaning force [gf]: at a lean of 40 deg its moment makes one newton shut gaps on half the sheet.
LEANING_GF = 20.0
#: Force at which the table says how many leaning loads the converter can still tell [gf]: the paper's.
PAPER_GF = 100.0
#: Force of the floor beside a second load [gf].
FLOOR_GF = 50.0
#: Angles between force and contact normal [deg].
LEANS_DEG = tuple(np.arange(0.0, 41.0, 5.0).tolist())
#: Elevations of the leaning forces [deg]: at a lean of 40 deg the table still reaches the contact.
LEANING_ELEVATIONS_DEG = (65.0, 75.0, 85.0)
#: The second load over that of the floor [1].
SHARES = (0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 0.75, 1.0)
#: Lowest contact of the second load, as elevation of its normal [deg].
SECOND_MIN_ELEVATION_DEG = 30.0
#: Angle between both contacts, seen from the centre [deg]: borders of the classes.
DISTANCES_DEG = (0.0, 30.0, 60.0, 90.0, 120.0)
#: Share at which the distance is looked into [1].
DISTANCE_SHARE = 0.5
#: Ways to draw the second load for each floor force; loads of the wide set that the second linear read-out learns from.
DRAWS, QUICK_DRAWS = 6, 1
WIDE_CASES, QUICK_WIDE_CASES = 10_000, 1000
SEED = 31

_LEAN_FIGURE, _SECOND_FIGURE = "beyond-lean.png", "beyond-second.png"


def normal_to(force: Vector, lean_deg: float, turn_deg: float) -> Vector:
    """Return unit vectors at an angle from forces, shape (n, 3).

    Args:
        force: Directions, shape (n, 3), none along x.
        lean_deg: The angle [deg].
        turn_deg: To which side: 0 is down the meridian, 90 across it [deg].
    """
    along = force / np.linalg.norm(force, axis=1, keepdims=True)
    across = np.cross([0.0, 0.0, 1.0], along)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    down = np.cross(across, along)
    lean, turn = np.radians([lean_deg, turn_deg])
    side = np.cos(turn) * down + np.sin(turn) * across
    leaning: Vector = np.cos(lean) * along + np.sin(lean) * side
    return leaning


def sensed_um(response: FootResponse, free_um: Vector) -> Vector:
    """Return the closures that capacitance stands for [um], shape (n, 9), of free closures [um], shape (n, 324).

    The free closures of several contacts add up, each patch with its own radius; then the gaps touch.
    """
    design = response.design
    gap_um = np.full(gap_contact.ALL_CELLS, design.gap_um)
    closed = np.stack(
        [gap_contact.touch(one, gap_um, response.compliance_um_per_n).closure_um for one in free_um]
    )
    distance_um = design.gap_um - closed + design.film_equivalent_um
    return design.closure_um(gap_contact.capacitance_pf(design, distance_um), np.full(9, design.rest_pf))


class _Judge:
    """The read-outs under test, and the noise of the converter.

    Attributes:
        readouts: By name.
    """

    def __init__(self, bench: StudyContext) -> None:
        """Teach the linear read-outs."""
        self.response = bench.response
        gap_um = self.response.design.gap_um
        n_wide = QUICK_WIDE_CASES if bench.quick else WIDE_CASES
        network = bench.network
        self.readouts: dict[str, Readout] = {
            "shipped network": lambda closure_um: network.force_n(closure_um / gap_um),
            "linear, taught centred loads": elastance_readout(paper_training(self.response)),
            "linear, taught leaning loads": elastance_readout(
                random_loads(self.response, bench.sole.loads, n_wide, SEED)
            ),
        }

    def measured_um(self, free_um: Vector) -> tuple[Vector, NDArray[np.bool_]]:
        """Return noisy closures [um], shape (n, 9), and which loads are within the converter's range, shape (n,)."""
        design = self.response.design
        closure_um = sensed_um(self.response, free_um)
        noisy = measured_closure_rel(design, closure_um, np.random.default_rng(SEED)) * design.gap_um
        return noisy, design.capacitance_pf(closure_um).max(axis=1) < FULL_SCALE_PF

    def in_range(self, free_um: Vector) -> NDArray[np.bool_]:
        """Return which loads are within the converter's range, shape (n,)."""
        return self.measured_um(free_um)[1]

    def errors(self, measured_um: Vector, truth_n: Vector) -> dict[str, Errors]:
        """Return each read-out's errors."""
        return {name: errors(truth_n, read(measured_um)) for name, read in self.readouts.items()}


def leaning(judge: _Judge) -> tuple[list[dict[str, Errors]], list[float]]:
    """Return the errors at each lean, and the share of loads of `PAPER_GF` that the converter can tell.

    108 force directions, the contact to four sides of each.
    """
    azimuth, elevation = np.meshgrid(5.0 + 10.0 * np.arange(36), LEANING_ELEVATIONS_DEG, indexing="ij")
    truth_n = np.tile(LEANING_GF * GRAM_FORCE_N * directions(azimuth.ravel(), elevation.ravel()), (4, 1))
    found, within = [], []
    for lean_deg in LEANS_DEG:
        quarters = np.split(truth_n, 4)
        normal = np.concatenate(
            [normal_to(force_n, lean_deg, 90.0 * turn) for turn, force_n in enumerate(quarters)]
        )
        measured_um, inside = judge.measured_um(judge.response.free_closure_um(normal, truth_n))
        found.append(judge.errors(measured_um[inside], truth_n[inside]))
        larger_n = truth_n * (PAPER_GF / LEANING_GF)
        within.append(float(judge.in_range(judge.response.free_closure_um(normal, larger_n)).mean()))
    return found, within


class _Second:
    """Second loads beside the floor's: places and forces, drawn once and scaled by the share.

    Attributes:
        floor_n: Force of the floor, centred [N], shape (n, 3).
        distance_deg: Angle between the contacts [deg], shape (n,).
    """

    def __init__(self, judge: _Judge, draws: int) -> None:
        """Draw them, a seeded cap of contacts above the lowest one."""
        self._judge = judge
        azimuth, elevation = np.meshgrid(
            5.0 + 10.0 * np.arange(36), 45.0 + 10.0 * np.arange(5), indexing="ij"
        )
        direction = np.tile(directions(azimuth.ravel(), elevation.ravel()), (draws, 1))
        rng = np.random.default_rng(SEED)
        lowest = np.sin(np.radians(SECOND_MIN_ELEVATION_DEG))
        height = rng.uniform(lowest, 1.0, len(direction))
        self._normal = directions(rng.uniform(0.0, 360.0, len(direction)), np.degrees(np.arcsin(height)))
        self._unit_n = FLOOR_GF * GRAM_FORCE_N * self._normal
        self.floor_n = FLOOR_GF * GRAM_FORCE_N * direction
        self._floor_um = judge.response.free_closure_um(direction, self.floor_n)
        self.distance_deg = np.degrees(np.arccos(np.clip((direction * self._normal).sum(axis=1), -1.0, 1.0)))

    def felt(self, share: float) -> tuple[Vector, Vector, NDArray[np.bool_]]:
        """Return noisy closures [um], the sum of both forces [N], and which loads are in range, for a share."""
        second_n = share * self._unit_n
        free_um = self._floor_um + self._judge.response.free_closure_um(self._normal, second_n)
        measured_um, inside = self._judge.measured_um(free_um)
        return measured_um, self.floor_n + second_n, inside


def _curves(x: Any, label: str, found: list[dict[str, Errors]]) -> Figure:
    """Return mean errors of direction and magnitude over x, a curve for each read-out."""
    figure = Figure(figsize=(8.2, 3.9), layout="constrained")
    direction, magnitude = figure.subplots(1, 2)
    for name in found[0]:
        direction.plot(x, [of_name[name].direction_deg for of_name in found], "o-", ms=4, label=name)
        magnitude.plot(x, [of_name[name].magnitude_gf for of_name in found], "o-", ms=4)
    for axes, what in ((direction, "mean direction error [deg]"), (magnitude, "mean magnitude error [gf]")):
        axes.set(xlabel=label, ylabel=what, yscale="log")
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter("{x:g}")
        axes.tick_params(which="minor", labelsize=7)
        axes.grid(alpha=0.3, which="both")
    direction.legend(fontsize=8)
    return figure


def _rows(x: Any, form: str, found: list[dict[str, Errors]]) -> list[list[str]]:
    """Return a row for each x: of every read-out the mean and the 95th percentile in degrees, and the mean in gf."""
    rows = []
    for value, of_name in zip(x, found, strict=True):
        cells = [
            f"{e.direction_deg:.2f} ({e.direction_p95_deg:.2f}), {e.magnitude_gf:.1f}"
            for e in of_name.values()
        ]
        rows.append([format(value, form), str(next(iter(of_name.values())).n), *cells])
    return rows


def _by_distance(judge: _Judge, second: _Second) -> tuple[list[str], list[dict[str, Errors]]]:
    """Return the classes of distance that loads fall into, and the errors in each."""
    measured_um, truth_n, inside = second.felt(DISTANCE_SHARE)
    names, found = [], []
    for low, high in pairwise(DISTANCES_DEG):
        here = inside & (second.distance_deg >= low) & (second.distance_deg < high)
        if here.any():
            names.append(f"{low:g} to {high:g}")
            found.append(judge.errors(measured_um[here], truth_n[here]))
    return names, found


def _json(x: Any, found: list[dict[str, Errors]]) -> dict[str, Any]:
    """Return the mean direction and magnitude errors as JSON values, by read-out and x."""
    return {
        name: {
            str(value): {
                "direction_deg": of_name[name].direction_deg,
                "magnitude_gf": of_name[name].magnitude_gf,
                "n": of_name[name].n,
            }
            for value, of_name in zip(x, found, strict=True)
        }
        for name in found[0]
    }


def page(bench: StudyContext) -> Page:
    """Return the page."""
    judge = _Judge(bench)
    lean, within = leaning(judge)
    bench.say(f"beyond: {len(LEANS_DEG)} leans judged")
    second = _Second(judge, QUICK_DRAWS if bench.quick else DRAWS)
    shared = []
    for share in SHARES:
        measured_um, truth_n, inside = second.felt(share)
        shared.append(judge.errors(measured_um[inside], truth_n[inside]))
    bench.say(f"beyond: {len(SHARES)} shares of a second load judged")
    distances, apart = _by_distance(judge, second)
    lean_rows = [[*row, f"{part:.0%}"] for row, part in zip(_rows(LEANS_DEG, "g", lean), within, strict=True)]
    names = [f"{name}: deg mean (p95), gf" for name in judge.readouts]
    network, centred, leaning_too = judge.readouts
    taught = int(np.argmin(np.abs(np.array(LEANS_DEG) - bench.sole.loads.friction_angle_deg)))
    friction_deg = LEANS_DEG[taught]
    level, leant = lean[0], lean[taught]
    arm_mm = bench.response.ball_radius_mm * np.sin(np.radians(LEANS_DEG[1]))
    alone, half, equal = shared[0], shared[SHARES.index(DISTANCE_SHARE)], shared[-1]
    body = f"""
{"**Quick run: few second loads, a short lesson for the last read-out.**" if bench.quick else ""}

The paper leaves three things for later (end of III A): a force that does not go through the middle of the ball, an
external load beside the floor's, and a ball that is much deformed. The first two are looked into here with the
response table, gaps in contact and the converter's noise included; the third is in the study `floor`.

### A force past the centre

The contact normal leans from the force, as it does with friction or on a slope. {LEANING_GF:g} gf at elevations of
{", ".join(f"{e:g}" for e in LEANING_ELEVATIONS_DEG)} deg and 36 azimuths; the contact lies to four sides of each.

{table(["lean [deg]", "loads", *names, f"in range at {PAPER_GF:g} gf"], lean_rows)}

![]({_LEAN_FIGURE})

- A centred force has no moment about the middle of the sheet, and a leaning one has: at a lean of {LEANS_DEG[1]:g} deg
  its line passes {arm_mm:.1f} mm beside. The linear read-out that was taught centred loads takes that moment for
  inclination: {level[centred].direction_deg:.2f} deg of error without lean, {lean[1][centred].direction_deg:.0f} deg at
  {LEANS_DEG[1]:g} deg of lean. The paper's protocol does not show this, as all of its loads are centred.
- Taught leaning loads, a linear read-out has {level[leaning_too].direction_deg:.1f} deg without lean and
  {leant[leaning_too].direction_deg:.1f} deg at {friction_deg:g} deg, where the shipped network, taught the same
  kind of loads, has {level[network].direction_deg:.2f} and {leant[network].direction_deg:.2f} deg. Beyond
  {friction_deg:g} deg the network was taught nothing.
- A leaning force has a moment about the sheet, which shuts gaps on one side: of {PAPER_GF:g} gf, the converter's full
  scale leaves {within[LEANS_DEG.index(15.0)]:.0%} of the loads at a lean of 15 deg and {within[taught]:.0%} at
  {friction_deg:g} deg. Range, not the read-out, is what a leaning force asks for first.

### A second load beside the floor's

The floor presses with {FLOOR_GF:g} gf in the paper's 180 directions; a second contact lies anywhere on the ball
(normals down to {SECOND_MIN_ELEVATION_DEG:g} deg) and presses without friction, so that lean plays no part. Free
closures add up, each contact with a Hertz patch of its own, and then the gaps touch. The read-outs answer one force;
they are judged by the sum of both, which is what the leg feels. Loads beyond the converter's full scale are left out.

{table(["second over floor", "loads", *names], _rows(SHARES, "g", shared))}

With a second load of {DISTANCE_SHARE:g} of the floor's, by the angle between the contacts:

{table(["contacts apart [deg]", "loads", *names], _rows(distances, "", apart))}

![]({_SECOND_FIGURE})

- Contacts without friction are centred loads one by one, and free closures add up: a linear read-out that is right for
  each is right for both. The one taught centred loads goes from {alone[centred].direction_deg:.2f} deg with the floor
  alone to {half[centred].direction_deg:.2f} deg with a second load of {DISTANCE_SHARE:g} and
  {equal[centred].direction_deg:.2f} deg with one as large as the floor's. It is not quite right for
  each: gaps touch, and contacts below 40 deg were not taught.
- The shipped network was taught one contact of any lean, and goes from {alone[network].direction_deg:.2f} over
  {half[network].direction_deg:.2f} to {equal[network].direction_deg:.2f} deg, the more the farther the contacts are
  apart. It has to tell lean by weak patterns, and two contacts make patterns that no single one makes.
- So nine closures of one foot tell a leaning contact or a second one, but not without being told which: what a
  read-out was taught is what it can be used for.
"""
    figures = {
        _LEAN_FIGURE: _curves(LEANS_DEG, "lean of the contact normal [deg]", lean),
        _SECOND_FIGURE: _curves(SHARES, "second load over the floor's", shared),
    }
    values = {
        "quick": bench.quick,
        "by_lean_deg": _json(LEANS_DEG, lean),
        "in_range_by_lean_deg": dict(zip(map(str, LEANS_DEG), within, strict=True)),
        "by_second_share": _json(SHARES, shared),
        "by_distance_deg": _json(distances, apart),
    }
    return Page(name="beyond", title="Beyond one centred force", body=body, figures=figures, values=values)
