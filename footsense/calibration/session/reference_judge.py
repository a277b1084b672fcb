"""Who holds a session's reference against its foot: the guide as it is recorded, a calibration before it learns."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from footsense.calibration.evaluation import read_loads
from footsense.calibration.fit.calibrate import Design
from footsense.calibration.session.guide import Judge
from footsense.calibration.session.recorded_session import RecordedSession
from footsense.calibration.session.reference_checks import implausible
from footsense.config.test_stand import StandConfig
from footsense.errors import CalibrationError
from footsense.reference.mounting import NEWTON_PER, Mounting

__all__ = ["judge_of", "require_belief"]


def judge_of(test_stand: StandConfig) -> Judge:
    """Return what tells whether the reference of a bench may be believed, by the units and axes of its file."""
    straight = {"x": "x", "y": "y", "z": "z"}
    to_sensor = Mounting(straight, test_stand.mount_deg, "N", 1.0, (1.0, 1.0, 1.0)).apply(np.eye(3))[0]
    axes = (test_stand.axes.x, test_stand.axes.y, test_stand.axes.z)
    return partial(implausible, newton_per=NEWTON_PER, units=test_stand.units, axes=axes, to_sensor=to_sensor)


def require_belief(design: Design, sessions: Sequence[RecordedSession]) -> None:
    """Check that no foot contradicts the reference that it was pressed against.

    Args:
        design: What is known of the foot before.
        sessions: Its sessions, each with loads; one whose recording does not describe its test_stand is believed.

    Raises:
        CalibrationError: One does; every session that does is named.
    """
    found = []
    for session in sessions:
        if session.test_stand is None:
            continue
        reference_n = np.array([load.force_n for load in session.loads])
        own = read_loads(session.loads, design.network(len(reference_n)), design.card, None)
        if doubts := judge_of(session.test_stand)(reference_n, own.force_n):
            found.append(f"{session.path}: {'; '.join(doubts)}")
    if found:
        raise CalibrationError(f"{'; '.join(found)}; correct the bench's file, and record again")
