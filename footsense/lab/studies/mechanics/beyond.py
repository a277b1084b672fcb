"""Study `beyond`: force errors under off-centre (leaning) loads, and with a second contact on the ball.

Source:
    Aoyagi et al., end of section III A, where both are left for later.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure

from footsense.foot.directions import (
    angles_between_deg,
    direction_grid,
    normalized,
    paper_directions,
    random_directions,
)
from footsense.foot.force_errors import GRAM_FORCE_N, ForceErrors, evaluate_force_errors
from footsense.foot.specimen import Foot
from footsense.frames import Mask, Vector
from footsense.lab.evaluation.evaluate_models import ForceEstimator, elastance_based_force_estimator
from footsense.lab.former_page import Plots, Study, StudyContext
from footsense.lab.plots import subplot_row
from footsense.lab.training.load_cases import (
    FULL_SCALE_PF,
    measured_closure_rel,
    paper_training,
    random_loads,
)

#: Leaning force [gf]: at a lean of 40 deg its moment makes one newton close gaps on half the sheet.
LEANING_FORCE_GF = 20.0
#: Force of the share of leaning loads within the converter's range [gf]: the paper's.
IN_RANGE_SHARE_FORCE_GF = 100.0
#: Force of the floor beside a second load [gf].
FIRST_CONTACT_FORCE_GF = 50.0
#: Angles between force and contact normal [deg].
LEANS_DEG = tuple(np.arange(0.0, 41.0, 5.0).tolist())
#: Elevations of the leaning forces [deg]: at a lean of 40 deg the table still reaches the contact.
LEANING_ELEVATIONS_DEG = (65.0, 75.0, 85.0)
#: The second load over that of the floor [1].
SECOND_OVER_FIRST_FORCE = (0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 0.75, 1.0)
#: Lowest contact of the second load, as elevation of its normal [deg].
SECOND_CONTACT_MIN_ELEVATION_DEG = 30.0
#: Angle between both contacts, seen from the centre [deg]: borders of the classes.
CONTACT_ANGLE_BIN_EDGES_DEG = (0.0, 30.0, 60.0, 90.0, 120.0)
#: Second load over that of the floor, in the table by the angle between both contacts [1].
ANGLE_TABLE_SECOND_OVER_FIRST_FORCE = 0.5
#: Draws of the second load for each floor force; random loads that the second linear estimator is fitted to.
DRAWS, QUICK_DRAWS = 6, 1
RANDOM_LOADS, QUICK_RANDOM_LOADS = 10_000, 1000
SEED = 31


def inclined_unit_vectors(force: Vector, lean_deg: float, turn_deg: float) -> Vector:
    """Return unit vectors inclined to forces by an angle [deg], shape (n, 3).

    Args:
        force: Directions, shape (n, 3), none along x.
        lean_deg: The angle [deg].
        turn_deg: Side of the lean: 0 is down the meridian, 90 across it [deg].
    """
    along = normalized(force)
    across = normalized(np.cross([0.0, 0.0, 1.0], along))
    down = np.cross(across, along)
    lean, turn = np.radians([lean_deg, turn_deg])
    side = np.cos(turn) * down + np.sin(turn) * across
    inclined: Vector = np.cos(lean) * along + np.sin(lean) * side
    return inclined


#: Estimators under test.
NETWORK, CENTRED = "released network", "linear, fitted to centred loads"
LEANING_ESTIMATOR = "linear, fitted to leaning loads"


class _EstimatorsUnderTest:
    """Force estimators under test, fed with noisy closures."""

    def __init__(self, context: StudyContext) -> None:
        self.response, network = context.response, context.network
        self._foot, gap_um = Foot(self.response), self.response.design.gap_um
        n_random = QUICK_RANDOM_LOADS if context.quick else RANDOM_LOADS
        self._estimators: dict[str, ForceEstimator] = {
            NETWORK: lambda closure_um: network.force_n(closure_um / gap_um),
            CENTRED: elastance_based_force_estimator(paper_training(self.response)),
            LEANING_ESTIMATOR: elastance_based_force_estimator(
                random_loads(self.response, context.foot_design.loads, n_random, SEED)
            ),
        }

    def measured_um(self, free_um: Vector) -> tuple[Vector, Mask]:
        """Return noisy closures [um], shape (n, 9), and which loads are within the converter's range, shape (n,)."""
        design = self.response.design
        closure_um = design.closure_um(
            self._foot.capacitance_of_free_closures_pf(free_um), self._foot.unloaded_pf
        )
        noisy = measured_closure_rel(design, closure_um, np.random.default_rng(SEED)) * design.gap_um
        return noisy, design.capacitance_pf(closure_um).max(axis=1) < FULL_SCALE_PF

    def errors_by_estimator(self, measured_um: Vector, truth_n: Vector) -> dict[str, ForceErrors]:
        """Return the force errors of each estimator on measured closures [um], by its name."""
        return {
            name: evaluate_force_errors(truth_n, read(measured_um)) for name, read in self._estimators.items()
        }


