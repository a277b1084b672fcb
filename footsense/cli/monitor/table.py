"""The monitor's picture: above the forces that a consumer may use, below the legs' reports."""

import math

from rich.console import Group
from rich.table import Table
from rich.text import Text

from firmware_interface.can_codes import Cause, Flag, NmtState
from footsense.cli.leg_table import EMPTY, FORCE_COLUMNS, force_cells, leg_table, number, state_text, words
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
    """Return the picture of all legs; it fits 80 columns and 20 lines.

    Args:
        legs: What is known of them.
        title: What is listened to.
    """
    head = Text.assemble(("footsense monitor  ", "bold"), title)
    if any(snapshot.force.flags & Flag.SIMULATED for snapshot in legs):
        head.append("   simulated", "dim")
    if any(snapshot.report.degraded_timing for snapshot in legs):
        head.append("   timing degraded", "bold red")
    return Group(head, Text(), _forces(legs), Text(), _reports(legs))


def cause_text(snapshot: LegSnapshot) -> str | None:
    """Return the cause of a leg's state in words; None if none was reported lately, or for another state."""
    report = snapshot.report
    if not snapshot.is_current or report.cause is None or report.cause_state is not snapshot.force.state:
        return None
    return words(report.cause.name)


def _forces(legs: list[LegSnapshot]) -> Table:
    table = leg_table(
        {"state": "<15", "link": "<8", **FORCE_COLUMNS, "sigma": ">5", "age [ms]": ">8", "foot": "<4"}
    )
    for snapshot in legs:
        force = snapshot.force
        state = state_text(force.state) if snapshot.is_current else EMPTY
        link = Text(force.status.name.lower(), _LINK_STYLES.get(force.status, "bold red"))
        cells: list[str | Text] = [EMPTY] * 6
        if force.usable and force.age_ns is not None:
            cells = [
                *force_cells(force.force_n),
                number(max(force.sigma_n), ".3f"),
                f"{force.age_ns * 1e-6:.1f}",
            ]
            cells.append(Text("down", "cyan") if force.flags & Flag.CONTACT else "up")
        table.add_row(snapshot.leg, state, link, *cells)
    return table


def _reports(legs: list[LegSnapshot]) -> Table:
    table = leg_table(
        {
            "cause": "<15",
            "elements": "<11",
            "baseline": "<9",
            "mean fF": ">7",
            "worst": ">7",
            "ago [s]": ">7",
            "node": "<7",
        }
    )
    for snapshot in legs:
        report = snapshot.report
        cause = cause_text(snapshot)
        moved_ago_s = math.nan if report.moved_ago_ns is None else report.moved_ago_ns * 1e-9
        table.add_row(
            snapshot.leg,
            EMPTY if cause is None else Text(cause, "" if report.cause is Cause.NONE else "yellow"),
            _grid(snapshot.force.fault_mask) if snapshot.is_current else EMPTY,
            EMPTY if report.baseline is None else words(report.baseline.name),
            number(report.mean_pf * 1e3, "+.1f"),
            number(report.worst_pf * 1e3, "+.1f"),
            number(moved_ago_s, ".1f"),
            Text("silent", "bold red") if report.node_state is None else _NODE_STATES[report.node_state],
        )
    return table


def _grid(mask: int) -> Text:
    """Return the elements row by row, an x for each that is not usable.

    Example:
        >>> _grid(0b000_010_001).plain
        'x.. .x. ...'
    """
    marks = "".join("x" if mask >> element & 1 else "." for element in range(9))
    return Text(f"{marks[:3]} {marks[3:6]} {marks[6:]}", "yellow" if mask else "dim")
