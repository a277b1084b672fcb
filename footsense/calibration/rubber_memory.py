"""Correct a session's unloaded readings for the creep that remains in the rubber from earlier presses.

Rubber that creeps and has play still pushes after a release, where the foot was pressed last: with a force a u in that
press's direction u, b f of its force f, and c m of the mean m of the last presses. Half a second after a press of
100 gf that is 0.02 N, or 40 fF. Taken for drift, it is subtracted from the next press, and the fit explains what is
missing by strays of 0.3 pF. A robot tares rested feet, and its baseline follows 0.15 fF/s at most.

The unloaded distance of the plates of each element at press i is, with the closures by force S of the designed foot,

    D_i = D + drift - k sum_j S_j (a_j u_j + b_j f_j + c_j m_j),        j: the press before, and the press itself

since the reading is interpolated between both ends of the press. The scale k of each element contains its stray. Least
squares over a session find a_j, b_j and c_j, and the scales, in turn, beside the mean and a linear drift of each
element.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from footsense.calibration.loads import LoadSet
from footsense.calibration.recorded_session import RecordedSession
from footsense.calibration.twin import N_PARAMETERS, FootTwin
from footsense.foot.directions import normalized
from footsense.foot.gap_contact import element_means
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import ContactLoads
from footsense.frames import ELEMENTS, Vector

#: Weight of the newest press in the mean of the last ones [1]: creep of ten seconds, presses of one.
_NEWEST_PRESS_WEIGHT = 0.1
#: Force that stays after a release [N], which gives the slopes.
_RESIDUAL_FORCE_N = 0.02
#: Square of the scatter of an unloaded distance [um] over that of a_j [N], b_j and c_j [1], and of a scale [1], before
#: they are known.
_RIDGE, _SCALE_RIDGE = (0.01 / 0.02) ** 2, (0.01 / 0.15) ** 2
_FIT_ROUNDS = 4


def loads_with_creep_corrected_baseline(
    response: FootResponse, sessions: Sequence[RecordedSession]
) -> LoadSet:
    """Return the loads of all sessions, with unloaded readings corrected for remaining creep.

    Args:
        response: Response table of the foot type.
        sessions: Sessions with loads.
    """
    return LoadSet.joined([correct_baselines_for_creep(response, session.loads) for session in sessions])


def correct_baselines_for_creep(response: FootResponse, loads: LoadSet) -> LoadSet:
    """Return the loads with unloaded readings as of a fully relaxed foot, corrected for remaining creep.

    Args:
        response: Response table of the foot type.
        loads: Loads of one session in the order of time, at least one.
    """
    after_um = _residual_closures_um(FootTwin(response, loads.median_baseline_pf), loads.force_n)
    before_um = np.concatenate([np.zeros_like(after_um[:1]), after_um[:-1]])
    memory_um = np.concatenate([before_um, after_um], axis=2)
    distance_um = response.design.plate_distance_um(loads.baseline_pf)
    n = len(distance_um)
    steady = np.linalg.qr(np.column_stack([np.ones(n), np.linspace(-1.0, 1.0, n)]))[0]

    def detrended(values: Vector) -> Vector:
        """Return values over the presses, shape (n, ...), without their mean and linear drift."""
        flat = values.reshape(n, -1)
        detrended_values: Vector = flat - steady @ (steady.T @ flat)
        return detrended_values

    slopes = detrended(memory_um).reshape(n, ELEMENTS, -1)
    moved_um, scale = -detrended(distance_um), np.ones((ELEMENTS, 1))
    for _ in range(_FIT_ROUNDS):
        scaled = (scale * slopes).reshape(n * ELEMENTS, -1)
        curvature = scaled.T @ scaled + _RIDGE * np.eye(scaled.shape[1])
        staying = np.linalg.solve(curvature, scaled.T @ moved_um.ravel())
        unscaled_um = slopes @ staying
        overlap = (unscaled_um * moved_um).sum(axis=0) + _SCALE_RIDGE
        scale = (overlap / ((unscaled_um**2).sum(axis=0) + _SCALE_RIDGE))[:, None]
    remembered_um = scale[:, 0] * (memory_um @ staying)
    return replace(loads, baseline_pf=loads.baseline_pf * distance_um / (distance_um + remembered_um))


def _residual_closures_um(twin: FootTwin, force_n: Vector) -> Vector:
    """Return the gap closures left after each press, per creep coefficient a, b and c [um], shape (n, elements, 3)."""
    mean_n, means_n = np.zeros(3), []
    for one_n in force_n:
        mean_n = mean_n + _NEWEST_PRESS_WEIGHT * (one_n - mean_n)
        means_n.append(mean_n)
    normal = normalized(force_n)
    designed = np.zeros(N_PARAMETERS)
    unit_um = [
        element_means(
            twin.cell_closures_um(
                designed, ContactLoads(normal, np.tile(_RESIDUAL_FORCE_N * axis, (len(normal), 1)))
            )
        )
        / _RESIDUAL_FORCE_N
        for axis in np.eye(3)
    ]
    staying = np.stack([normal, force_n, np.array(means_n)], axis=2)
    closures_um: Vector = np.stack(unit_um, axis=2) @ staying
    return closures_um
