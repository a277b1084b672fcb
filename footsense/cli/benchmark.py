"""`footsense benchmark`: what limits the scan, how old a force is, what a cycle costs, and how late the loop wakes.

Ratios only: each figure stands beside its physical limit, or beside the same work done in C or naively in the same run.
"""

import json
import subprocess
import sys
from typing import Any

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from footsense.benchmarks.cycle import WARM_UP, cycle_figures, recorded_scans
from footsense.benchmarks.scan import conversion_limit_ms, publish_age_ms, scan_figures
from footsense.benchmarks.wakeup_latency import jitter_figures
from footsense.cli.options import json_option
from footsense.errors import FootsenseError

_CYCLES, _QUICK_CYCLES = 400, 60
_JITTER_S, _QUICK_JITTER_S = 10.0, 1.0


@click.command()
@json_option
@click.option("--quick", is_flag=True, help="In seconds: the tails are then of few wake-ups.")
@click.option(
    "--cycles", type=click.IntRange(min=1), help=f"Cycles to time, three ways in turns.  [default: {_CYCLES}]"
)
def benchmark(*, as_json: bool, quick: bool, cycles: int | None) -> None:
    """Measure scan, age, cycle, lateness, start and memory, each beside its limit, C, or a naive program."""
    scan = scan_figures()
    figures: dict[str, Any] = {
        "conversion_limit_ms": conversion_limit_ms(),
        "scan": scan,
        "scan_over_limit": {name: one["over_limit"] for name, one in scan.items()},
        "scan_over_best": {name: one["over_best"] for name, one in scan.items()},
        "publish_age_ms": publish_age_ms(),
    }
    scans = recorded_scans(WARM_UP + (cycles or (_QUICK_CYCLES if quick else _CYCLES)))
    cycle = cycle_figures(scans)
    figures |= {
        "cycle_us": cycle,
        "cycle_over_c_floor": cycle.pop("cycle_over_c_floor"),
        "naive_over_cycle": cycle.pop("naive_over_cycle"),
        "jitter_us": jitter_figures(scans, _QUICK_JITTER_S if quick else _JITTER_S),
        **_start_figures(),
    }
    if as_json:
        click.echo(json.dumps(figures, indent=2))
    else:
        _print(figures)


def _start_figures() -> dict[str, float]:
    """Return what `footsense run` says of its own start.

    Raises:
        FootsenseError: It did not run.
    """
    command = [sys.executable, "-m", "footsense", "run", "--duration", "1", "--fast", "--summary", "json"]
    run = subprocess.run(command, check=False, capture_output=True, text=True)  # noqa: S603 - our own module
    if run.returncode:
        raise FootsenseError(f"the run whose start is measured failed: {run.stderr.strip()}")
    answer = json.loads(run.stdout)
    return {"start_s": answer["start_to_first_frame_s"], "resident_mib": answer["resident_mib"]}


def _table(title: str, *columns: str) -> Table:
    table = Table(box=None, title=escape(title), title_justify="left", min_width=60)
    table.add_column("")
    for name in columns:
        table.add_column(escape(name), justify="right")
    return table


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _print(figures: dict[str, Any]) -> None:
    console = Console(highlight=False)
    scans = _table(
        f"scan of six legs, limit {figures['conversion_limit_ms']:.1f} ms",
        *("period [ms]", "rate [Hz]", "over limit", "over best", "naive / ours"),
    )
    for name, scan in figures["scan"].items():
        scans.add_row(
            name.replace("_", " "),
            f"{scan['period_ms']:.2f}",
            f"{scan['rate_hz']:.1f}",
            f"{scan['over_limit']:.3f}",
            f"{scan['over_best']:.3f}",
            _number(scan["naive_over_ours"], 1),
        )
    console.print(scans)
    ages = _table("\nage of a force when it is sent, one bus at 40 us", "p50 [ms]", "p99 [ms]")
    for mode, age in figures["publish_age_ms"].items():
        ages.add_row(f"publish: {mode}", f"{age['p50']:.1f}", f"{age['p99']:.1f}")
    console.print(ages)
    _print_cycle(console, figures)
    _print_jitter(console, figures["jitter_us"])
    console.print(
        f"\nstart {figures['start_s']:.2f} s to the first frame, {figures['resident_mib']:.0f} MiB resident"
    )


def _print_cycle(console: Console, figures: dict[str, Any]) -> None:
    cycle = figures["cycle_us"]
    floor, naive = figures["cycle_over_c_floor"], figures["naive_over_cycle"]
    table = _table("\na cycle of six legs: estimate, publish, count, record", "p50 [us]", "p99 [us]", "ratio")
    table.add_row("ours", f"{cycle['p50']:.0f}", f"{cycle['p99']:.0f}", "")
    table.add_row("one C call", _number(cycle["c_floor_p50"], 0), "", f"ours / C {_number(floor, 1)}")
    table.add_row("naive", _number(cycle["naive_p50"], 0), "", f"naive / ours {_number(naive, 1)}")
    console.print(table)
    if floor is None:
        console.print("no C compiler (cc, gcc or clang) here: nothing in C to compare with")
    if naive is None:
        console.print("cantools is not installed: no naive program to compare with")


def _print_jitter(console: Console, jitter: dict[str, Any]) -> None:
    table = _table("\nlateness of a loop at 500 Hz", "p50 [us]", "p99 [us]", "p99.9 [us]", "ours / C")
    for case in ("quiet", "loaded"):
        for name, tails in jitter[case]["tails"].items():
            ratio = _number(jitter[case]["ratio"], 2) if name == "ours" else ""
            table.add_row(f"{case}, {name}", *(f"{tail:.0f}" for tail in tails.values()), ratio)
    console.print(table)
    console.print(
        "; ".join(jitter["not_granted"]) or "under SCHED_FIFO, memory locked, metrics scraped over HTTP"
    )
