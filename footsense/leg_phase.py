"""Operating phase of a leg: a coarse grouping of its states for dashboards and tables, not sent on CAN."""

from enum import IntEnum

from firmware_interface.can.codes import State


class LegPhase(IntEnum):
    """Operating phase of a leg from power-up to forces (not a gait phase): a coarse grouping of its states."""

    ABSENT = 0  #: its chips do not answer
    STARTING = 1  #: they answer, but readings or a tare are missing for a force
    TARING = 2  #: a tare is being taken
    VALID = 3  #: forces come
    DEGRADED = 4  #: forces come from fewer elements
    FAULTED = 5  #: something is broken, delayed or out of range
    STOPPED = 6  #: the leg was stopped by command


_PHASES = {
    State.ABSENT: LegPhase.ABSENT,
    State.STARTING: LegPhase.STARTING,
    State.NO_BASELINE: LegPhase.STARTING,
    State.TARING: LegPhase.TARING,
    State.VALID: LegPhase.VALID,
    State.DEGRADED: LegPhase.DEGRADED,
    State.SATURATED: LegPhase.FAULTED,
    State.ELEMENT_FAULT: LegPhase.FAULTED,
    State.CONVERTER_FAULT: LegPhase.FAULTED,
    State.STALE: LegPhase.FAULTED,
    State.OUT_OF_RANGE: LegPhase.FAULTED,
    State.STOPPED: LegPhase.STOPPED,
}


def phase_of(state: State) -> LegPhase:
    """Return the operating phase that a leg state belongs to."""
    return _PHASES[state]
