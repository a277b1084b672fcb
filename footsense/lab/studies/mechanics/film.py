"""Study `film` (section VI): a gelled polyurethane film of 20 kPa without gaps, beside the spacer with gaps."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from footsense.foot import gap_contact
from footsense.foot.capacitor import CapacitorDesign
from footsense.foot.specimen import Foot
from footsense.lab.evaluation.evaluate import Errors, elastance_readout, errors
from footsense.lab.fem.film import FilmDesign, film_response, upright_closure_um
from footsense.lab.fem.mesh import COARSE, SHIPPED
from footsense.lab.geometry import Material, SoleDesign
from footsense.lab.monte_carlo.statistics import MeanStd
from footsense.lab.studies.page import Page, StudyContext, table
from footsense.lab.training.load_cases import (FULL_SCALE_PF, NOISE_PF, Cases, measured_closure_rel, paper_training, paper_verification, sensed_closure_um)
from footsense.lab.training.mlp import start_layers
from footsense.lab.training.paper_procedure import HIDDEN, PaperTraining

Vector = NDArray[np.float64]

#: Nothing is singular where the film covers all: no layers of thin elements.
FILM_SIZE, QUICK_FILM_SIZE = replace(SHIPPED, layers=0), replace(COARSE, layers=0)
#: Largest share of the film's thickness that may close anywhere [1]: beyond, a gel is no longer linear.
STRAIN_LIMIT_REL = 0.1
#: Poisson's ratios for which confinement is looked into.
POISSONS, QUICK_POISSONS = (0.3, 0.45, 0.49, 0.499, 0.4999), (0.3, 0.4999)
#: Load that sensitivity is read at [N]: no gap shuts.
SMALL_N = 0.05
#: Loads among which the range is sought [N].
LOADS_N = np.geomspace(0.05, 50.0, 200)
#: Networks for each design, and epochs of learning.
SEEDS, QUICK_SEEDS = 6, 2
EPOCHS, QUICK_EPOCHS = 3000, 300
#: Seed of the converter's noise, and how often the 180 cases are asked with new noise.
NOISE_SEED, ASKED = 7, 20

_FIGURE = "film.png"
_UP = np.array([[0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True, kw_only=True)
class Sole:
    """One of the two designs.

    Attributes:
        name: What it is called.
        capacitor: Its capacitors.
        closure_um: Makes closures as capacitance has them [um], shape (n, 9), of normals and forces [N], (n, 3) each.
        usable: Tells which loads (normals, forces) are within its range, shape (n,).
    """

    name: str
    capacitor: CapacitorDesign
    closure_um: Callable[[Vector, Vector], Vector]
    usable: Callable[[Vector, Vector], NDArray[np.bool_]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What one design can do.

    Attributes:
        closure_um_per_n: Mean closure of the elements under an upright force [um/N].
        sensitivity_pf_per_n: Mean change of capacitance with it [pF/N].
        range_n: Largest upright force in range [N].
        low_range_n: The same at an elevation of 45 deg [N].
        linear: Errors of the linear read-out of elastance on the paper's protocol, with noise.
        direction_deg: Direction errors of networks on closures.
        magnitude_gf: Their magnitude errors.
    """

    closure_um_per_n: float
    sensitivity_pf_per_n: float
    range_n: float
    low_range_n: float
    linear: Errors
    direction_deg: MeanStd
    magnitude_gf: MeanStd


def gap_sole(bench: StudyContext) -> Sole:
    """Return the design with gaps, from the released table."""
    foot = Foot(bench.response)

    def usable(normal: Vector, force_n: Vector) -> NDArray[np.bool_]:
        return np.asarray(foot.capacitance_pf(normal, force_n).max(axis=1) < FULL_SCALE_PF)

    return Sole(
        name="gaps",
        capacitor=bench.response.design,
        closure_um=lambda normal, force_n: sensed_closure_um(foot, normal, force_n),
        usable=usable,
    )


