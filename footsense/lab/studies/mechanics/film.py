"""Study `film`: a soft gel film of 20 kPa as dielectric, compared with the spacer and its air gaps.

Source:
    Aoyagi et al., section VI.
"""

from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

from footsense.foot import gap_contact
from footsense.foot.capacitor import Capacitor
from footsense.foot.directions import directions, normalized
from footsense.foot.force_errors import ForceErrors, evaluate_force_errors
from footsense.foot.specimen import Foot
from footsense.frames import Vector
from footsense.lab.evaluation.evaluate_models import elastance_based_force_estimator
from footsense.lab.fem.gel_layer import GelLayerDesign, vertical_closure_um_per_n
from footsense.lab.fem.mesh import COARSE_MESH, RELEASED_MESH
from footsense.lab.former_page import MeanStd, Plots, Study, StudyContext
from footsense.lab.geometry import Material
from footsense.lab.plots import subplot_row
from footsense.lab.response import make_response
from footsense.lab.training.load_cases import (
    FULL_SCALE_PF,
    NOISE_PF,
    Cases,
    measured_closure_rel,
    paper_training,
    paper_verification,
    sensed_closure_um,
)
from footsense.lab.training.paper_procedure import HIDDEN_NEURONS, PaperTraining, start_weights_by_seed

#: Nothing is singular where the film covers everything: no layers of thin elements.
FILM_SIZE, COARSE_FILM_SIZE = replace(RELEASED_MESH, edge_layers=0), replace(COARSE_MESH, edge_layers=0)
#: Largest share of the film's thickness that may close anywhere [1]: beyond, a gel is no longer linear.
STRAIN_LIMIT_REL = 0.1
#: Poisson's ratios of the table on confinement.
POISSONS, QUICK_POISSONS = (0.3, 0.45, 0.49, 0.499, 0.4999), (0.3, 0.4999)
#: Load of the sensitivity [N]: no gap closes.
SENSITIVITY_FORCE_N = 0.05
#: Loads of the search for the range [N].
RANGE_SEARCH_LOADS_N = np.geomspace(0.05, 50.0, 200)
#: Networks for each design, and epochs of training.
SEEDS, QUICK_SEEDS = 6, 2
EPOCHS, QUICK_EPOCHS = 3000, 300
#: Seed of the converter's noise, and draws of it for the 180 cases.
NOISE_SEED, DRAWS = 7, 20

