"""Checks before a calibration: all sessions are of the same foot, and it agrees with each reference sensor."""

from collections.abc import Sequence

import numpy as np

from footsense.calibration.evaluation import DesignModels
from footsense.calibration.loads.load_set import LoadSet
from footsense.calibration.session.recorded_session import RecordedSession
from footsense.calibration.session.reference_checks import reference_findings
from footsense.errors import CalibrationError

#: Largest difference of an element's unloaded reading between sessions of one foot [1], that of a tare.
_SAME_FOOT_TOLERANCE_REL = 0.03


def require_one_foot(sessions: Sequence[RecordedSession]) -> None:
    """Raise an error if the unloaded readings of the sessions are not those of one and the same foot.

    Raises:
        CalibrationError: One is not, or has no accepted load.
    """
    first, first_pf = sessions[0], None
    for session in sessions:
        if not session.loads:
            raise CalibrationError(
                f"{session.path}: no load is accepted; {'; '.join(session.warnings) or 'it has none'}"
            )
        unloaded_pf = LoadSet.from_loads(session.loads).median_baseline_pf
        first_pf = unloaded_pf if first_pf is None else first_pf
        difference_rel = unloaded_pf / first_pf - 1.0
        worst = int(np.argmax(np.abs(difference_rel)))
        if abs(difference_rel[worst]) > _SAME_FOOT_TOLERANCE_REL:
            raise CalibrationError(
                f"{session.path}: element {worst} of {session.foot} reads {unloaded_pf[worst]:.3f} pF unloaded, "
                f"{first_pf[worst]:.3f} pF in {first.path}; two feet with one id? at most "
                f"{_SAME_FOOT_TOLERANCE_REL:.0%} differ"
            )


def require_consistent_reference(models: DesignModels, sessions: Sequence[RecordedSession]) -> None:
    """Raise an error if a session's reference forces contradict the foot's own estimates (units, axes).

    Args:
        models: Models of the foot's type.
        sessions: Its sessions, each with loads; one whose recording does not describe its test stand is not checked.

    Raises:
        CalibrationError: It contradicts at least one; the message names each.
    """
    found = []
    for session in sessions:
        if session.test_stand is None:
            continue
        loads = LoadSet.from_loads(session.loads)
        own_n = models.estimate(loads, None).force_n
        if findings := reference_findings(session.test_stand, loads.force_n, own_n):
            found.append(f"{session.path}: {'; '.join(findings)}")
    if found:
        raise CalibrationError(f"{'; '.join(found)}; correct the test stand's file, and record again")
