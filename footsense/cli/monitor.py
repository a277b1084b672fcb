"""Command `footsense monitor`: the legs on CAN, as a consumer of their forces sees them."""

import math
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import replace
from itertools import count
from typing import Any

import click
from rich.console import Console, Group, RenderableType
from rich.text import Text

from firmware_interface.can.codes import CalibrationKind, Cause, Flag, NmtState
from footsense.cli.can.can_options import can_options, channel_argument
from footsense.cli.live import Picture
from footsense.cli.options import StopRequest, duration_option
from footsense.cli.tables import (
    EMPTY_CELL,
    Column,
    contact_column,
    echo_json,
    fitting,
    force_columns,
    json_row,
    left_out_text,
    state_column,
    styled,
    table,
    value_text,
)
from footsense.client import LinkLimits, LinkStatus
from footsense.client.listener import LegSnapshot, Listener, open_listener
from footsense.clock import MonotonicClock
from footsense.errors import FootsenseError
from footsense.frames import ELEMENTS, ROWS
from footsense.leg_words import phase_of, word_of
from footsense.ports import Clock
from footsense.wires.address import CanAddress, silence_text

_NS_PER_S = 1_000_000_000
_REDRAW_PERIOD_NS = 200_000_000
#: Pictures in the time between two lines of JSON, a second.
_REDRAWS_PER_LINE = 5
#: Silence after which it ends where nobody watches [s]: that of `footsense.connect`.
_TIMEOUT_S = 2.0
#: Pictures in which `Identity` has come, and all else that is sent once a second.
_LONGEST_IDENTITY_PERIODS = 6
_LINK_STYLES = {LinkStatus.OK: "green", LinkStatus.LOST: "yellow", LinkStatus.REPEATED: "yellow"}
#: State of the node in a heartbeat, in words short enough for the last column.
_NODE_STATE_WORDS = {
    NmtState.BOOT: "boot",
    NmtState.STOPPED: "stopped",
    NmtState.OPERATIONAL: "runs",
    NmtState.PRE_OPERATIONAL: "waits",
}


@click.command()
@channel_argument
@can_options
@click.option("--once", is_flag=True, help="Show the legs once, and end.")
@click.option(
    "--timeout",
    "timeout_s",
    type=click.FloatRange(min=0, min_open=True),
    metavar="SECONDS",
    help="End after a silence of this time. Default: 2 where the output is no terminal, else never.",
)
@click.option(
    "--max-age-ms",
    type=click.IntRange(1, 10_000),
    default=100,
    show_default=True,
    help="Age from which a force is stale, and a silent leg lost.",
)
@duration_option("Stop after this time.")
@click.option(
    "--json",
    "as_json",
    is_flag=True,
    help="Print one line of JSON per leg and second; the default if the output is no terminal.",
)
def monitor(
    address: CanAddress,
    timeout_s: float | None,
    max_age_ms: int,
    duration_s: float,
    *,
    once: bool,
    as_json: bool,
) -> None:
    """Show the legs on CAN: state, force with its age and uncertainty, and the cause of a fault.

    CHANNEL: as --channel. Only listens. A force is shown if a consumer that accepts degraded legs may use it. The exit
    code is 1 where no frame came: in all of the duration, once, or in the timeout.
    """  # noqa: DOC501 - click shows this text
    limit_ns = max_age_ms * 1_000_000
    limits = LinkLimits(max_age_ns=limit_ns, timeout_ns=limit_ns, accept_degraded=True)
    console = Console()
    clock = MonotonicClock()
    stop = StopRequest()
    is_plain = as_json or not console.is_terminal
    timeout_ns = (timeout_s or (_TIMEOUT_S if is_plain else math.inf)) * _NS_PER_S
    with ExitStack() as stack:
        listener = stack.enter_context(closing(open_listener(address, clock, limits)))
        _wait_until_known(listener, clock)
        start_ns = heard_ns = clock.now_ns()
        end_ns = start_ns + duration_s * _NS_PER_S
        live = None if is_plain or once else stack.enter_context(Picture(console))
        for step in count(_LONGEST_IDENTITY_PERIODS if once else 1):
            t_ns = start_ns + step * _REDRAW_PERIOD_NS
            if t_ns > end_ns and listener.snapshot():
                return
            listener.listen(t_ns)
            if stop.requested:
                return
            t_s = round((t_ns - start_ns) * 1e-9, 3)
            legs = listener.snapshot()
            if any(leg.is_current for leg in legs):
                heard_ns = t_ns
            elif once or t_ns >= end_ns or t_ns - heard_ns >= timeout_ns:
                raise FootsenseError(silence_text("no frames", address.channel))
            if not is_plain:
                tables = monitor_tables(legs, address.channel, t_s, console.width)
                console.print(tables) if live is None else live.update(tables, refresh=True)
            elif once or step % _REDRAWS_PER_LINE == 0:
                _echo_lines(legs, t_s)
            if once:
                return