def film_sole(bench: StudyContext, film: FilmDesign) -> Sole:
    """Return the design with the film, solved."""
    sole = bench.sole
    response = film_response(sole, QUICK_FILM_SIZE if bench.quick else FILM_SIZE, film)
    capacitor = film.capacitor(sole)

    def closure_um(normal: Vector, force_n: Vector) -> Vector:
        distance_um = capacitor.gap_um - response.free_closure_um(normal, force_n)
        sensed = gap_contact.capacitance_pf(capacitor, distance_um)
        return capacitor.closure_um(sensed, np.full(9, capacitor.rest_pf))

    def usable(normal: Vector, force_n: Vector) -> NDArray[np.bool_]:
        strain = np.abs(response.free_closure_um(normal, force_n)).max(axis=1) / capacitor.gap_um
        return np.asarray(strain < STRAIN_LIMIT_REL)

    return Sole(name="film", capacitor=capacitor, closure_um=closure_um, usable=usable)


def _range_n(sole: Sole, direction: Vector) -> float:
    """Return the largest of `LOADS_N` in range [N], of a centred contact."""
    # More load never brings a foot back into its range: halve.
    inside, outside = 0, len(LOADS_N)
    while outside - inside > 1:
        middle = (inside + outside) // 2
        if sole.usable(direction, LOADS_N[middle] * direction)[0]:
            inside = middle
        else:
            outside = middle
    return float(LOADS_N[inside])


def judged(sole: Sole, training_n: Vector, asked_n: Vector, *, quick: bool) -> Verdict:
    """Return what a design can do; both designs are judged by the same noise in pF.

    Args:
        sole: The design.
        training_n: Forces of the paper's 362 cases [N], shape (362, 3).
        asked_n: Forces of its 180 cases [N], shape (180, 3).
        quick: Few networks, few epochs.
    """
    rng = np.random.default_rng(NOISE_SEED)

    def noisy(force_n: Vector) -> Cases:
        closure_um = sole.closure_um(force_n / np.linalg.norm(force_n, axis=1, keepdims=True), force_n)
        return Cases(force_n, sole.capacitor.gap_um * measured_closure_rel(sole.capacitor, closure_um, rng))

    taught, asked = noisy(training_n), noisy(np.tile(asked_n, (ASKED, 1)))
    seeds, epochs = (QUICK_SEEDS, QUICK_EPOCHS) if quick else (SEEDS, EPOCHS)
    starts = [start_layers(np.random.default_rng(seed), (9, *HIDDEN, 3)) for seed in range(seeds)]
    readouts = PaperTraining(sole.capacitor, taught, "closure").train(starts, epochs)
    answers = [errors(asked.force_n, read(asked.closure_um)) for read in readouts]
    small_um = sole.closure_um(_UP, SMALL_N * _UP)
    change_pf = sole.capacitor.capacitance_pf(small_um) - sole.capacitor.rest_pf
    low = np.array([[np.sqrt(0.5), 0.0, np.sqrt(0.5)]])
    return Verdict(
        closure_um_per_n=float(small_um.mean() / SMALL_N),
        sensitivity_pf_per_n=float(change_pf.mean() / SMALL_N),
        range_n=_range_n(sole, _UP),
        low_range_n=_range_n(sole, low),
        linear=errors(asked.force_n, elastance_readout(taught)(asked.closure_um)),
        direction_deg=MeanStd.over(answer.direction_deg for answer in answers),
        magnitude_gf=MeanStd.over(answer.magnitude_gf for answer in answers),
    )