_UPWARD = np.array([[0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorDesign:
    """A sensor design with air gaps or with a gel film: capacitor and closure function.

    Attributes:
        name: Label in the figure.
        capacitor: Electrical design of the elements.
        closure_um: Makes closures as capacitance has them [um], shape (n, 9), of normals and forces [N], (n, 3) each.
        used_range_rel: Tells the used part of the range under a load (normal and force, (1, 3) each) [1].
    """

    name: str
    capacitor: Capacitor
    closure_um: Callable[[Vector, Vector], Vector]
    used_range_rel: Callable[[Vector, Vector], float]


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignPerformance:
    """Capacitance, closure, sensitivity, force range and force errors of one sensor design.

    Attributes:
        unloaded_pf: Capacitance of an unloaded element [pF].
        closure_um_per_n: Mean closure of the elements under an upright force [um/N].
        sensitivity_pf_per_n: Mean change of capacitance with it [pF/N].
        upright_range_n: Largest upright force in range [N].
        range_at_45_deg_n: Largest force at an elevation of 45 deg in range [N].
        linear_estimator_errors: Errors of the linear estimator of elastance on the paper's protocol, with noise.
        direction_error_deg: Direction errors of networks on closures.
        magnitude_error_gf: Magnitude errors of networks on closures.
    """

    unloaded_pf: float
    closure_um_per_n: float
    sensitivity_pf_per_n: float
    upright_range_n: float
    range_at_45_deg_n: float
    linear_estimator_errors: ForceErrors
    direction_error_deg: MeanStd
    magnitude_error_gf: MeanStd


@dataclass(frozen=True, slots=True, kw_only=True)
class ConfinedFilm:
    """Stiffness and closure of a gel film with another Poisson's ratio, confined between stiff layers.

    Attributes:
        confined_modulus_mpa: Modulus of the confined layer [MPa].
        rim_relief_length_mm: Relief length at the rim [mm].
        mean_closure_um_per_n: Mean closure under an upright newton [um].
    """

    confined_modulus_mpa: float
    rim_relief_length_mm: float
    mean_closure_um_per_n: float


@dataclass(frozen=True, kw_only=True)
class Results:
    """Results of the study `film`: figures of the designs with air gaps and with gel film.

    Attributes:
        film: The film.
        pdms_plate_youngs_mpa: Young's modulus of the plates [MPa].
        sheet_mm: Side of the sheet [mm].
        electrode_mm: Side of an electrode [mm].
        air_gap_design: Figures of the design with gaps.
        gel_film_design: Figures of the design with the film.
        by_poisson: Confinement, by Poisson's ratio.
    """

    film: GelLayerDesign
    pdms_plate_youngs_mpa: float
    sheet_mm: float
    electrode_mm: float
    air_gap_design: DesignPerformance
    gel_film_design: DesignPerformance
    by_poisson: dict[str, ConfinedFilm]


def gap_design(context: StudyContext) -> SensorDesign:
    """Return the sensor design with air gaps, from the released table."""
    foot = Foot(context.response)
    return SensorDesign(
        name="air_gap_design",
        capacitor=context.response.design,
        closure_um=lambda normal, force_n: sensed_closure_um(foot, normal, force_n),
        used_range_rel=lambda normal, force_n: float(
            foot.capacitance_pf(normal, force_n).max() / FULL_SCALE_PF
        ),
    )


def film_design(context: StudyContext, film: GelLayerDesign) -> SensorDesign:
    """Return the sensor design with the gel film, after a finite element solve."""
    size = COARSE_FILM_SIZE if context.quick else FILM_SIZE
    response = make_response(context.foot_design, size, layer=film.layer)
    capacitor = film.equivalent_air_capacitor(context.foot_design)

    def closure_um(normal: Vector, force_n: Vector) -> Vector:
        """Return the mean closures [um], shape (n, 9)."""
        distance_um = capacitor.gap_um - response.free_closure_um(normal, force_n)
        sensed = gap_contact.capacitance_pf(capacitor, distance_um)
        return capacitor.closure_um(sensed, np.full(9, capacitor.unloaded_pf))

    def used_range_rel(normal: Vector, force_n: Vector) -> float:
        """Return the share of the measuring range used by a load [1]."""
        strain = np.abs(response.free_closure_um(normal, force_n)) / capacitor.gap_um
        return float(strain.max() / STRAIN_LIMIT_REL)

    return SensorDesign(
        name="film", capacitor=capacitor, closure_um=closure_um, used_range_rel=used_range_rel
    )


def _max_force_in_range_n(sensor: SensorDesign, direction: Vector) -> float:
    """Return the largest of `RANGE_SEARCH_LOADS_N` that is in range for a centred contact [N]."""
    # A larger load never returns into the range, so bisect.
    inside = (
        bisect_left(
            RANGE_SEARCH_LOADS_N,
            1.0,
            lo=1,
            key=lambda load_n: sensor.used_range_rel(direction, load_n * direction),
        )
        - 1
    )
    return float(RANGE_SEARCH_LOADS_N[inside])


def measure_design(context: StudyContext, sensor: SensorDesign) -> DesignPerformance:
    """Return sensitivity, range and errors of a sensor design under a noise [pF] equal for all."""
    rng = np.random.default_rng(NOISE_SEED)
    capacitor = sensor.capacitor

    def noisy(force_n: Vector) -> Cases:
        """Return load cases with noisy closures for forces [N]."""
        closure_um = sensor.closure_um(normalized(force_n), force_n)
        return Cases(force_n, capacitor.gap_um * measured_closure_rel(capacitor, closure_um, rng))

    training = noisy(paper_training(context.response).force_n)
    test = noisy(np.tile(paper_verification(context.response).force_n, (DRAWS, 1)))
    seeds, epochs = (QUICK_SEEDS, QUICK_EPOCHS) if context.quick else (SEEDS, EPOCHS)
    networks = PaperTraining(capacitor, training, "closure").train(start_weights_by_seed(seeds), epochs)
    answers = [evaluate_force_errors(test.force_n, read(test.closure_um)) for read in networks]
    small_um = sensor.closure_um(_UPWARD, SENSITIVITY_FORCE_N * _UPWARD)
    change_pf = capacitor.capacitance_pf(small_um) - capacitor.unloaded_pf
    context.report_progress(f"film: {sensor.name} measured")
    return DesignPerformance(
        unloaded_pf=capacitor.unloaded_pf,
        closure_um_per_n=float(small_um.mean() / SENSITIVITY_FORCE_N),
        sensitivity_pf_per_n=float(change_pf.mean() / SENSITIVITY_FORCE_N),
        upright_range_n=_max_force_in_range_n(sensor, _UPWARD),
        range_at_45_deg_n=_max_force_in_range_n(sensor, directions(0.0, 45.0)[None]),
        linear_estimator_errors=evaluate_force_errors(
            test.force_n, elastance_based_force_estimator(training)(test.closure_um)
        ),
        direction_error_deg=MeanStd.of_values(answer.direction_deg for answer in answers),
        magnitude_error_gf=MeanStd.of_values(answer.magnitude_gf for answer in answers),
    )


def compute(context: StudyContext) -> tuple[Results, Plots]:
    """Return the figures of the designs with air gaps and with gel film, with a figure."""
    foot_design = context.foot_design
    film = GelLayerDesign(thickness_mm=foot_design.spacer_mm)
    gaps, gel = sensors = gap_design(context), film_design(context, film)
    context.report_progress("film: the foot with the film is solved")
    poissons = QUICK_POISSONS if context.quick else POISSONS
    films = [replace(film, gel=Material(film.gel.youngs_mpa, poisson)) for poisson in poissons]
    closures = vertical_closure_um_per_n(foot_design, COARSE_FILM_SIZE, films)
    results = Results(
        film=film,
        pdms_plate_youngs_mpa=foot_design.pdms.youngs_mpa,
        sheet_mm=foot_design.sheet_mm,
        electrode_mm=foot_design.electrode_mm,
        air_gap_design=measure_design(context, gaps),
        gel_film_design=measure_design(context, gel),
        by_poisson={
            f"{nu:g}": ConfinedFilm(
                confined_modulus_mpa=other.gel.confined_modulus_mpa,
                rim_relief_length_mm=other.rim_decay_length_mm,
                mean_closure_um_per_n=closure_um,
            )
            for nu, other, closure_um in zip(poissons, films, closures, strict=True)
        },
    )
    return results, {"film.png": _figure(sensors)}


def _figure(sensors: Sequence[SensorDesign]) -> Figure:
    """Return the figure of corner and middle capacitance over a vertical force, up to each design's range."""
    figure, (absolute, change) = subplot_row(2, 8.2, 3.9)
    for colour, sensor in zip(("C0", "C1"), sensors, strict=True):
        loads_n = np.linspace(0.0, _max_force_in_range_n(sensor, _UPWARD), 30)
        closure_um = sensor.closure_um(np.repeat(_UPWARD, len(loads_n), axis=0), loads_n[:, None] * _UPWARD)
        sensed_pf = sensor.capacitor.capacitance_pf(closure_um)
        for element, style, where in ((0, "-", "corner"), (4, "--", "middle")):
            label = f"{sensor.name}, {where}"
            absolute.plot(loads_n, sensed_pf[:, element], style, color=colour, label=label)
            change.plot(loads_n, sensed_pf[:, element] / sensed_pf[0, element] - 1.0, style, color=colour)
    absolute.axhline(FULL_SCALE_PF, color="k", lw=0.8, ls=":", label="full scale without offset")
    absolute.set(xlabel="upright force [N]", ylabel="capacitance [pF]", ylim=(0.0, None))
    change.set(xlabel="upright force [N]", ylabel="change over rest [1]")
    absolute.legend(fontsize=8)
    return figure


STUDY = Study(
    name="film",
    title="A soft film without gaps",
    compute=compute,
    template_names={"HIDDEN_NEURONS": HIDDEN_NEURONS, "NOISE_PF": NOISE_PF},
    uses_network=False,
)
