"""Command `footsense benchmark`: scan period, age of the forces, cycle time, wake-up latency, start time, memory.

Ratios only: each figure stands beside its physical limit, or beside the same work done in C or naively in the same run.
"""

import json
import subprocess
import sys
from collections.abc import Iterable, Sequence
from typing import Any

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from footsense.benchmarks.cycle import compare_cycle_durations
from footsense.benchmarks.our_cycle import N_WARM_UP_CYCLES, simulated_walk_frames
from footsense.benchmarks.scan import (
    measure_all_scan_periods,
    min_scan_period_by_conversions_ms,
    newest_reading_age_ms,
)
from footsense.benchmarks.viewed_latency import measure_viewed_latency
from footsense.benchmarks.wakeup_latency import measure_wakeup_latency
from footsense.cli.options import json_option
from footsense.cli.tables import echo_json
from footsense.errors import FootsenseError
from footsense.progress import timed_bar

_CYCLES, _QUICK_CYCLES = 800, 60
_WAKEUP_S, _QUICK_WAKEUP_S = 10.0, 1.0
#: Usual durations of the command [s].
_USUAL_S, _QUICK_USUAL_S = 80.0, 20.0
#: Figures of a scan, and their digits.
_SCAN_COLUMNS = (
    ("period_ms", 2),
    ("rate_hz", 1),
    ("over_limit", 3),
    ("over_best", 3),
    ("naive_over_ours", 1),
)


@click.command()
@json_option
@click.option("--quick", is_flag=True, help="In seconds: the tails are then of few wake-ups.")
@click.option(
    "--cycles", type=click.IntRange(min=1), help=f"Cycles to time, three ways in turns.  [default: {_CYCLES}]"
)
def benchmark(*, as_json: bool, quick: bool, cycles: int | None) -> None:
    """Measure scan, age, cycle, wake-up latency, start and memory, each beside its limit, C, or a naive program."""
    with timed_bar("benchmark", _QUICK_USUAL_S if quick else _USUAL_S):
        figures = _measure_all(cycles or (_QUICK_CYCLES if quick else _CYCLES), quick=quick)
    if as_json:
        echo_json(figures)
    else:
        _print_results(figures)


def _measure_all(n_cycles: int, *, quick: bool) -> dict[str, Any]:
    """Run all benchmarks; return their figures by name."""
    scan = measure_all_scan_periods()
    figures: dict[str, Any] = {
        "conversion_limit_ms": min_scan_period_by_conversions_ms(),
        "scan": scan,
        "scan_over_limit": {name: one["over_limit"] for name, one in scan.items()},
        "scan_over_best": {name: one["over_best"] for name, one in scan.items()},
        "age_ms": newest_reading_age_ms(),
    }
    scans = simulated_walk_frames(N_WARM_UP_CYCLES + n_cycles)
    cycle = compare_cycle_durations(scans)
    return figures | {
        "cycle_us": cycle,
        "cycle_over_c_program": cycle.pop("cycle_over_c_program"),
        "naive_over_cycle": cycle.pop("naive_over_cycle"),
        "wakeup_latency_us": measure_wakeup_latency(scans, _QUICK_WAKEUP_S if quick else _WAKEUP_S),
        "viewed_latency_us": measure_viewed_latency(scans, _QUICK_WAKEUP_S if quick else _WAKEUP_S),
        **_measure_startup_time_and_memory(),
    }


def _measure_startup_time_and_memory() -> dict[str, float]:
    """Return start-up time [s] and memory [MiB] of a `footsense run` process.

    Raises:
        FootsenseError: The run failed.
    """
    command = [sys.executable, "-m", "footsense", "run", "--duration", "1", "--fast", "--summary", "json"]
    run = subprocess.run(command, check=False, capture_output=True, text=True)  # noqa: S603 - our own module
    if run.returncode:
        raise FootsenseError(f"the run whose start is measured failed: {run.stderr.strip()}")
    answer = json.loads(run.stdout)
    return {"start_s": answer["start_to_first_frame_s"], "resident_mib": answer["resident_mib"]}


def _table(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    """Return a table for the terminal."""
    table = Table("", box=None, title=escape(title), title_justify="left", min_width=60)
    for name in columns:
        table.add_column(escape(name), justify="right")
    for row in rows:
        table.add_row(*row)
    return table


def _number_text(value: float | None, digits: int) -> str:
    """Return a number as text with some decimals; "-" for None."""
    return "-" if value is None else f"{value:.{digits}f}"


def _print_results(figures: dict[str, Any]) -> None:
    """Print the benchmark figures as tables."""
    cycle, wakeup = figures["cycle_us"], figures["wakeup_latency_us"]
    c_program, naive = figures["cycle_over_c_program"], figures["naive_over_cycle"]
    console = Console(highlight=False)
    console.print(
        _table(
            f"scan of six legs, limit {figures['conversion_limit_ms']:.1f} ms",
            ("period [ms]", "rate [Hz]", "over limit", "over best", "naive / ours"),
            (
                [name.replace("_", " "), *(_number_text(scan[key], digits) for key, digits in _SCAN_COLUMNS)]
                for name, scan in figures["scan"].items()
            ),
        ),
        _table(
            "\nage of the newest reading when its force is sent, one bus at 40 us",
            ("p50 [ms]", "p99 [ms]"),
            [["default", *(f"{age:.1f}" for age in figures["age_ms"].values())]],
        ),
        _table(
            "\na cycle of six legs: estimate, publish, count, record",
            ("p50 [us]", "p99 [us]", "ratio"),
            (
                ("ours", _number_text(cycle["p50"], 0), _number_text(cycle["p99"], 0), ""),
                (
                    "one C call",
                    _number_text(cycle["c_program_p50"], 0),
                    "",
                    f"ours / C {_number_text(c_program, 1)}",
                ),
                ("naive", _number_text(cycle["naive_p50"], 0), "", f"naive / ours {_number_text(naive, 1)}"),
            ),
        ),
        sep="\n",
    )
    if c_program is None:
        console.print("no C compiler (cc, gcc or clang) or no onnx here: no comparison with C")
    if naive is None:
        console.print("cantools is not installed: no comparison with a naive program")
    console.print(
        _table(
            "\nwake-up latency of a loop at 500 Hz",
            ("p50 [us]", "p99 [us]", "p99.9 [us]", "ours / C"),
            (
                [
                    f"{case}, {name}",
                    *(f"{tail:.0f}" for tail in tails.values()),
                    _number_text(wakeup[case]["ratio"], 2) if name == "ours" else "",
                ]
                for case in ("quiet", "loaded")
                for name, tails in wakeup[case]["tails"].items()
            ),
        ),
        "; ".join(wakeup["not_granted"]) or "under SCHED_FIFO, memory locked, metrics scraped over HTTP",
        _table(
            "\nthe same loop, its page served to a viewer and to five clients that do not read",
            ("p50 [us]", "p99 [us]", "p99.9 [us]", "viewed / alone"),
            (
                [
                    case,
                    *(f"{tail:.0f}" for tail in tails.values()),
                    _number_text(figures["viewed_latency_us"]["ratio"], 2) if case == "viewed" else "",
                ]
                for case, tails in figures["viewed_latency_us"]["tails"].items()
            ),
        ),
        f"\nstart {figures['start_s']:.2f} s to the first frame, {figures['resident_mib']:.0f} MiB resident",
        sep="\n",
    )