def _figure(soles: list[Sole]) -> Figure:
    """Return capacitance of a corner and the middle element over an upright force, up to the end of each range."""
    figure = Figure(figsize=(8.2, 3.9), layout="constrained")
    absolute, change = figure.subplots(1, 2)
    for colour, sole in zip(("C0", "C1"), soles, strict=True):
        loads_n = np.linspace(0.0, _range_n(sole, _UP), 30)
        closure_um = sole.closure_um(np.repeat(_UP, len(loads_n), axis=0), loads_n[:, None] * _UP)
        sensed_pf = sole.capacitor.capacitance_pf(closure_um)
        for element, style, where in ((0, "-", "corner"), (4, "--", "middle")):
            label = f"{sole.name}, {where}"
            absolute.plot(loads_n, sensed_pf[:, element], style, color=colour, label=label)
            change.plot(loads_n, sensed_pf[:, element] / sensed_pf[0, element] - 1.0, style, color=colour)
    absolute.axhline(FULL_SCALE_PF, color="k", lw=0.8, ls=":", label="full scale without offset")
    absolute.set(xlabel="upright force [N]", ylabel="capacitance [pF]", ylim=(0.0, None))
    change.set(xlabel="upright force [N]", ylabel="change over rest [1]")
    absolute.legend(fontsize=8)
    for axes in (absolute, change):
        axes.grid(alpha=0.3)
    return figure


def _confinement(
    sole: SoleDesign, poissons: tuple[float, ...], film: FilmDesign
) -> tuple[list[list[str]], list[float]]:
    """Return a row for each Poisson's ratio, and the closures under an upright force [um/N]."""
    films = [replace(film, gel=Material(film.gel.youngs_mpa, poisson)) for poisson in poissons]
    closures = upright_closure_um(sole, QUICK_FILM_SIZE, films)
    rows = [
        [f"{nu:g}", f"{1e3 * other.gel.confined_mpa:.0f}", f"{other.relief_mm:.3f}", f"{closure:.3f}"]
        for nu, other, closure in zip(poissons, films, closures, strict=True)
    ]
    return rows, closures