def _echo_lines(legs: list[LegSnapshot], t_s: float) -> None:
    for snapshot in legs:
        echo_json({"t_s": t_s, **json_row(COLUMNS, snapshot)}, indent=0)


def _wait_until_known(listener: Listener, clock: Clock) -> None:
    """Listen until each leg that is heard has sent the step of its forces, which it does once a second."""
    for _ in range(_LONGEST_IDENTITY_PERIODS):
        listener.listen(clock.now_ns() + _REDRAW_PERIOD_NS)
        if not any(leg.force.status is LinkStatus.UNKNOWN for leg in listener.snapshot()):
            return


def monitor_tables(legs: list[LegSnapshot], channel: str, t_s: float, width: int) -> Group:
    """Return the picture of all legs; that of six has at most 23 lines.

    Args:
        legs: The legs as their frames show them.
        channel: Name of the channel.
        t_s: Time since the start [s].
        width: Columns of the terminal.
    """
    head = Text.assemble(("footsense monitor  ", "bold"), f"{channel}  {t_s:.1f} s", overflow="ellipsis")
    head.no_wrap = True
    if any(leg.force.flags & Flag.SIMULATED for leg in legs):
        head.append("  simulated", "dim")
    if any(leg.report.heartbeat and leg.report.heartbeat.degraded_timing for leg in legs):
        head.append("  timing degraded", "bold red")
    if legs and all(leg.force.contact is False for leg in legs):
        head.append("  in air", "cyan")
    heads = [head]
    groups = [[_LEG_COLUMN, *columns] for columns in (_FORCE_COLUMNS, _GAIT_COLUMNS, _REPORT_COLUMNS)]
    if not any(leg.is_current for leg in legs):
        heads.append(Text(f"no frames on {channel}; is the service running?", "bold red"))
    elif any(left_out_text(columns, width) for columns in groups):
        heads.append(Text("a wider terminal shows more", "dim", no_wrap=True))
    tables = [table(fitting(columns, width), legs) for columns in groups]
    return Group(*heads, *(tables if legs else ()))


def _state_cell(leg: LegSnapshot) -> RenderableType:
    return _STATE_COLUMN.cells(leg)[0] if leg.is_current else styled("silent", "bold red")


def _holds_style(leg: LegSnapshot) -> str:
    """Return the style of `holds`: of a foot that more likely slides than stands still where it is."""
    force = leg.force
    return "bold yellow" if force.contact and force.holds < 0.5 * force.contact_probability else ""


def _calibration_cell(leg: LegSnapshot) -> str:
    found = leg.report.calibration
    if found is None:
        return EMPTY_CELL
    return styled(word_of(found.kind), "yellow" if found.kind is CalibrationKind.NONE else "")


def _calibration_date(leg: LegSnapshot) -> str | None:
    found = leg.report.calibration
    return found.date.isoformat() if found is not None and found.date is not None else None


def _cause(leg: LegSnapshot) -> str | None:
    """Return the cause of a leg's state in words; None if none was reported lately, or for another state."""
    fault = leg.report.fault
    is_present = leg.is_current and fault is not None and fault.state is leg.force.state
    return word_of(fault.cause) if fault and is_present else None


def _elements_out(leg: LegSnapshot) -> list[int] | None:
    mask = leg.force.fault_mask
    if mask is None or not leg.is_current:
        return None
    return [element for element in range(ELEMENTS) if mask >> element & 1]


def _elements_cell(leg: LegSnapshot) -> str:
    """Return the elements row by row, an x for each that is not usable."""
    out = _elements_out(leg)
    if out is None:
        return EMPTY_CELL
    rows = ("".join("x" if row + j in out else "." for j in range(ROWS)) for row in range(0, ELEMENTS, ROWS))
    return styled(" ".join(rows), "yellow" if out else "dim")


def _node_cell(leg: LegSnapshot) -> str:
    beat = leg.report.heartbeat
    return styled("silent", "bold red") if beat is None else _NODE_STATE_WORDS[beat.state]


def _scaled(value: float | None, scale: float) -> float | None:
    return None if value is None else value * scale


def _entry(path: str, scale: float | None = None) -> Callable[[LegSnapshot], Any]:
    """Return what reads an entry of a leg's reports, such as "ground.friction", in another unit."""
    part, _, name = path.partition(".")

    def value(leg: LegSnapshot) -> Any:  # noqa: ANN401 - of any type
        read = getattr(getattr(leg.report, part), name, None)
        return read if scale is None else _scaled(read, scale)

    return value