@dataclass(frozen=True, kw_only=True)
class Results:
    """Results of the study `beyond`: force errors of each estimator by lean, second force and contact angle.

    Attributes:
        smallest_lean_lever_arm_mm: Distance of the force's line from the middle at the smallest lean [mm].
        max_trained_lean_deg: Largest lean in the network's training [deg].
        by_lean: At each of `LEANS_DEG`.
        in_range_share_by_lean: Share of the loads of `IN_RANGE_SHARE_FORCE_GF` within the converter's range at each
            lean [1].
        by_second_force: At each of `SECOND_OVER_FIRST_FORCE`.
        by_angle_between_contacts: At `ANGLE_TABLE_SECOND_OVER_FIRST_FORCE`, by the angle between the contacts [deg].
    """

    smallest_lean_lever_arm_mm: float
    max_trained_lean_deg: float
    by_lean: list[dict[str, ForceErrors]]
    in_range_share_by_lean: list[float]
    by_second_force: list[dict[str, ForceErrors]]
    by_angle_between_contacts: dict[str, dict[str, ForceErrors]]


def leaning_load_errors(estimators: _EstimatorsUnderTest) -> tuple[list[dict[str, ForceErrors]], list[float]]:
    """Return the force errors at each lean, and the share of loads of `IN_RANGE_SHARE_FORCE_GF` within converter range.

    108 force directions, the contact to four sides of each.
    """
    direction = direction_grid(5.0 + 10.0 * np.arange(36), list(LEANING_ELEVATIONS_DEG))
    truth_n = np.tile(LEANING_FORCE_GF * GRAM_FORCE_N * direction, (4, 1))
    found, within = [], []
    for lean_deg in LEANS_DEG:
        normal = np.concatenate(
            [inclined_unit_vectors(direction, lean_deg, 90.0 * turn) for turn in range(4)]
        )
        measured_um, inside = estimators.measured_um(estimators.response.free_closure_um(normal, truth_n))
        found.append(estimators.errors_by_estimator(measured_um[inside], truth_n[inside]))
        larger_n = truth_n * (IN_RANGE_SHARE_FORCE_GF / LEANING_FORCE_GF)
        _, inside = estimators.measured_um(estimators.response.free_closure_um(normal, larger_n))
        within.append(float(inside.mean()))
    return found, within