def page(bench: StudyContext) -> Page:
    """Return the page."""
    quick, sole = bench.quick, bench.sole
    film = FilmDesign(film_mm=sole.spacer_mm)
    soles = [gap_sole(bench), film_sole(bench, film)]
    bench.say("film: the foot with the film is solved")
    training_n = paper_training(bench.response).force_n
    asked_n = paper_verification(bench.response).force_n
    gap, gel = (judged(one, training_n, asked_n, quick=quick) for one in soles)
    bench.say("film: both designs are judged")
    poissons = QUICK_POISSONS if quick else POISSONS
    confined, closures = _confinement(sole, poissons, film)
    slide_um = 1e3 * film.film_mm / (film.gel.shear_mpa * sole.sheet_mm**2)
    soft_kpa, thick_um = 1e3 * film.gel.youngs_mpa, 1e3 * film.film_mm
    gap_rest, gel_rest = (one.capacitor.rest_pf for one in soles)
    rows = [
        ["capacitance at rest [pF]", f"{gap_rest:.2f}", f"{gel_rest:.2f}"],
        ["mean closure, upright [um/N]", f"{gap.closure_um_per_n:.2f}", f"{gel.closure_um_per_n:.2f}"],
        ["sensitivity, upright [pF/N]", f"{gap.sensitivity_pf_per_n:.3f}", f"{gel.sensitivity_pf_per_n:.3f}"],
        ["range, upright [N]", f"{gap.range_n:.2f}", f"{gel.range_n:.2f}"],
        ["range, elevation 45 deg [N]", f"{gap.low_range_n:.2f}", f"{gel.low_range_n:.2f}"],
        ["linear read-out [deg]", f"{gap.linear.direction_deg:.2f}", f"{gel.linear.direction_deg:.2f}"],
        ["linear read-out [gf]", f"{gap.linear.magnitude_gf:.2f}", f"{gel.linear.magnitude_gf:.2f}"],
        ["network [deg]", str(gap.direction_deg), str(gel.direction_deg)],
        ["network [gf]", str(gap.magnitude_gf), str(gel.magnitude_gf)],
    ]
    ratio = gel.sensitivity_pf_per_n / gap.sensitivity_pf_per_n
    body = f"""
{"**Quick run: a coarse mesh, few networks and epochs.**" if quick else ""}

The paper's outlook (section VI): a film of gelled polyurethane, E = {soft_kpa:g} kPa, without gaps, in place of the
spacer, for more sensitivity and so that nothing sticks. Here it covers the whole sheet, {thick_um:g} um thick like the
spacer, between the same plates of PDMS, as an elastic layer. Our choices: Poisson's ratio {film.gel.poisson:g},
relative permittivity {film.eps_r:g} (capacitance and sensitivity are proportional to it). Both designs have the
converter's {1e3 * NOISE_PF:g} fF of noise. The range of the gaps ends at {FULL_SCALE_PF:.0f} pF, that of the film where
it is anywhere pressed or stretched by {STRAIN_LIMIT_REL:.0%}; at rest the film has {gel_rest:.1f} pF, for which the
converter needs its offset. Errors: the paper's 362 cases taught, its 180 asked, {ASKED} times with new noise;
networks on closures 9-{HIDDEN[0]}-{HIDDEN[1]}-3, mean ± deviation of {gap.direction_deg.n} start weights.

{table(["", "gaps in PDMS", "film"], rows)}

![]({_FIGURE})

- The film has {ratio:.2f} times the sensitivity of the gaps; it is softer than PDMS by a factor of
  {sole.pdms.youngs_mpa / film.gel.youngs_mpa:.0f}. It is confined: a layer of {thick_um:g} um between plates of
  {sole.sheet_mm:g} mm cannot spread, and is pressed against M = {1e3 * film.gel.confined_mpa:.0f} kPa instead of
  {soft_kpa:g}. The gaps in turn close by bending of the plates, which nothing resists.
- Its range ends at {gel.range_n:.1f} N upright, that of the gaps at {gap.range_n:.1f} N.
- A linear read-out of elastance has
  {gel.linear.direction_deg:.2f} deg and {gel.linear.magnitude_gf:.2f} gf with the film,
  {gap.linear.direction_deg:.2f} deg and {gap.linear.magnitude_gf:.2f} gf with the gaps, some of which shut at the
  150 gf that are taught.
- Against shear it is as soft as it is said to be: a lateral newton slides the plates by {slide_um:.0f} um,
  {slide_um / 1e3 / sole.electrode_mm:.1%} of an electrode, where the closure of an upright one is
  {gel.closure_um_per_n / thick_um:.1%} of the thickness. What that does to the overlap of the electrodes is
  not in these figures; it would have to be designed away with electrodes of different sizes.

### What confinement does

An upright newton, spread over the ball; a coarse mesh does.

{table(["Poisson's ratio", "M [kPa]", "relief at the rim [mm]", "mean closure [um/N]"], confined)}

- From {poissons[0]:g} to {poissons[-1]:g} the closure falls by a factor of {closures[0] / closures[-1]:.0f}: not E but
  compressibility sets the sensitivity of a continuous film, and it is the number that a gel's data sheet does not
  give. Only where the relief length comes near the size of the sheet would the film yield sideways, and the layer
  model err; to gain from a soft gel, it has to be given room to spread: pores, pillars or gaps.
"""
    return Page(
        name="film",
        title="A soft film without gaps",
        body=body,
        figures={_FIGURE: _figure(soles)},
        values={
            "quick": quick,
            "gaps": _json(gap, gap_rest),
            "film": _json(gel, gel_rest),
            "upright_closure_um_per_n_by_poisson": dict(zip(map(str, poissons), closures, strict=True)),
        },
    )


def _json(verdict: Verdict, rest_pf: float) -> dict[str, Any]:
    """Return a verdict as JSON values."""
    return {
        "rest_pf": rest_pf,
        "closure_um_per_n": verdict.closure_um_per_n,
        "sensitivity_pf_per_n": verdict.sensitivity_pf_per_n,
        "range_n": verdict.range_n,
        "low_range_n": verdict.low_range_n,
        "linear_direction_deg": verdict.linear.direction_deg,
        "linear_magnitude_gf": verdict.linear.magnitude_gf,
        "network_direction_deg": verdict.direction_deg.json(),
        "network_magnitude_gf": verdict.magnitude_gf.json(),
    }
