"""Page `outlook`: what the paper leaves open, computed: loads off centre, a second load, sealed air, a film of gel.

Source:
    Aoyagi et al., end of section III A (loads), section IV ("each sealed concave space"), section VI (gel).
"""

from collections.abc import Sequence

import numpy as np

from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.lab.evaluation.evaluate_models import (
    MEASURED_DIRECTION_DEG,
    MEASURED_MAGNITUDE_GF,
    elastance_based_force_estimator,
)
from footsense.lab.evaluation.film_against_gaps import MAX_STRAIN_REL, NOISE_DRAWS, film_against_gaps
from footsense.lab.evaluation.off_centre import (
    ANGLES_SECOND_REL,
    FLOOR_GF,
    IN_RANGE_GF,
    LEANING_ELEVATIONS_DEG,
    LEANING_GF,
    LEANS_DEG,
    SECOND_MIN_ELEVATION_DEG,
    ComparedEstimators,
    leaning_load_errors,
    second_load_errors,
)
from footsense.lab.evaluation.sealed_cavities import (
    BOUND_GF,
    MAX_SEARCHED_N,
    sealed_against_vented,
)
from footsense.lab.report import SAME_TABLE, StudyContext, Values, spread, table
from footsense.lab.training.load_cases import (
    FULL_SCALE_PF,
    NOISE_PF,
    paper_training,
    random_loads,
)
from footsense.lab.training.paper_procedure import HIDDEN_NEURONS

TITLE = "What the paper leaves open"

_NETWORK, _CENTRED, _LEANING = "released network", "linear, centred loads", "linear, leaning loads"
#: Starts of the networks, and made feet; epochs of the paper's procedure.
_N, _QUICK_N, _EPOCHS, _QUICK_EPOCHS = 10, 2, 3000, 200


def compute(context: StudyContext) -> Values:
    """Read loads off centre and beside a second one, then compare sealed with vented cavities, and a film with gaps."""
    design, response, quick = context.foot_design, context.response, context.quick
    network, gap_um = context.network, response.design.gap_um
    random = random_loads(response, design.loads, 1000 if quick else 10_000, 0)
    tested = ComparedEstimators(
        response,
        {
            _NETWORK: lambda closure_um: network.force_n(closure_um / gap_um),
            _CENTRED: elastance_based_force_estimator(paper_training(response)),
            _LEANING: elastance_based_force_estimator(random),
        },
    )
    lean = leaning_load_errors(tested)
    second, by_angle = second_load_errors(tested, 1 if quick else 6)
    context.report_progress("leaning and second loads read")
    n, epochs = (_QUICK_N, _QUICK_EPOCHS) if quick else (_N, _EPOCHS)
    air = sealed_against_vented(response, n, epochs)
    context.report_progress("sealed air done")
    return {
        "n": n,
        "epochs": epochs,
        "lean": lean,
        "lever_mm": response.ball_radius_mm * np.sin(np.radians(LEANS_DEG[1])),
        "trained_lean_deg": design.loads.friction_angle_deg,
        "second": second,
        "by_angle": by_angle,
        "ball_radius_mm": design.ball_radius_mm,
        "patch_mm": [design.hertz_patch_radius_mm(gf * GRAM_FORCE_N) for gf in (150.0, 1000.0)],
        "air": air,
        "film": film_against_gaps(design, response, n, epochs, quick=quick),
    }


_ESTIMATORS = (_NETWORK, _CENTRED, _LEANING)
_ESTIMATORS_HEADING = " | ".join(f"{name}: deg, gf" for name in _ESTIMATORS)
#: Number of loads, and of each estimator mean / 95 % / worst direction and mean magnitude error.
_ERROR_CELLS = " | ".join(
    [
        f"{{errors[{_NETWORK}][n]}}",
        *(
            f"{{errors[{name}][direction_deg]:.2f}} / {{errors[{name}][direction_p95_deg]:.2f}}"
            f" / {{errors[{name}][direction_max_deg]:.2f}}, {{errors[{name}][magnitude_gf]:.1f}}"
            for name in _ESTIMATORS
        ),
    ]
)


