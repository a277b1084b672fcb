"""One foot's sessions on the test_stand, turned into a calibration and an honest figure of how good it is.

The figure is of loads that the fit did not know: of a session of its own where there are two, for a foot that is taken
off and put on again differs from itself; else of every fifth load. The parameters themselves rest on all loads.
"""

from collections.abc import Sequence
from statistics import fmean
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.calibration.evaluation import read_loads
from footsense.calibration.fit.calibrate import MIN_LOADS, Calibrated, Design, calibrate
from footsense.calibration.loads.detection import CalibrationLoad
from footsense.calibration.loads.load_set import LoadSet
from footsense.calibration.session.recorded_session import RecordedSession
from footsense.calibration.session.reference_judge import require_belief
from footsense.errors import CalibrationError
from footsense.foot.calibration_format import HeldOut
from footsense.foot.force_errors import Errors, errors
from footsense.foot.parameters import FootParameters

Vector = NDArray[np.float64]

#: One of so many loads is kept where there is but one session.
_KEPT_OF = 5
#: A foot reads within this of itself from session to session, element by element [1]: as much as a tare allows.
_SAME_FOOT_REL = 0.03


class CalibratedFoot(NamedTuple):
    """A foot and what is known of it.

    Attributes:
        calibrated: By all loads.
        n_loads: How many those are.
        held_out: How good a calibration without some of them is on those; None where there were too few to keep any.
        temperature_c: At which it was on the test_stand, the mean over its loads [degC]; None if a session does not tell.
    """

    calibrated: Calibrated
    n_loads: int
    held_out: HeldOut | None
    temperature_c: float | None


def calibrate_sessions(
    design: Design, sessions: Sequence[RecordedSession], hold_out: str | None = None
) -> CalibratedFoot:
    """Calibrate a foot.

    Args:
        design: What is known of it before.
        sessions: Its sessions, at least one.
        hold_out: Name of the session that tells how good it is; None for the last of several.

    Raises:
        CalibrationError: The sessions are of different feet, a foot contradicts its reference, there is no such
            session, or as `calibrate`.
    """
    require_one_foot(sessions)
    require_belief(design, sessions)
    loads = [load for session in sessions for load in session.loads]
    calibrated = calibrate(design, LoadSet.of(loads))
    kept, protocol = _kept(sessions, hold_out)
    held_out = None
    if min(kept.sum(), (~kept).sum()) >= MIN_LOADS:
        without = calibrate(
            design, LoadSet.of([load for load, out in zip(loads, kept, strict=True) if not out])
        )
        judged = [load for load, out in zip(loads, kept, strict=True) if out]
        before, after = compare(design, judged, without.parameters)
        held_out = HeldOut(protocol=protocol, design_only=before, calibrated=after)
    return CalibratedFoot(calibrated, len(loads), held_out, _temperature_c(sessions))


def _temperature_c(sessions: Sequence[RecordedSession]) -> float | None:
    told = [session.temperature_c for session in sessions]
    known = [temperature_c for temperature_c in told if temperature_c is not None]
    if len(known) < len(told):
        return None
    return fmean(known, [len(session.loads) for session in sessions])


def compare(design: Design, loads: Sequence[CalibrationLoad], foot: FootParameters) -> tuple[Errors, Errors]:
    """Return the errors of the network alone and of a calibrated foot, on the loads that each can read.

    Raises:
        CalibrationError: One can read none.
    """
    truth_n = np.array([load.force_n for load in loads])
    network = design.network(len(loads))
    found = []
    for parameters in (None, foot):
        read = read_loads(loads, network, design.card, parameters)
        if not read.usable.any():
            raise CalibrationError(
                f"none of {len(loads)} loads lies within what the network was taught; press less hard, "
                "and check that the foot is of this type"
            )
        found.append(errors(truth_n[read.usable], read.force_n[read.usable]))
    return found[0], found[1]


def require_one_foot(sessions: Sequence[RecordedSession]) -> None:
    """Check that all sessions were of one foot, by what its elements read at rest.

    Raises:
        CalibrationError: One was not, or has no load that counts.
    """
    first, first_pf = sessions[0], None
    for session in sessions:
        if not session.loads:
            raise CalibrationError(
                f"{session.path}: no load counts; {'; '.join(session.warnings) or 'it has none'}"
            )
        unloaded_pf = LoadSet.of(session.loads).unloaded_pf
        if first_pf is None:
            first_pf = unloaded_pf
        apart_rel = unloaded_pf / first_pf - 1.0
        worst = int(np.argmax(np.abs(apart_rel)))
        if abs(apart_rel[worst]) > _SAME_FOOT_REL:
            raise CalibrationError(
                f"{session.path}: element {worst} of {session.foot} reads {unloaded_pf[worst]:.3f} pF at rest, "
                f"{first_pf[worst]:.3f} pF in {first.path}; two feet with one id? at most {_SAME_FOOT_REL:.0%} differ"
            )


def _kept(sessions: Sequence[RecordedSession], hold_out: str | None) -> tuple[NDArray[np.bool_], str]:
    """Return which loads are kept from the fit that is judged, and that in words.

    Raises:
        CalibrationError: The session that is to be kept is not one of several.
    """
    # One mounting may have more than one recording.
    names = list(dict.fromkeys(session.name for session in sessions))
    if hold_out is None and len(names) > 1:
        hold_out = names[-1]
    if hold_out is None:
        loads = LoadSet.of([load for session in sessions for load in session.loads])
        kept = np.zeros(len(loads), bool)
        kept[loads.spread()[_KEPT_OF - 1 :: _KEPT_OF]] = True
        return kept, f"every {_KEPT_OF}th load of the one session; another session would tell more"
    if hold_out not in names or len(names) == 1:
        raise CalibrationError(
            f"--hold-out {hold_out}: has to be one of several sessions, here are {', '.join(names)}"
        )
    return (
        np.concatenate([np.full(len(session.loads), session.name == hold_out) for session in sessions]),
        f"session {hold_out}, in which the foot was mounted anew",
    )
