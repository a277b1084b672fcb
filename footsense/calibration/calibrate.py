"""Calibrate one foot: fit its parameters to recorded sessions, and measure its force errors on held-out loads.

The figure is of loads that the fit did not use: of a whole session where there are two, since a foot that is mounted
again differs from itself; else of every fifth load. The parameters themselves use all loads.
"""

from collections.abc import Sequence
from dataclasses import replace
from statistics import fmean
from typing import NamedTuple

import numpy as np

from footsense.calibration.checks import require_consistent_reference, require_one_foot
from footsense.calibration.evaluation import DesignModels, Estimates
from footsense.calibration.loads import LoadSet
from footsense.calibration.parameter_fit import (
    ParameterFit,
    PredictedUncertainty,
    fit_parameters,
    predict_uncertainty,
)
from footsense.calibration.recorded_session import RecordedSession
from footsense.calibration.rubber_memory import loads_with_creep_corrected_baseline
from footsense.calibration.twin import (
    GAIN,
    GAP,
    MOUNT,
    REFERENCE,
    STIFFNESS,
    STRAY,
    FootTwin,
    reference_gains,
)
from footsense.errors import CalibrationError
from footsense.foot.calibration_files import HeldOutErrors
from footsense.foot.directions import rotation
from footsense.foot.force_errors import evaluate_force_errors
from footsense.foot.parameters import FootParameters
from footsense.frames import Mask

#: Contraction of a parameter's uncertainty by the loads below which they do not identify it [1].
_MIN_CONTRACTION = 0.05
#: Fewest loads of a calibration: with fewer, not even the strays are identified.
MIN_LOADS = 5
#: Median Mahalanobis distance of nine readings above which the loads are of no foot of the type: feet of the type have
#: 2 to 4, one with its sheet 0.6 mm off centre 6 (page `experiment`).
MAX_MEDIAN_MAHALANOBIS_DISTANCE = 8.0
#: Distance up to which nothing is said.
WARNING_MEDIAN_MAHALANOBIS_DISTANCE = 4.0
#: Stiffness over the design's outside of which a foot is not made of that rubber.
_MIN_STIFFNESS, _MAX_STIFFNESS = 0.25, 4.0
#: Largest predicted errors with which a calibration is made: an uncalibrated, carelessly made foot is not much worse.
_MAX_PREDICTED_DEG, _MAX_PREDICTED_REL = 4.0, 0.1
#: Share of the loads of a single session that is held out: one in so many.
_HOLD_OUT_EVERY = 5


class CalibrationResult(NamedTuple):
    """Fitted parameters of a foot, with predicted and held-out force errors.

    Attributes:
        parameters: Parameters of the foot.
        fit: Fit of its model.
        predicted_uncertainty: Force errors expected from what remains unknown.
        n_loads: Loads used.
        held_out: Errors of a calibration without some of the loads on those; None if there are too few.
        temperature_c: Mean temperature over the loads [degC]; None if a session has none.
    """

    parameters: FootParameters
    fit: ParameterFit
    predicted_uncertainty: PredictedUncertainty
    n_loads: int
    held_out: HeldOutErrors | None = None
    temperature_c: float | None = None

    @property
    def median_mahalanobis_distance(self) -> float:
        """Median Mahalanobis distance of the calibration loads from the fitted model [1]."""
        return float(np.median(self.fit.mahalanobis_distance))

    @property
    def not_identified(self) -> dict[str, list[int]]:
        """Numbers of the elements, by parameter, that the loads do not identify: there the foot is as designed."""
        parts = {"stray_pf": STRAY, "gap_um": GAP, "gain_rel": GAIN}
        unknown = {name: self.fit.contraction[part] < _MIN_CONTRACTION for name, part in parts.items()}
        return {name: np.flatnonzero(mask).tolist() for name, mask in unknown.items() if mask.any()}


def calibrate_sessions(
    models: DesignModels, sessions: Sequence[RecordedSession], hold_out: str | None = None
) -> CalibrationResult:
    """Fit the parameters of a foot to its sessions, and return them; with held-out loads, with their force errors.

    Args:
        models: Models of its type.
        sessions: Its sessions, at least one.
        hold_out: Name of the session to hold out; None for the last of several.

    Raises:
        CalibrationError: The sessions are of different feet, a foot contradicts its reference, there is no such
            session, or as of `calibrate`.
    """
    require_one_foot(sessions)
    require_consistent_reference(models, sessions)
    loads = loads_with_creep_corrected_baseline(models.response, sessions)
    result = calibrate(models, loads)
    out, protocol = _held_out_loads(sessions, loads, hold_out)
    held_out = None
    if min(out.sum(), (~out).sum()) >= MIN_LOADS:
        parameters = calibrate(models, loads.subset(~out)).parameters
        test = loads.subset(out)
        estimates = [_estimate_loads(models, test, foot) for foot in (None, parameters)]
        before, after = (
            evaluate_force_errors(test.force_n[one.has_force], one.force_n[one.has_force])
            for one in estimates
        )
        held_out = HeldOutErrors(protocol=protocol, design_only=before, calibrated=after)
    temperatures_c = [session.temperature_c for session in sessions if session.temperature_c is not None]
    temperature_c = None
    if len(temperatures_c) == len(sessions):
        temperature_c = fmean(temperatures_c, [len(session.loads) for session in sessions])
    return result._replace(held_out=held_out, temperature_c=temperature_c)


