"""The gel film of the paper's outlook beside the released foot's gaps: sensitivity, range, and errors of read-outs.

The film fills the whole area between the plates, electrodes and bars alike, and takes the place of the bars in the
weak form of `fem/quarter.py`: an elastic layer between the two bodies, without elements of its own, so that nothing in
it can lock, however soft or incompressible it is. It is bonded to two plates that are far stiffer and cannot spread
sideways but near its rim, within l = t sqrt(M / (12 G)), lateral flow being a parabola between the plates: it resists
being pressed with the confined modulus M = lambda + 2 G and not with E.

Source:
    Aoyagi et al., section VI.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from footsense.foot import gap_contact
from footsense.foot.capacitor import Capacitor
from footsense.foot.directions import directions, normalized
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Specimen
from footsense.frames import ELEMENTS, Vector
from footsense.lab.evaluation.evaluate_models import elastance_based_force_estimator
from footsense.lab.evaluation.sealed_cavities import SMALL_N, UPWARD, largest_force_n, mean_errors
from footsense.lab.fem.elasticity import BondedLayer
from footsense.lab.fem.mesh import COARSE_MESH, RELEASED_MESH
from footsense.lab.geometry import UM_PER_MM, FootDesign, Material
from footsense.lab.response import make_response
from footsense.lab.training.load_cases import FULL_SCALE_PF, Cases, measured_closure_rel, sensed_closure_um
from footsense.lab.training.paper_procedure import PaperTraining, start_weights_by_seed
from footsense.sim.loads.press_sequence import paper_presses

#: Gelled polyurethane; the paper gives E = 20 kPa, Poisson's ratio is a choice.
_GEL = Material(0.020, 0.49)
#: Its relative permittivity [1], a choice: capacitance and sensitivity are proportional to it.
_EPS_R = 5.0
#: Faces that a film covers: cavities and bars alike.
FILM_FACES = "bars|cell.*"
#: Largest share of a film's thickness that may close anywhere [1]: beyond, a gel is no longer linear.
MAX_STRAIN_REL = 0.1
#: Draws of the converter's noise for the 180 test loads.
NOISE_DRAWS = 20


class _Sensor(NamedTuple):
    """A design with gaps or with a film: its capacitors, closures of loads [um], and their used share of the range."""

    capacitor: Capacitor
    closure_um: Callable[[Vector, Vector], Vector]
    used_rel: Callable[[Vector, Vector], float]


def film_against_gaps(
    design: FootDesign, response: FootResponse, n: int, epochs: int, *, quick: bool
) -> dict[str, Any]:
    """Return figures of the designs with gaps and with a film.

    Args:
        design: The foot with gaps.
        response: Its table.
        n: Start weights of each network.
        epochs: Of the networks' training.
        quick: Whether to solve on a coarse mesh.
    """
    foot = Specimen(response)
    # Nothing is singular where the film covers everything: no layers of thin elements.
    size = replace(COARSE_MESH if quick else RELEASED_MESH, edge_layers=0)
    solved = make_response(design, size, layer=BondedLayer(_GEL, design.spacer_mm, FILM_FACES))
    capacitor = Capacitor(  # of air
        gap_um=UM_PER_MM * design.spacer_mm,
        film_um=0.0,
        film_eps_r=1.0,
        electrode_area_mm2=_EPS_R * design.electrode_mm**2,
    )

    def film_closure_um(normal: Vector, force_n: Vector) -> Vector:
        distance_um = capacitor.gap_um - solved.free_closure_um(normal, force_n)
        sensed_pf = gap_contact.capacitance_pf(capacitor, distance_um)
        return capacitor.closure_um(sensed_pf, np.full(ELEMENTS, capacitor.unloaded_pf))

    sensors = {
        "gaps": _Sensor(
            response.design,
            lambda normal, force_n: sensed_closure_um(foot, normal, force_n),
            lambda normal, force_n: foot.capacitance_pf(normal, force_n).max() / FULL_SCALE_PF,
        ),
        "film": _Sensor(
            capacitor,
            film_closure_um,
            lambda normal, force_n: (
                np.abs(solved.free_closure_um(normal, force_n)).max() / capacitor.gap_um / MAX_STRAIN_REL
            ),
        ),
    }
    return {
        "youngs_mpa": [_GEL.youngs_mpa, design.pdms.youngs_mpa],
        "poisson": _GEL.poisson,
        "eps_r": _EPS_R,
        "thickness_um": capacitor.gap_um,
        "confined_mpa": _GEL.confined_modulus_mpa,
        "designs": {name: _sensor_figures(sensor, n, epochs) for name, sensor in sensors.items()},
    }


def _sensor_figures(sensor: _Sensor, n: int, epochs: int) -> dict[str, Any]:
    """Return sensitivity, range and errors of a design, whose converter has the same noise [pF] with any."""
    rng, capacitor = np.random.default_rng(0), sensor.capacitor

    def noisy(force_n: Vector) -> Cases:
        closure_um = sensor.closure_um(normalized(force_n), force_n)
        return Cases(force_n, capacitor.gap_um * measured_closure_rel(capacitor, closure_um, rng))

    training = noisy(paper_presses("training"))
    test = noisy(np.tile(paper_presses("verification"), (NOISE_DRAWS, 1)))
    networks = PaperTraining(capacitor, training, "closure").train(start_weights_by_seed(n), epochs)
    small_um = sensor.closure_um(UPWARD, SMALL_N * UPWARD)
    change_pf = capacitor.capacitance_pf(small_um) - capacitor.unloaded_pf
    return {
        "unloaded_pf": capacitor.unloaded_pf,
        "um_per_n": small_um.mean() / SMALL_N,
        "pf_per_n": change_pf.mean() / SMALL_N,
        "range_n": [largest_force_n(sensor.used_rel, directions(0.0, [deg])) for deg in (90.0, 45.0)],
        "linear": mean_errors(test, elastance_based_force_estimator(training)(test.closure_um)),
        "networks": [mean_errors(test, read(test.closure_um)) for read in networks],
    }