def _reported(name: str, form: str = "", *titles: str, worth: int = 9) -> Column[LegSnapshot]:
    """Return the column of an entry of a leg's reports that has its name and unit."""
    return Column(name, _entry(name), form, titles, worth=worth)


_LEG_COLUMN: Column[LegSnapshot] = Column("leg", lambda leg: leg.leg, "<3")
_STATE_COLUMN: Column[LegSnapshot] = state_column(lambda leg: leg.force.state if leg.is_current else None)
_FORCE_COLUMNS: list[Column[LegSnapshot]] = [
    replace(_STATE_COLUMN, cell=_state_cell),
    Column(
        "link",
        lambda leg: leg.force.status,
        "<8",
        style=lambda leg: _LINK_STYLES.get(leg.force.status, "bold red"),
        worth=1,
    ),
    Column("forces", lambda leg: leg.n_force_frames),
    Column("phase", lambda leg: phase_of(leg.force.state) if leg.is_current else None),
    Column("usable", lambda leg: leg.force.usable),
    contact_column(lambda leg: leg.force.contact),
    *force_columns("force_n", lambda leg: leg.force.force_n),
    Column(
        "sigma_n",
        lambda leg: leg.force.sigma_n,
        ">5",
        ("sigma",),
        cell=lambda leg: value_text(max(leg.force.sigma_n), ".3f"),
        worth=3,
    ),
    Column("age_ms", lambda leg: _scaled(leg.force.age_ns, 1e-6), ">8.1f", worth=4),
    Column("rate_hz", lambda leg: leg.rate_hz, ">4", ("Hz",), worth=2),
    Column("simulated", lambda leg: bool(leg.force.flags & Flag.SIMULATED) if leg.is_current else None),
]
_GAIT_COLUMNS: list[Column[LegSnapshot]] = [
    Column("contact_probability", lambda leg: leg.force.contact_probability, ">7.0%", ("contact",)),
    Column("holds", lambda leg: leg.force.holds, ">5.0%", style=_holds_style, worth=8),
    Column("ground.ago_ms", lambda leg: _scaled(leg.report.ground_ago_ns, 1e-6)),
    _reported("ground.tangential_over_normal", ">5.2f", "ft/fn", worth=6),
    _reported("ground.tangential_over_normal_sigma", ">4.2f", "+-", worth=4),
    _reported("ground.friction", ">8.2f", "friction", worth=5),
    _reported("ground.normal", ">+6.2f", "normal x", "y", worth=2),
    Column(
        "ground.normal_sigma_deg",
        _entry("ground.normal_sigma_rad", math.degrees(1.0)),
        ">8.1f",
        ("+- [deg]",),
        worth=1,
    ),
]
_REPORT_COLUMNS: list[Column[LegSnapshot]] = [
    Column("cause", _cause, "<15", style=lambda leg: "" if _cause(leg) == word_of(Cause.NONE) else "yellow"),
    Column("elements_out", _elements_out, "<11", ("elements",), cell=_elements_cell, worth=8),
    _reported("baseline.status", "<9", "baseline", worth=6),
    Column("baseline.mean_ff", _entry("baseline.mean_pf", 1e3), ">+7.1f", ("mean fF",), worth=4),
    Column("baseline.worst_ff", _entry("baseline.worst_pf", 1e3), ">+7.1f", ("worst",), worth=5),
    Column("baseline.moved_s_ago", _entry("baseline.age_ns", 1e-9), ">7.1f", ("ago [s]",), worth=3),
    Column("heartbeat", _entry("heartbeat.state"), "<7", ("node",), cell=_node_cell, worth=7),
    Column(
        "calibration.kind",
        _entry("calibration.kind"),
        "<11",
        ("calibration",),
        cell=_calibration_cell,
        worth=2,
    ),
    Column("calibration.date", _calibration_date, "<10", ("since",), worth=1),
    _reported("calibration.size_error_percent", ">6.1f", "+- [%]", worth=2),
    _reported("calibration.direction_error_deg", ">8.1f", "+- [deg]", worth=2),
    Column("force_step_mn", lambda leg: leg.identity and leg.identity.force_step_mn),
    Column("foot_type_hash", lambda leg: leg.identity and f"{leg.identity.foot_type_hash:08x}"),
    Column("degraded_timing", _entry("heartbeat.degraded_timing")),
    Column("last_event.kind", lambda leg: leg.event and leg.event.kind),
    Column("last_event.ago_ms", lambda leg: _scaled(leg.event_ago_ns, 1e-6)),
    Column("last_event.sigma_ms", lambda leg: leg.event and leg.event.sigma_s * 1e3),
]
#: All that is known of a leg, in the order of JSON.
COLUMNS = [_LEG_COLUMN, *_FORCE_COLUMNS, *_GAIT_COLUMNS, *_REPORT_COLUMNS]
