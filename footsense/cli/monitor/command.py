"""`footsense monitor`: the legs on CAN, as a consumer of their forces sees them."""

from collections.abc import Iterator
from contextlib import closing

import click
from rich.console import Console
from rich.live import Live

from footsense.cli.can.can_options import can_options
from footsense.cli.monitor.json_values import snapshot_json
from footsense.cli.monitor.table import monitor_table
from footsense.cli.options import StopRequest, duration_option, echo_json
from footsense.client import LinkLimits
from footsense.clock import MonotonicClock
from footsense.daemon.can_listener import Listener, open_listener

_NS_PER_S = 1_000_000_000
_REDRAW_PERIOD_NS = 200_000_000


@click.command()
@can_options
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
    interface: str,
    channel: str,
    force_step_mn: int,
    n_elements: int,
    max_age_ms: int,
    duration_s: float,
    *,
    as_json: bool,
) -> None:
    """Show the legs on CAN: state, force with its age and uncertainty, and the cause of a fault.

    Only listens. A force is shown if a consumer that accepts degraded legs may use it.
    """
    limit_ns = max_age_ms * 1_000_000
    limits = LinkLimits(max_age_ns=limit_ns, timeout_ns=limit_ns, accept_degraded=True)
    console = Console()
    clock = MonotonicClock()
    stop = StopRequest()
    start_ns = clock.now_ns()
    end_ns = start_ns + duration_s * _NS_PER_S
    with closing(open_listener(interface, channel, clock, limits, force_step_mn, n_elements)) as listener:
        if as_json or not console.is_terminal:
            for t_ns in _listen_in_periods(listener, start_ns, end_ns, _NS_PER_S, stop):
                for snapshot in listener.snapshot():
                    t_s = round((t_ns - start_ns) * 1e-9, 3)
                    echo_json({"t_s": t_s, **snapshot_json(snapshot)}, indent=0)
            return
        with Live(console=console, auto_refresh=False, screen=False) as live:
            for t_ns in _listen_in_periods(listener, start_ns, end_ns, _REDRAW_PERIOD_NS, stop):
                title = f"{channel}   {(t_ns - start_ns) * 1e-9:5.1f} s"
                live.update(monitor_table(listener.snapshot(), title), refresh=True)


def _listen_in_periods(
    listener: Listener, start_ns: int, end_ns: float, period_ns: int, stop: StopRequest
) -> Iterator[int]:
    """Receive from CAN in periods of `period_ns`, until the end or a signal; yield the time after each period.

    Yields:
        Time at the end of each period [ns].
    """
    t_ns = start_ns
    while t_ns + period_ns <= end_ns:
        while t_ns < (due_ns := start_ns + period_ns):
            t_ns = min(due_ns, t_ns + _REDRAW_PERIOD_NS)
            listener.listen(t_ns)
            if stop.requested:
                return
        yield t_ns
        start_ns = t_ns
