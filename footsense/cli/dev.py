"""Commands `footsense dev ...`: what the service costs, an hour of walks with faults, and its calls per conversion."""

import json
import logging
import os
import subprocess
import sys
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import click

from footsense.cli.options import json_option
from footsense.cli.tables import echo_figures, echo_json
from footsense.errors import FootsenseError
from footsense.progress import progress_bar, timed_bar

if TYPE_CHECKING:
    from footsense.validation.soak import StretchResult

#: Cycles, time of the wake-ups [s], cycles whose instructions are counted, and usual duration [s] of the benchmark and
#: its quick form.
_WHOLE, _QUICK = (800, 10.0, 24, 90.0), (60, 1.0, 4, 35.0)


@click.group()
def dev() -> None:
    """Measure and test footsense itself: benchmark, soak, trace."""


@dev.command(short_help="Measure scan, cycle, instructions, latency, start and memory.")
@json_option
@click.option("--quick", is_flag=True, help="Faster: the tails are then of few wake-ups.")
def benchmark(*, as_json: bool, quick: bool) -> None:
    """Measure scan, age, cycle, virtual feet, latency, start and memory, beside a limit or a naive program.

    Instructions are counted by the kernel, or by valgrind where its counters cannot be used.
    """
    n_cycles, wakeup_s, n_counted_cycles, usual_s = _QUICK if quick else _WHOLE
    with timed_bar("benchmark", usual_s):
        figures = _measure_all(n_cycles, wakeup_s, n_counted_cycles)
    echo_figures(figures, as_json=as_json)


def _measure_all(n_cycles: int, wakeup_s: float, n_counted_cycles: int) -> dict[str, Any]:
    from footsense.benchmarks.cycle import N_WARM_UP_CYCLES, compare_cycle_durations, simulated_walk_frames
    from footsense.benchmarks.scan import (
        measure_all_scan_periods,
        measure_converter_kinds,
        measure_free_scans,
        min_scan_period_by_conversions_ms,
        newest_reading_age_ms,
    )
    from footsense.benchmarks.wakeup_latency import measure_threads, measure_wakeup_latency

    scans = simulated_walk_frames(N_WARM_UP_CYCLES + n_cycles)
    return {
        "ad7147": measure_free_scans(),
        "threads_us": measure_threads(n_cycles),
        "scan": measure_all_scan_periods(),
        "converter_kinds": measure_converter_kinds(),
        "conversion_limit_ms": min_scan_period_by_conversions_ms(),
        "age_ms": newest_reading_age_ms(),
        "cycle_us": compare_cycle_durations(scans),
        "instructions": _instructions(n_counted_cycles),
        "virtual_feet": _virtual_feet(),
        "wakeup_latency_us": measure_wakeup_latency(scans, wakeup_s),
        **_start_and_memory(),
    }


def _instructions(n_cycles: int) -> dict[str, Any] | None:
    """Return the instructions of a cycle; None, and a line that says why, where they cannot be counted."""
    from footsense.benchmarks.instructions import count_cycles, usable_counter

    counter = usable_counter()
    if counter is None:
        click.echo(
            "instructions are not counted: the kernel has no counter here, and there is no valgrind", err=True
        )
        return None
    counted = count_cycles(counter, n_cycles)
    return {"counter": counter, "a_second": counted.instructions_a_second(), **counted.figures()}


def _virtual_feet() -> dict[str, Any] | None:
    """Return the figures of feet in a batch; None, and a line that says why, without their extra."""
    if find_spec("array_api_compat") is None:
        click.echo(
            "feet in a batch are not measured: in the clone of footsense: "
            "pip install -e deploy/client -e '.[simulators]'",
            err=True,
        )
        return None
    from footsense.benchmarks.virtual_feet import measure_virtual_feet

    return {"ad7147": measure_virtual_feet("ad7147"), "fdc1004": measure_virtual_feet("fdc1004")}


def _start_and_memory() -> dict[str, float]:
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


@dev.command(short_help="List the functions that one conversion calls.")
def trace() -> None:
    """List the modules and functions of one conversion of six legs with their calls, and count them."""
    from footsense.benchmarks.trace import calls_per_conversion, functions_called_steadily

    calls = calls_per_conversion()
    steady = set(functions_called_steadily(calls))
    for module in sorted({module for module, _ in calls}):
        inside = {name: n for (path, name), n in calls.items() if path == module}
        click.echo(f"{sum(inside.values()):8.1f} {module}")
        for name, n in sorted(inside.items(), key=lambda function: -function[1]):
            click.echo(f"{n:17.2f} {name}{'' if (module, name) in steady else '  (rare)'}")
    click.echo(
        f"{len({module for module, _ in steady})} modules, {len(steady)} functions, "
        f"{sum(calls.values()):.0f} calls per conversion of six legs"
    )


@dev.command(short_help="Walk for an hour with faults, and check the invariants.")
@click.option(
    "--hours", type=click.FloatRange(min=0.005), default=1.0, show_default=True, help="Virtual time [h]."
)
@click.option(
    "--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Of everything random."
)
@click.option("--only", type=click.IntRange(min=0), help="Walk this stretch alone, in this process.")
@json_option
def soak(*, hours: float, seed: int, only: int | None, as_json: bool) -> None:
    """Walk robots of the judging gaits on made and worn feet, with faults, and check the invariants.

    Stretches of six minutes have a process each: another robot, gait, ground and draw of feet, with the rows of the
    fault tables at random times, a controller that commands legs and tells their motions, two restarts of the service
    and steps of the wall clock. Ends with 1 after a violation; its line names the stretch, and --only walks it again.
    """  # noqa: DOC501 - click shows this text
    from footsense.clock import stopwatch_ns
    from footsense.validation.processes import run_in_processes
    from footsense.validation.soak import soak_stretches, walk_stretch

    logging.disable(logging.WARNING)  # the faults are on purpose
    stretches = soak_stretches(hours, seed)
    if only is not None and only >= len(stretches):
        raise click.BadParameter(f"this walk has stretches 0 to {len(stretches) - 1}", param_hint="--only")
    began_ns = stopwatch_ns()
    walks = (
        [walk_stretch(stretches[only])]
        if only is not None
        else run_in_processes(walk_stretch, stretches, os.cpu_count() or 1, max_parts_per_process=1)
    )
    results: list[StretchResult] = []
    with progress_bar("walked", sum(stretch.hours for stretch in stretches)) as hours_done:
        for result in walks:
            results.append(result)
            if not as_json:
                click.echo(result.line)
            hours_done(sum(one.stretch.hours for one in results))
    wall_s = (stopwatch_ns() - began_ns) * 1e-9
    n_violations = sum(sum(result.n_violations.values()) for result in results)
    if as_json:
        results.sort(key=lambda result: result.stretch.number)
        figures = {"hours": hours, "seed": seed, "wall_s": round(wall_s, 1), "n_violations": n_violations}
        echo_json(figures | {"stretches": results})
    else:
        click.echo(
            f"{sum(result.virtual_s for result in results) / 3600.0:.2f} h walked in {wall_s / 60.0:.1f} min, "
            f"{sum(result.n_faults for result in results)} faults, "
            f"{sum(result.n_cycles for result in results)} cycles: {n_violations} violations"
        )
        for result in results:
            for rule, t_s, leg, detail in result.first_violations:
                click.echo(
                    f"  stretch {result.stretch.number}, {t_s:.4f} s, {leg or 'all'}: {rule}: {detail}"
                )
    sys.exit(1 if n_violations else 0)
