"""A foot, calibrated: from pokes to the parameters that its pack holds."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.calibration.fit.correction import learn
from footsense.calibration.fit.parameter_fit import Fit, fit
from footsense.calibration.fit.predicted_uncertainty import Foreseen, foresee, require_known
from footsense.calibration.fit.twin import GAIN, GAP, MOUNT, STIFFNESS, STRAY, FootTwin
from footsense.calibration.loads.load_set import PokeSet
from footsense.errors import CalibrationError
from footsense.foot.network_card import TrainedInputs
from footsense.foot.parameters import FootParameters
from footsense.foot.response_table import FootResponse
from footsense.frames import ELEMENTS
from footsense.ports import Estimator
from footsense.sim.foot.fabrication import rotation

Vector = NDArray[np.float64]

#: Fewer do not even tell the strays, whatever was known before.
LEAST_POKES = 5
#: Median distance of the pokes' nine readings from the twin's [standard deviations] beyond which it is none of them.
_STRANGE = 12.0
#: A foot this much softer or stiffer than designed was not made of that rubber.
_STIFFNESS_FROM, _STIFFNESS_TO = 0.25, 4.0


class Design(NamedTuple):
    """What is known of a foot before it is poked.

    Attributes:
        response: How feet of its type yield.
        network: Makes the network for a number of rows.
        card: What the network's card says.
    """

    response: FootResponse
    network: Callable[[int], Estimator]
    card: TrainedInputs


class Calibrated(NamedTuple):
    """A foot that was calibrated.

    Attributes:
        parameters: What its pack holds.
        found: The fit of its twin.
        foreseen: How wrong it will be because the pokes do not tell more.
    """

    parameters: FootParameters
    found: Fit
    foreseen: Foreseen


def calibrate(design: Design, pokes: PokeSet) -> Calibrated:
    """Find what makes a foot differ from its design.

    Args:
        design: What is known of it before.
        pokes: At least `LEAST_POKES`, of any sessions.

    Raises:
        CalibrationError: The pokes are too few, do not tell enough, or the foot they tell of cannot be.
    """
    if len(pokes) < LEAST_POKES:
        raise CalibrationError(
            f"{len(pokes)} pokes; at least {LEAST_POKES} from all sides make a calibration"
        )
    twin = FootTwin(design.response, pokes.unloaded_pf)
    found = fit(twin, pokes)
    stiffness = 1.0 + float(found.parameters[STIFFNESS][0])
    if not _STIFFNESS_FROM < stiffness < _STIFFNESS_TO:
        raise CalibrationError(
            f"the foot would be {stiffness:.2f} times as stiff as designed; check the reference's unit "
            "(1 kgf is 9.81 N), its axes, and that the foot is of this type"
        )
    strange = float(np.median(found.distance))
    if strange > _STRANGE:
        raise CalibrationError(
            f"half of the pokes are {strange:.0f} standard deviations or more from any foot of this type, about 3 are "
            "usual; check the reference's axes, and that the foot is of this type and whole"
        )
    foreseen = foresee(twin, found)
    require_known(foreseen, len(pokes))
    physical = _parameters(design, found, pokes)
    designed_n = _designed_n(design, physical, pokes)
    within = np.isfinite(designed_n).all(axis=1)
    if not within.any():
        raise CalibrationError(
            f"none of {len(pokes)} pokes lies within what the network was taught; press less hard"
        )
    force_n = pokes.force_n[within]
    layer = learn(designed_n[within], designed_n[within] @ physical.force_matrix.T, force_n)
    left_rel = np.sqrt(np.minimum(layer.left_rel**2, _outlier(layer.left_rel) ** 2).mean())
    own = {
        name: getattr(physical, name) for name in ("stray_pf", "unloaded_pf", "gap_um", "gain_rel", "mount")
    }
    parameters = FootParameters(
        **own, stiffness_rel=physical.stiffness_rel, correction=layer.matrix, error_rel=float(left_rel)
    )
    return Calibrated(parameters, found, foreseen)


def _parameters(design: Design, found: Fit, pokes: PokeSet) -> FootParameters:
    own = found.parameters
    return FootParameters(
        stray_pf=own[STRAY],
        unloaded_pf=pokes.unloaded_pf,
        gap_um=design.response.design.gap_um + own[GAP],
        gain_rel=1.0 + own[GAIN],
        stiffness_rel=float(own[STIFFNESS][0]),
        mount=rotation(own[MOUNT]),
    )


def _designed_n(design: Design, foot: FootParameters, pokes: PokeSet) -> Vector:
    """Return what the network makes of the foot's own closures [N], shape (n, 3), NaN outside of what it was taught."""
    capacitors, card = design.card.design, design.card
    closure_um = capacitors.closure_um(
        pokes.undrifted_pf - foot.stray_pf, pokes.unloaded_pf[None] - foot.stray_pf
    )
    closure_rel = closure_um / capacitors.gap_um / foot.gain_rel
    taught: NDArray[np.bool_] = np.asarray(
        ((closure_rel >= card.closure_rel_min) & (closure_rel <= card.usable_max_rel(foot.gap_um))).all(
            axis=1
        )
    )
    force_n, _ = design.network(len(pokes)).estimate(
        np.where(taught[:, None], closure_rel, 0.0), np.zeros((len(pokes), ELEMENTS), bool)
    )
    return np.where(taught[:, None], force_n, np.nan)


def _outlier(error_rel: Vector) -> float:
    """Return what an error counts at most: one poke that slipped says nothing of the others."""
    return 5.0 * float(np.median(np.abs(error_rel))) + 1e-9
