"""Computing time of each fidelity level, and error against the finest level on the same loads."""

from dataclasses import dataclass
from timeit import default_timer

import numpy as np

from footsense.foot.capacitor import CapacitorDesign
from footsense.foot.force_errors import evaluate_force_errors
from footsense.foot.specimen import ContactLoads
from footsense.frames import Vector
from footsense.lab.evaluation.evaluate import ForceEstimator, rms
from footsense.lab.fidelity.levels import FidelityLevel, LevelResponse


def run_and_time_level(
    level: FidelityLevel, loads: ContactLoads, repeats: int = 1
) -> tuple[LevelResponse, float]:
    """Return a fidelity level's response to given loads, and its shortest computing time of several runs [s]."""
    taken_s = []
    for _ in range(repeats):
        start = default_timer()
        answer = level(loads.normal, loads.force_n)
        taken_s.append(default_timer() - start)
    return answer, min(taken_s)


def reported_force_n(
    network: ForceEstimator, design: CapacitorDesign, level_response: LevelResponse
) -> Vector:
    """Return the network's force estimate [N], shape (n, 3), from the capacitances of a level's response.

    Args:
        network: Makes forces [N] of closures over the gap [1].
        design: Dimensions of the capacitors.
        level_response: Closures and capacitances of the elements.
    """
    closure_um = design.closure_um(level_response.capacitance_pf, np.full(9, design.unloaded_pf))
    return network(closure_um / design.gap_um)


@dataclass(frozen=True, slots=True)
class FidelityError:
    """Errors of one fidelity level against the finest on the same loads.

    Attributes:
        closure_difference_rms_rel: Difference of the closures, rms over rms of the reference [1].
        closure_difference_max_um: The largest difference of a closure [um].
        capacitance_difference_rms_rel: Difference of the capacitance changes, rms over rms of the reference [1].
        capacitance_difference_max_pf: The largest difference of a capacitance [pF].
        direction_difference_deg: Mean angle between the forces that the network reads from both [deg].
        magnitude_difference_gf: Mean difference of their magnitudes [gf].
        n: Loads.
    """

    closure_difference_rms_rel: float
    closure_difference_max_um: float
    capacitance_difference_rms_rel: float
    capacitance_difference_max_pf: float
    direction_difference_deg: float
    magnitude_difference_gf: float
    n: int


def fidelity_error(
    level_response: LevelResponse, finest: LevelResponse, network: ForceEstimator, design: CapacitorDesign
) -> FidelityError:
    """Return the error of a level's response against that of a finer level.

    Args:
        level_response: To the loads.
        finest: To the same loads.
        network: As in `reported_force_n`.
        design: Dimensions of the capacitors.
    """
    closure_um = level_response.closure_um - finest.closure_um
    capacitance_pf = level_response.capacitance_pf - finest.capacitance_pf
    change_pf = finest.capacitance_pf - design.unloaded_pf
    read = evaluate_force_errors(
        reported_force_n(network, design, finest), reported_force_n(network, design, level_response)
    )
    return FidelityError(
        closure_difference_rms_rel=rms(closure_um) / rms(finest.closure_um),
        closure_difference_max_um=float(np.abs(closure_um).max()),
        capacitance_difference_rms_rel=rms(capacitance_pf) / rms(change_pf),
        capacitance_difference_max_pf=float(np.abs(capacitance_pf).max()),
        direction_difference_deg=read.direction_deg,
        magnitude_difference_gf=read.magnitude_gf,
        n=len(closure_um),
    )
