"""Command `footsense soak`: simulate a day of walking with a fault every half minute, and check it."""

import json
import logging
import os
import sys
from pathlib import Path

import click
import msgspec

from footsense.clock import stopwatch_ns
from footsense.progress import progress_bar
from footsense.validation.processes import run_in_processes
from footsense.validation.soak import StretchResult, walk_stretch
from footsense.validation.soak_plan import soak_stretches


@click.command()
@click.option(
    "--hours", type=click.FloatRange(min=0.05), default=24.0, show_default=True, help="Virtual time [h]."
)
@click.option(
    "--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Of everything random."
)
@click.option(
    "--jobs", type=click.IntRange(min=1), help="Processes at a time; without it one for each processor."
)
@click.option("--only", type=click.IntRange(min=0), help="Walk this stretch alone, in this process.")
@click.option(
    "--json", "as_json", type=click.Path(dir_okay=False, path_type=Path), help="Write all figures here."
)
def soak(*, hours: float, seed: int, jobs: int | None, only: int | None, as_json: Path | None) -> None:
    """Walk for hours with random faults of wires, chips, feet and CAN, and check the invariants.

    Stretches of an hour or two have a process each: at 400 and at 100 conversions a second, with every fourth and
    with every force on CAN, warmer and colder by 20 K, with two stands of half an hour. Ends with 1 after a violation;
    its line names the stretch, and --only walks it again.
    """
    logging.disable(logging.WARNING)  # the faults are on purpose
    stretches = soak_stretches(hours, seed)
    _check_options(only, len(stretches), as_json)
    began_ns = stopwatch_ns()
    walks = (
        [walk_stretch(stretches[only])]
        if only is not None
        else run_in_processes(walk_stretch, stretches, jobs or os.cpu_count() or 1, max_parts_per_process=1)
    )
    results: list[StretchResult] = []
    with progress_bar("walked", sum(stretch.hours for stretch in stretches)) as hours_done:
        for result in walks:
            results.append(result)
            click.echo(_stretch_line(result))
            hours_done(sum(one.stretch.hours for one in results))
    wall_s = (stopwatch_ns() - began_ns) * 1e-9
    n_violations = sum(sum(result.n_violations.values()) for result in results)
    click.echo(
        f"{sum(result.virtual_s for result in results) / 3600.0:.2f} h walked in {wall_s / 60.0:.1f} min, "
        f"{sum(result.n_injected_faults for result in results)} faults, "
        f"{sum(result.n_cycles for result in results)} cycles: {n_violations} violations"
    )
    for result in results:
        for rule, t_s, leg, detail in result.first_violations:
            click.echo(f"  stretch {result.stretch.number}, {t_s:.4f} s, {leg or 'all'}: {rule}: {detail}")
    if as_json is not None:
        figures = {
            "hours": hours,
            "seed": seed,
            "wall_s": round(wall_s, 1),
            "n_violations": n_violations,
            "stretches": msgspec.to_builtins(sorted(results, key=lambda result: result.stretch.number)),
        }
        as_json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    sys.exit(1 if n_violations else 0)


def _check_options(only: int | None, n_stretches: int, as_json: Path | None) -> None:
    """Raise an error for options that would fail only after hours of simulation.

    Raises:
        click.BadParameter: There is no such stretch, or no folder for the figures.
    """
    if only is not None and only >= n_stretches:
        raise click.BadParameter(f"this walk has stretches 0 to {n_stretches - 1}", param_hint="--only")
    if as_json is not None and not as_json.parent.is_dir():
        raise click.BadParameter(f"{as_json}: there is no directory {as_json.parent}", param_hint="--json")


def _stretch_line(result: StretchResult) -> str:
    """Return the result of one stretch as a line of text."""
    stretch = result.stretch
    every = ["every force on CAN"] if stretch.publish_every == 1 else []
    warmer = [f"{stretch.warming_k:+g} K"] if stretch.warming_k else []
    stand = ["with a stand"] if stretch.standstill_spans_s else []
    return (
        f"stretch {stretch.number}: {stretch.hours:g} h "
        f"{', '.join([f'{stretch.rate_sps} S/s', *every, *warmer, *stand])}: {result.n_injected_faults} faults, "
        f"{sum(result.n_violations.values())} violations, longest gap {1e3 * result.longest_cycle_interval_s:.0f} ms, "
        "{:.1f} to {:.1f} MiB ".format(*result.warm_and_end_resident_mib)
        + f"({result.growth_mib_per_h:+.2f} MiB/h), {result.virtual_s / result.wall_s:.1f} x real time"
    )
