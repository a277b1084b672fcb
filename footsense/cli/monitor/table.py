"""The monitor's picture: the forces that a consumer may use, contact and ground below the feet, the legs' reports."""

import math
from collections.abc import Callable

from rich.console import Group
from rich.text import Text

from firmware_interface.can.codes import Cause, Flag, NmtState, Slip
from firmware_interface.can.gait import Gait, Ground
from footsense.cli.leg_table import (
    EMPTY,
    LegColumns,
    enum_words,
    force_columns,
    leg_table,
    number_cell,
    state_text,
)
from footsense.client import LinkStatus
from footsense.daemon.can_listener import LegSnapshot

_LINK_STYLES = {LinkStatus.OK: "green", LinkStatus.LOST: "yellow", LinkStatus.REPEATED: "yellow"}

#: State of the node in a heartbeat, in words short enough for the last column.
_NODE_STATES = {
    NmtState.BOOT: "boot",
    NmtState.STOPPED: "stopped",
    NmtState.OPERATIONAL: "runs",
    NmtState.PRE_OPERATIONAL: "waits",
}


def monitor_table(legs: list[LegSnapshot], title: str) -> Group:
    """Return the picture of all legs; it fits 80 columns and 22 lines.

    Args:
        legs: The legs as their frames show them.
        title: Channel and time.
    """
    head = Text.assemble(("footsense monitor  ", "bold"), title)
    if any(snapshot.force.flags & Flag.SIMULATED for snapshot in legs):
        head.append("  simulated", "dim")
    if any(snapshot.report.degraded_timing for snapshot in legs):
        head.append("  timing degraded", "bold red")
    if any(snapshot.report.gait and snapshot.report.gait.all_in_air for snapshot in legs):
        head.append("  in air", "cyan")
    by_name = {snapshot.leg: snapshot for snapshot in legs}
    return Group(head, *(leg_table(by_name, columns) for columns in (_FORCES, _GAIT, _REPORTS)))


def cause_text(snapshot: LegSnapshot) -> str | None:
    """Return the cause of a leg's state in words; None if none was reported lately, or for another state."""
    report = snapshot.report
    if not snapshot.is_current or report.cause is None or report.cause_state is not snapshot.force.state:
        return None
    return enum_words(report.cause.name)


def _state(leg: LegSnapshot) -> Text:
    return state_text(leg.force.state) if leg.is_current else EMPTY


def _link(leg: LegSnapshot) -> Text:
    status = leg.force.status
    return Text(status.name.lower(), _LINK_STYLES.get(status, "bold red"))


def _contact(leg: LegSnapshot) -> str | Text:
    if not leg.force.usable:
        return EMPTY
    return Text("down", "cyan") if leg.force.flags & Flag.CONTACT else "up"


def _slip(leg: LegSnapshot) -> str | Text:
    gait = leg.report.gait
    if gait is None or gait.slip is Slip.UNKNOWN:
        return EMPTY
    return Text("slips", "bold yellow") if gait.slip is Slip.SLIPPING else "sticks"


def _of_gait(value: Callable[[Gait], float], form: str) -> Callable[[LegSnapshot], str | Text]:
    """Return the cell of a number of the contact."""
    return lambda leg: EMPTY if leg.report.gait is None else number_cell(value(leg.report.gait), form)


def _of_ground(value: Callable[[Ground], float], form: str) -> Callable[[LegSnapshot], str | Text]:
    """Return the cell of a number of the ground."""
    return lambda leg: EMPTY if leg.report.ground is None else number_cell(value(leg.report.ground), form)


def _cause(leg: LegSnapshot) -> Text:
    cause = cause_text(leg)
    return EMPTY if cause is None else Text(cause, "" if leg.report.cause is Cause.NONE else "yellow")


def _elements(leg: LegSnapshot) -> Text:
    return _grid(leg.force.fault_mask) if leg.is_current else EMPTY


def _baseline(leg: LegSnapshot) -> str | Text:
    return EMPTY if leg.report.baseline is None else enum_words(leg.report.baseline.name)


def _node(leg: LegSnapshot) -> str | Text:
    state = leg.report.node_state
    return Text("silent", "bold red") if state is None else _NODE_STATES[state]


def _grid(mask: int) -> Text:
    """Return the elements row by row, an x for each that is not usable.

    Example:
        >>> _grid(0b000_010_001).plain
        'x.. .x. ...'
    """
    marks = "".join("x" if mask >> element & 1 else "." for element in range(9))
    return Text(f"{marks[:3]} {marks[3:6]} {marks[6:]}", "yellow" if mask else "dim")


_FORCES: LegColumns[LegSnapshot] = {
    "state": ("<15", _state),
    "link": ("<8", _link),
    **force_columns(lambda leg: leg.force.force_n),
    "sigma": (">5", lambda leg: number_cell(max(leg.force.sigma_n), ".3f")),
    "age [ms]": (">8", lambda leg: number_cell(leg.force.age_ns, ".1f", 1e-6)),
    "foot": ("<4", _contact),
}
_GAIT: LegColumns[LegSnapshot] = {
    "contact": (">7", _of_gait(lambda gait: gait.probability, ".1%")),
    "share": (">5", _of_gait(lambda gait: gait.load_share, ".0%")),
    "slip": ("<6", _slip),
    "friction": (">8", _of_ground(lambda ground: ground.friction_use, ".2f")),
    "+-": (">4", _of_ground(lambda ground: ground.friction_use_sigma, ".2f")),
    "cone": (">4", _of_ground(lambda ground: ground.friction, ".2f")),
    "normal x": (">8", _of_ground(lambda ground: ground.normal[0], "+.2f")),
    "y": (">5", _of_ground(lambda ground: ground.normal[1], "+.2f")),
    "+- [deg]": (">8", _of_ground(lambda ground: math.degrees(ground.normal_sigma_rad), ".1f")),
}
_REPORTS: LegColumns[LegSnapshot] = {
    "cause": ("<15", _cause),
    "elements": ("<11", _elements),
    "baseline": ("<9", _baseline),
    "mean fF": (">7", lambda leg: number_cell(leg.report.mean_pf, "+.1f", 1e3)),
    "worst": (">7", lambda leg: number_cell(leg.report.worst_pf, "+.1f", 1e3)),
    "ago [s]": (">7", lambda leg: number_cell(leg.report.moved_ago_ns, ".1f", 1e-9)),
    "node": ("<7", _node),
}
