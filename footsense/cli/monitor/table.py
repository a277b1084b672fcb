"""The monitor's picture: above the forces as a consumer may use them, below what the legs tell beside them."""

import math

from rich.console import Group
from rich.table import Table
from rich.text import Text

from firmware_interface.can_codes import Cause, Flag, NmtState, Phase, phase_of
from footsense.client import Status
from footsense.daemon.can_listener import LegSnapshot

__all__ = ["cause_text", "monitor_table"]

_PHASE_STYLES = {
    Phase.ABSENT: "bold red",
    Phase.STARTING: "yellow",
    Phase.TARING: "yellow",
    Phase.VALID: "green",
    Phase.DEGRADED: "yellow",
    Phase.FAULTED: "bold red",
    Phase.STOPPED: "dim",
}

_LINK_STYLES = {Status.OK: "green", Status.LOST: "yellow", Status.REPEATED: "yellow"}

#: A heartbeat in a word of its own, short enough for the last column.
_BEATS = {
    NmtState.BOOT: "boot",
    NmtState.STOPPED: "stopped",
    NmtState.OPERATIONAL: "runs",
    NmtState.PRE_OPERATIONAL: "waits",
}

_NOTHING = Text("-", "dim")


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
    """Return what lies behind a leg's state in words; None if it was not told, with another state, or long ago."""
    if (
        not snapshot.is_known
        or snapshot.report.cause is None
        or snapshot.report.cause_state is not snapshot.force.state
    ):
        return None
    return _words(snapshot.report.cause.name)


def _forces(legs: list[LegSnapshot]) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 1))
    table.add_column("leg")
    table.add_column("state", min_width=15, no_wrap=True)
    table.add_column("link", min_width=8, no_wrap=True)
    for name, width in (("fx [N]", 7), ("fy [N]", 7), ("fz [N]", 7), ("sigma", 5), ("age [ms]", 8)):
        table.add_column(name.replace("[", "\\["), justify="right", min_width=width, no_wrap=True)
    table.add_column("foot")
    for snapshot in legs:
        force = snapshot.force
        state = Text(_words(force.state.name), _PHASE_STYLES[phase_of(force.state)])
        link = Text(force.status.name.lower(), _LINK_STYLES.get(force.status, "bold red"))
        numbers: list[str | Text] = [_NOTHING] * 6
        if force.usable and force.age_ns is not None:
            numbers = [f"{component:+.3f}" for component in force.force_n]
            numbers += [_or_nothing(max(force.sigma_n), ".3f"), f"{force.age_ns * 1e-6:.1f}"]
            numbers += [Text("down", "cyan") if force.flags & Flag.CONTACT else "up"]
        table.add_row(snapshot.leg, state if snapshot.is_known else _NOTHING, link, *numbers)
    return table


def _reports(legs: list[LegSnapshot]) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 1))
    table.add_column("leg")
    table.add_column("cause", min_width=15, no_wrap=True)
    table.add_column("elements", min_width=11, no_wrap=True)
    table.add_column("baseline", min_width=9, no_wrap=True)
    table.add_column("by \\[fF]", justify="right", min_width=7)
    table.add_column("worst", justify="right", min_width=7)
    table.add_column("ago \\[s]", justify="right", min_width=7)
    table.add_column("beat", min_width=7)
    for snapshot in legs:
        report = snapshot.report
        cause = cause_text(snapshot)
        mask = snapshot.force.fault_mask
        table.add_row(
            snapshot.leg,
            _NOTHING if cause is None else Text(cause, "" if report.cause is Cause.NONE else "yellow"),
            _grid(mask) if snapshot.is_known else _NOTHING,
            _NOTHING if report.baseline is None else _words(report.baseline.name),
            _or_nothing(report.mean_pf * 1e3, "+.1f"),
            _or_nothing(report.worst_pf * 1e3, "+.1f"),
            _NOTHING if report.moved_ago_ns is None else f"{report.moved_ago_ns * 1e-9:.1f}",
            Text("silent", "bold red") if report.node_state is None else _BEATS[report.node_state],
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


def _or_nothing(value: float, form: str) -> str | Text:
    return _NOTHING if math.isnan(value) else format(value, form)


def _words(name: str) -> str:
    return name.lower().replace("_", " ")