def _deg_and_gf(pairs: Sequence[Sequence[float]]) -> tuple[str, str]:
    deg, gf = zip(*pairs, strict=True)
    return spread(deg), spread(gf)


def _up_to(force_n: float) -> str:
    return f"{force_n:.1f}" if force_n < MAX_SEARCHED_N else f"above {MAX_SEARCHED_N:.0f}"


def _beside(headings: str, columns: Sequence[dict[str, str]]) -> str:
    """Return a table of the same figures of several feet side by side."""
    return table(headings, [(name, *(cells[name] for cells in columns)) for name in columns[0]])


def _air_cells(kind: Values) -> dict[str, str]:
    """Return the figures of sealed or vented cavities."""
    cells = {
        "range of the converter, upright [N]": _up_to(kind["range_n"]),
        "first cell closed at, upright [N]": _up_to(kind["closing_n"]),
    }
    for name, um_per_n in zip(("corner", "edge", "middle"), kind["um_per_n"], strict=True):
        cells[f"mean closure of the {name}, light upright force [um/N]"] = f"{um_per_n:.3f}"
    for name, errors in zip(("change of capacitance", "elastance"), kind["linear"], strict=True):
        cells[f"designed foot, linear in {name} [deg / gf]"] = " / ".join(f"{one:.2f}" for one in errors)
    for key, name in (
        ("exact", "designed foot, paper's procedure"),
        ("made", "made feet, paper's procedure on each"),
        ("as_vented", "designed foot, networks of the vented one"),
    ):
        cells[f"{name} [deg]"], cells[f"{name} [gf]"] = _deg_and_gf(kind[key])
    for gf, bound in zip(BOUND_GF, kind["bound"], strict=True):
        cells[f"Cramer-Rao bound at {gf:g} gf, rms [deg / gf]"] = " / ".join(f"{one:.3f}" for one in bound)
    return cells


def _film_cells(one: Values) -> dict[str, str]:
    """Return the figures of the film or of the gaps."""
    (upright_n, inclined_n), (deg, gf), networks = one["range_n"], one["linear"], _deg_and_gf(one["networks"])
    return {
        "unloaded capacitance [pF]": f"{one['unloaded_pf']:.2f}",
        "mean closure, upright [um/N]": f"{one['um_per_n']:.2f}",
        "sensitivity, upright [pF/N]": f"{one['pf_per_n']:.2f}",
        "range, upright / elevation 45 deg [N]": f"{upright_n:.1f} / {inclined_n:.1f}",
        "linear read-out [deg / gf]": f"{deg:.2f} / {gf:.2f}",
        "networks [deg]": networks[0],
        "networks [gf]": networks[1],
    }