def calibrate(models: DesignModels, loads: LoadSet) -> CalibrationResult:
    """Fit and return a foot's deviations from its design; raise an error if they are implausible.

    Args:
        models: Models of its type.
        loads: At least `MIN_LOADS`, of any sessions.

    Raises:
        CalibrationError: The loads are too few, do not identify the parameters, or are of no foot of this type.
    """
    result = fit_foot_unchecked(models, loads)
    require_plausible(result)
    return result


def require_plausible(result: CalibrationResult) -> None:
    """Raise an error if the loads do not match the foot type or do not identify the parameters.

    Raises:
        CalibrationError: They do not match, or do not identify them.
    """
    stiffness_rel = result.parameters.stiffness_rel
    if not _MIN_STIFFNESS < 1.0 + stiffness_rel < _MAX_STIFFNESS:
        raise CalibrationError(
            f"the foot would be {1.0 + stiffness_rel:.2f} times as stiff as designed; check the reference's unit "
            "(1 kgf is 9.81 N), its axes, and that the foot is of this type"
        )
    if result.median_mahalanobis_distance > MAX_MEDIAN_MAHALANOBIS_DISTANCE:
        raise CalibrationError(
            f"half of the loads are {result.median_mahalanobis_distance:.0f} standard deviations or more from any "
            "foot of this type, about 3 are usual; check the reference's axes, and that the foot is of this type and "
            "undamaged"
        )
    direction_deg, magnitude_rel = result.predicted_uncertainty
    if direction_deg > _MAX_PREDICTED_DEG or magnitude_rel > _MAX_PREDICTED_REL:
        raise CalibrationError(
            f"{result.n_loads} loads leave half of all forces uncertain by {direction_deg:.1f} deg and "
            f"{magnitude_rel:.0%} or more, at most {_MAX_PREDICTED_DEG:g} deg and {_MAX_PREDICTED_REL:.0%} make a "
            "calibration; press from more sides, at two magnitudes"
        )


def fit_foot_unchecked(models: DesignModels, loads: LoadSet) -> CalibrationResult:
    """Fit and return the parameters of a foot as `calibrate` does, even if they are implausible.

    Raises:
        CalibrationError: The loads are too few, or none can be read.
    """
    if len(loads) < MIN_LOADS:
        raise CalibrationError(f"{len(loads)} loads; at least {MIN_LOADS} from all sides make a calibration")
    twin = FootTwin(models.response, loads.median_baseline_pf)
    fit = fit_parameters(twin, loads)
    predicted_uncertainty = predict_uncertainty(twin, fit.parameters, fit.covariance)
    electrodes = FootParameters(
        stray_pf=fit.parameters[STRAY],
        unloaded_pf=loads.median_baseline_pf,
        gap_um=twin.gap_um(fit.parameters),
        gain_rel=1.0 + fit.parameters[GAIN],
    )
    designed = _estimate_loads(models, loads, electrodes)
    read = designed.has_force
    mount = rotation(fit.parameters[MOUNT])
    stiffness_rel = float(fit.parameters[STIFFNESS][0])
    physical = replace(electrodes, stiffness_rel=stiffness_rel, mount=mount)
    # The reference's own error, as far as the foot shows it, is not the calibration's.
    designed_n, force_n = designed.force_n[read], loads.force_n[read] / reference_gains(fit.parameters)
    residual_n = force_n - designed_n @ physical.force_matrix.T
    residual_rel = residual_n / np.linalg.norm(force_n, axis=1, keepdims=True)
    # An outlier counts as much as five medians.
    limit_rel = 5.0 * np.median(np.abs(residual_rel)) + 1e-9
    unexplained_rel2 = np.minimum(residual_rel**2, limit_rel**2).mean()
    error_rel = np.sqrt(unexplained_rel2 + np.diag(fit.covariance)[REFERENCE].mean())
    parameters = replace(physical, error_rel=float(error_rel))
    return CalibrationResult(parameters, fit, predicted_uncertainty, len(loads))


def _estimate_loads(models: DesignModels, loads: LoadSet, foot: FootParameters | None) -> Estimates:
    """Return the estimated forces of loads, calibrated or as designed; raise an error if none has a force.

    Raises:
        CalibrationError: There is none.
    """
    estimates = models.estimate(loads, foot)
    if not estimates.has_force.any():
        raise CalibrationError(
            f"none of {len(loads)} loads lies in the network's training range; press less hard, "
            "and check that the foot is of this type"
        )
    return estimates


def _held_out_loads(
    sessions: Sequence[RecordedSession], loads: LoadSet, hold_out: str | None
) -> tuple[Mask, str]:
    """Return the mask of the held-out loads, shape (n,), and a description of how they were chosen.

    Raises:
        CalibrationError: The named session is not one of several.
    """
    names = list(
        dict.fromkeys(session.name for session in sessions)
    )  # one mounting may have several recordings
    if hold_out is None and len(names) == 1:
        out = np.zeros(len(loads), bool)
        out[loads.space_filling_order()[_HOLD_OUT_EVERY - 1 :: _HOLD_OUT_EVERY]] = True
        return out, f"every {_HOLD_OUT_EVERY}th load of the one session; another session would be stricter"
    hold_out = hold_out or names[-1]
    if hold_out not in names or len(names) == 1:
        raise CalibrationError(
            f"--hold-out {hold_out}: has to be one of several sessions, here are {', '.join(names)}"
        )
    out = np.concatenate([np.full(len(session.loads), session.name == hold_out) for session in sessions])
    return out, f"session {hold_out}, in which the foot was mounted anew"