class _SecondLoads:
    """Random second contacts and their forces, drawn once and scaled by a share of the first force.

    Attributes:
        floor_n: Force of the floor, centred [N], shape (n, 3).
        distance_deg: Angle between the contacts [deg], shape (n,).
    """

    def __init__(self, estimators: _EstimatorsUnderTest, draws: int) -> None:
        """Draw random second contacts above the lowest elevation."""
        self._tested = estimators
        direction = np.tile(paper_directions("verification"), (draws, 1))
        rng = np.random.default_rng(SEED)
        self._normal = random_directions(rng, len(direction), SECOND_CONTACT_MIN_ELEVATION_DEG)
        self._unit_n = FIRST_CONTACT_FORCE_GF * GRAM_FORCE_N * self._normal
        self.floor_n = FIRST_CONTACT_FORCE_GF * GRAM_FORCE_N * direction
        self._floor_um = estimators.response.free_closure_um(direction, self.floor_n)
        self.distance_deg = angles_between_deg(direction, self._normal)

    def noisy_two_contact_loads(self, share: float) -> tuple[Vector, Vector, Mask]:
        """Return noisy closures [um], the sum of both forces [N], and which loads are in range, for a share."""
        second_n = share * self._unit_n
        free_um = self._floor_um + self._tested.response.free_closure_um(self._normal, second_n)
        measured_um, inside = self._tested.measured_um(free_um)
        return measured_um, self.floor_n + second_n, inside


def _errors_by_angle_between_contacts(
    estimators: _EstimatorsUnderTest, second: _SecondLoads
) -> dict[str, dict[str, ForceErrors]]:
    """Return the force errors by estimator, for each angle between the two contacts."""
    measured_um, truth_n, inside = second.noisy_two_contact_loads(ANGLE_TABLE_SECOND_OVER_FIRST_FORCE)
    found = {}
    for low, high in pairwise(CONTACT_ANGLE_BIN_EDGES_DEG):
        here = inside & (second.distance_deg >= low) & (second.distance_deg < high)
        if here.any():
            found[f"{low:g} to {high:g}"] = estimators.errors_by_estimator(measured_um[here], truth_n[here])
    return found


def compute(context: StudyContext) -> tuple[Results, Plots]:
    """Return the force errors under leaning loads and with a second contact, with figures."""
    estimators = _EstimatorsUnderTest(context)
    lean, within = leaning_load_errors(estimators)
    context.report_progress(f"beyond: {len(LEANS_DEG)} leans read")
    second = _SecondLoads(estimators, QUICK_DRAWS if context.quick else DRAWS)
    shared = []
    for share in SECOND_OVER_FIRST_FORCE:
        measured_um, truth_n, inside = second.noisy_two_contact_loads(share)
        shared.append(estimators.errors_by_estimator(measured_um[inside], truth_n[inside]))
    results = Results(
        smallest_lean_lever_arm_mm=context.response.ball_radius_mm * float(np.sin(np.radians(LEANS_DEG[1]))),
        max_trained_lean_deg=context.foot_design.loads.friction_angle_deg,
        by_lean=lean,
        in_range_share_by_lean=within,
        by_second_force=shared,
        by_angle_between_contacts=_errors_by_angle_between_contacts(estimators, second),
    )
    figures = {
        "beyond-lean.png": _error_curves_figure(LEANS_DEG, "lean of the contact normal [deg]", lean),
        "beyond-second.png": _error_curves_figure(
            SECOND_OVER_FIRST_FORCE, "second load over the floor's", shared
        ),
    }
    return results, figures


def _error_curves_figure(x: Sequence[float], label: str, errors: list[dict[str, ForceErrors]]) -> Figure:
    """Return the figure of mean direction and magnitude errors over x, one curve per estimator."""
    figure, row = subplot_row(2, 8.2, 3.9)
    quantities = (
        ("direction_deg", "mean direction error [deg]"),
        ("magnitude_gf", "mean magnitude error [gf]"),
    )
    for axes, (quantity, what) in zip(row, quantities, strict=True):
        for name in errors[0]:
            axes.plot(x, [getattr(level[name], quantity) for level in errors], "o-", ms=4, label=name)
        axes.set(xlabel=label, ylabel=what, yscale="log")
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter("{x:g}")
        axes.tick_params(which="minor", labelsize=7)
        axes.grid(alpha=0.3, which="both")
    row[0].legend(fontsize=8)
    return figure


STUDY = Study(name="beyond", title="Beyond one centred force", compute=compute)
