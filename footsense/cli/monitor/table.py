"""Table of `footsense monitor`: forces that a consumer may use, contact and ground of each foot, the legs' reports."""

import math
from collections.abc import Callable

from rich.console import Group
from rich.text import Text

from firmware_interface.can.codes import Cause, Flag, NmtState, Slip
from firmware_interface.can.element_mask import NARROW_ELEMENTS
from firmware_interface.can.gait import Gait, Ground
from footsense.cli.leg_table import (
    EMPTY_CELL,
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
_NODE_STATE_NAMES = {
    NmtState.BOOT: "boot",
    NmtState.STOPPED: "stopped",
    NmtState.OPERATIONAL: "runs",
    NmtState.PRE_OPERATIONAL: "waits",
}


def monitor_table(legs: list[LegSnapshot], title: str) -> Group:
    """Return the picture of all legs; it fits 80 columns and 22 lines.

    The grids of 4 x 4 elements take the room of the time since a baseline last moved, which `--json` still tells.

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
    is_wide = any(snapshot.n_elements > NARROW_ELEMENTS for snapshot in legs)
    reports = {
        title: column
        for title, column in _REPORT_COLUMNS.items()
        if title != _BASELINE_MOVED_AGO_TITLE or not is_wide
    }
    return Group(head, *(leg_table(by_name, columns) for columns in (_FORCE_COLUMNS, _GAIT_COLUMNS, reports)))


def cause_text(snapshot: LegSnapshot) -> str | None:
    """Return the cause of a leg's state in words; None if none was reported lately, or for another state."""
    report = snapshot.report
    if not snapshot.is_current or report.cause is None or report.cause_state is not snapshot.force.state:
        return None
    return enum_words(report.cause.name)


def _state_cell(leg: LegSnapshot) -> Text:
    return state_text(leg.force.state) if leg.is_current else EMPTY_CELL


def _link_cell(leg: LegSnapshot) -> Text:
    status = leg.force.status
    return Text(status.name.lower(), _LINK_STYLES.get(status, "bold red"))


def _contact_cell(leg: LegSnapshot) -> str | Text:
    if not leg.force.usable:
        return EMPTY_CELL
    return Text("down", "cyan") if leg.force.flags & Flag.CONTACT else "up"


def _slip_cell(leg: LegSnapshot) -> str | Text:
    gait = leg.report.gait
    if gait is None or gait.slip is Slip.UNKNOWN:
        return EMPTY_CELL
    return Text("slips", "bold yellow") if gait.slip is Slip.SLIPPING else "sticks"


def _gait_number_cell(value: Callable[[Gait], float], form: str) -> Callable[[LegSnapshot], str | Text]:
    """Return a function from a leg to the table cell of one number of its `Gait` report; empty without a report."""
    return lambda leg: EMPTY_CELL if leg.report.gait is None else number_cell(value(leg.report.gait), form)


def _ground_number_cell(value: Callable[[Ground], float], form: str) -> Callable[[LegSnapshot], str | Text]:
    """Return a function from a leg to the table cell of one number of its `Ground` report; empty without a report."""
    return lambda leg: (
        EMPTY_CELL if leg.report.ground is None else number_cell(value(leg.report.ground), form)
    )


def _cause_cell(leg: LegSnapshot) -> Text:
    cause = cause_text(leg)
    return EMPTY_CELL if cause is None else Text(cause, "" if leg.report.cause is Cause.NONE else "yellow")


def _elements_cell(leg: LegSnapshot) -> Text:
    return _element_grid(leg.force.fault_mask, leg.n_elements) if leg.is_current else EMPTY_CELL


def _baseline_cell(leg: LegSnapshot) -> str | Text:
    return EMPTY_CELL if leg.report.baseline is None else enum_words(leg.report.baseline.name)


def _node_state_cell(leg: LegSnapshot) -> str | Text:
    state = leg.report.node_state
    return Text("silent", "bold red") if state is None else _NODE_STATE_NAMES[state]


def _element_grid(mask: int, n_elements: int) -> Text:
    """Return the elements row by row, an x for each that is not usable.

    Example:
        >>> _element_grid(0b000_010_001, 9).plain
        'x.. .x. ...'
    """
    rows = math.isqrt(n_elements)
    marks = "".join("x" if mask >> element & 1 else "." for element in range(n_elements))
    grid = " ".join(marks[start : start + rows] for start in range(0, n_elements, rows))
    return Text(grid, "yellow" if mask else "dim")


_FORCE_COLUMNS: LegColumns[LegSnapshot] = {
    "state": ("<15", _state_cell),
    "link": ("<8", _link_cell),
    **force_columns(lambda leg: leg.force.force_n),
    "sigma": (">5", lambda leg: number_cell(max(leg.force.sigma_n), ".3f")),
    "age [ms]": (">8", lambda leg: number_cell(leg.force.age_ns, ".1f", 1e-6)),
    "foot": ("<4", _contact_cell),
}
_GAIT_COLUMNS: LegColumns[LegSnapshot] = {
    "contact": (">7", _gait_number_cell(lambda gait: gait.probability, ".1%")),
    "share": (">5", _gait_number_cell(lambda gait: gait.load_share, ".0%")),
    "slip": ("<6", _slip_cell),
    "friction": (">8", _ground_number_cell(lambda ground: ground.tangential_over_normal, ".2f")),
    "+-": (">4", _ground_number_cell(lambda ground: ground.tangential_over_normal_sigma, ".2f")),
    "cone": (">4", _ground_number_cell(lambda ground: ground.friction, ".2f")),
    "normal x": (">8", _ground_number_cell(lambda ground: ground.normal[0], "+.2f")),
    "y": (">5", _ground_number_cell(lambda ground: ground.normal[1], "+.2f")),
    "+- [deg]": (">8", _ground_number_cell(lambda ground: math.degrees(ground.normal_sigma_rad), ".1f")),
}
_BASELINE_MOVED_AGO_TITLE = "ago [s]"
_REPORT_COLUMNS: LegColumns[LegSnapshot] = {
    "cause": ("<15", _cause_cell),
    "elements": ("<11", _elements_cell),
    "baseline": ("<9", _baseline_cell),
    "mean fF": (">7", lambda leg: number_cell(leg.report.baseline_mean_offset_pf, "+.1f", 1e3)),
    "worst": (">7", lambda leg: number_cell(leg.report.baseline_worst_offset_pf, "+.1f", 1e3)),
    _BASELINE_MOVED_AGO_TITLE: (">7", lambda leg: number_cell(leg.report.baseline_moved_ago_ns, ".1f", 1e-9)),
    "node": ("<7", _node_state_cell),
}