def text(values: Values) -> str:
    """Return the page's Markdown."""
    leaning = table(
        f"lean [deg], {SAME_TABLE} | loads | {_ESTIMATORS_HEADING} | in range at {_gf(IN_RANGE_GF)}",
        values["lean"],
        "{x:g} | " + _ERROR_CELLS + " | {in_range:.0%}",
    )
    second, by_angle = (
        table(f"{what}, {SAME_TABLE} | loads | {_ESTIMATORS_HEADING}", values[rows], "{x} | " + _ERROR_CELLS)
        for what, rows in (("second over floor", "second"), ("contacts apart [deg]", "by_angle"))
    )
    confinement = table(
        "Poisson's ratio | confined modulus [kPa] | width of the rim that yields [mm] | mean closure [um/N]",
        [
            (f"{poisson:g}", f"{1e3 * confined:.0f}", f"{rim_mm:.3f}", f"{closure_um:.3f}")
            for poisson, confined, rim_mm, closure_um in values["film"]["by_poisson"]
        ],
    )

    n, epochs, air, film = values["n"], values["epochs"], values["air"], values["film"]
    sealed = air["by_kind"]["sealed"]
    softest, stiffest = air["stiffness_rel"]
    patch_mm, large_patch_mm = values["patch_mm"]
    gaps, gel = (film["designs"][name] for name in ("gaps", "film"))
    exact_deg, made_deg = (np.mean(sealed[key], axis=0)[0] for key in ("exact", "made"))
    exact_gf, made_gf = (np.mean(sealed[key], axis=0)[1] for key in ("exact", "made"))
    worst_deg, worst_gf = np.max(sealed["made"], axis=0)
    first, last = values["film"]["by_poisson"][0][3], values["film"]["by_poisson"][-1][3]
    return f"""The paper leaves three loads for later (end of section III A): a force that does not go through the middle of the ball, an
external load beside the floor's, and a ball that is much deformed. Its cavities are sealed (section IV), but its model has
no air; and it ends with a film of gel in place of the gaps (section VI). This page computes each with the foot of the
released table. **The same table makes the readings, trains the networks and tests them.**

Cells of read-outs: direction error, mean / 95 % below / worst [deg], then the mean magnitude error [gf]. The released
network is one network; the two linear ones are least squares of elastance, on the paper's 362 centred loads and on
random leaning ones. Readings have one draw of the converter's noise.

## A force past the centre

The contact normal leans from the force, as with friction or on a slope: {_gf(LEANING_GF)} at elevations of
{", ".join(f"{one:g}" for one in LEANING_ELEVATIONS_DEG)} deg and 36 azimuths, the contact to four sides of each.

{leaning}

- A leaning force has a moment about the middle of the sheet: at {values["lean"][1]["x"]:g} deg its line passes {values["lever_mm"]:.1f} mm beside. A
  linear read-out of centred loads takes that moment for inclination. The paper's protocol cannot show this, as all of
  its loads are centred. The released network is trained on leans up to {values["trained_lean_deg"]:.0f} deg.
- The moment closes gaps on one side: of loads of {_gf(IN_RANGE_GF)}, {100 * values["lean"][3]["in_range"]:.0f} % are within the converter's range at {values["lean"][3]["x"]:g} deg of lean,
  {100 * values["lean"][-2]["in_range"]:.0f} % at {values["lean"][-2]["x"]:g}.

## A second load beside the floor's

The floor presses with {_gf(FLOOR_GF)} in the paper's 180 directions; a second contact lies anywhere on the ball (normals down to
{SECOND_MIN_ELEVATION_DEG:g} deg) and presses without friction. Free closures add up, then the gaps touch. The read-outs estimate one force; the
reference is the sum of both. Loads beyond the converter's full scale are left out.

{second}

With a second load of {ANGLES_SECOND_REL:g} of the floor's, by the angle between the contacts:

{by_angle}

- Contacts without friction are centred loads one by one, so a linear read-out of centred loads is nearly right for both.
- The released network, trained on one contact of any lean, errs the more the farther the contacts are apart: two
  contacts make patterns that no single one makes.
- Nine closures tell a leaning contact or a second one, but only if it is known which.

## A ball that is much deformed

Hertz's patch has {patch_mm:.2f} mm at 150 gf and {large_patch_mm:.2f} mm at 1000 gf, of a ball of {values["ball_radius_mm"]:g} mm. What small strain and that patch cost was
computed with a solver of finite strain: [less than 1 %](physics.md#small-strain-and-hertzs-patch) up to 1000 gf. Larger deformations remain open.

## Air that cannot get out

The released foot is vented. Here its cavities are sealed and **at rest**: closures compress the air, its pressure opens the
gaps by the compliance that contact uses, and nothing leaks. Walls and air have one temperature. *Paper's procedure*: a
plain network, {epochs} epochs, on the foot's own 362 changes of capacitance, asked for the 180; mean, standard deviation of
one, and worst of {n} starts (designed foot), or of {n} feet with a start each, made with tolerances
[tuned to the paper's error](experiment.md) and read exactly. No noise but in the bound, which has an unknown contact; no load is
left out, though the converter could not read some of those of soft vented feet. Ranges are searched
up to {MAX_SEARCHED_N:g} N.

{_beside("figure | vented | sealed", [_air_cells(air["by_kind"][name]) for name in ("vented", "sealed")])}

- The air is {softest:.1f} to {stiffest:.1f} times as stiff as the solid, by the pattern of closures, and stiffest against patterns that the
  solid yields to most: a sealed corner closes less than the middle, a vented one more. Air that keeps its heat would let
  the corner close by {air["adiabatic_um_per_n"][0]:.3f} um/N.
- Sealed air at rest does not explain the paper's measured {MEASURED_DIRECTION_DEG} deg and {MEASURED_MAGNITUDE_GF} gf: trained on a sealed foot itself, the
  procedure errs by {exact_deg:.1f} deg and {exact_gf:.1f} gf if it is as designed, {made_deg:.1f} deg and {made_gf:.1f} gf if made (means; the
  worst of {n} made feet has {worst_deg:.1f} deg, the worst {worst_gf:.1f} gf). What air does that leaks
  while nine elements are read one by one is not computed here.
- Unloaded readings of a sealed foot move by {air["ff_per_kpa"]:+.0f} fF per kPa less of ambient pressure, as an upright load of {air["gf_per_kpa"]:+.0f} gf would,
  and by {air["ff_per_kelvin"]:+.0f} fF per kelvin. Sealed at 100 degC, as on the paper's hot plate, the gaps would rest {air["hot_um"]:.1f} um closed.
- A network of the vented design is useless on a sealed foot, and a calibration refuses such a foot. Vent every cavity.

## A film of gel without gaps

A film of gelled polyurethane, E = {1e3 * film["youngs_mpa"][0]:.0f} kPa, covers the whole sheet in place of spacer and gaps, {film["thickness_um"]:.0f} um thick, as an elastic
layer between the same plates. Our choices: Poisson's ratio {film["poisson"]:g}, relative permittivity {film["eps_r"]:g}. Both designs have the
converter's {1e3 * NOISE_PF:g} fF of noise. The range of the gaps ends at {FULL_SCALE_PF:.0f} pF, that of the film where any part closes or opens by
{MAX_STRAIN_REL:.0%}; the film needs the converter's offset. Errors: 362 loads for the training, the 180 for the test, {NOISE_DRAWS} draws of noise;
networks on closures 9-{HIDDEN_NEURONS[0]}-{HIDDEN_NEURONS[1]}-3, {n} starts.

{_beside("figure | gaps | film", [_film_cells(one) for one in (gaps, gel)])}

- The film is {film["youngs_mpa"][1] / film["youngs_mpa"][0]:.0f} times softer than PDMS and yet has {gel["pf_per_n"] / gaps["pf_per_n"]:.2f} times the sensitivity: between two plates it cannot spread,
  and resists with a confined modulus of {1e3 * film["confined_mpa"]:.0f} kPa. The gaps close by bending of the plates, which nothing resists.
- In shear it is soft: a lateral newton slides the plates by {film["slide_um_per_n"]:.0f} um, {film["slide_um_per_n"] / film["electrode_mm"] / 10:.1f} % of an electrode. What this does to
  the overlap of electrodes is left out.

An upright newton spread over the ball, coarse mesh:

{confinement}

Over this range of Poisson's ratio the closure falls by a factor of {first / last:.0f}: compressibility, which a gel's data sheet does not state,
sets the sensitivity of a continuous film. To gain from a soft gel, it needs room to spread: pores, pillars or gaps.
"""


def _gf(force_gf: float) -> str:
    return f"{force_gf:g} gf"
