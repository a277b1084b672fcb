"""`footsense soak`: a virtual day of walking in which something breaks every half minute."""

import json
import logging
import os
import sys
from pathlib import Path

import click
import msgspec

from footsense.clock import stopwatch_ns
from footsense.validation.soak import Walked, walk_day, walk_stretch
from footsense.validation.soak_stretches import Stretch, day


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
    """Walk for hours while wires, chips, feet and CAN break at random, and count what must never be.

    Stretches of an hour or two have a process each: at 400 and at 100 conversions a second, with a force after each
    scan and after each conversion, warmer and colder by 20 K, with two stands of half an hour. Ends with 1 if an
    invariant was lost; the line that says so names the stretch, and --only walks it again.
    """
    logging.disable(logging.WARNING)  # what breaks is on purpose
    stretches = day(hours, seed)
    _refuse(only, len(stretches), as_json)
    began_ns = stopwatch_ns()
    walked: list[Walked] = []
    if only is not None:
        walked.append(walk_stretch(stretches[only]))
        click.echo(_line(walked[0]))
    else:
        for one in walk_day(stretches, jobs or os.cpu_count() or 1):
            walked.append(one)
            click.echo(_line(one))
    wall_s = (stopwatch_ns() - began_ns) * 1e-9
    n_lost = sum(sum(one.n_lost.values()) for one in walked)
    virtual_s = sum(one.virtual_s for one in walked)
    n_faults = sum(one.n_faults for one in walked)
    click.echo(
        f"{virtual_s / 3600.0:.2f} h walked in {wall_s / 60.0:.1f} min, {n_faults} faults, "
        f"{sum(one.n_cycles for one in walked)} frames: {n_lost} invariants lost"
    )
    for one in walked:
        for lost in one.lost:
            click.echo(
                f"  stretch {one.stretch.number}, {lost.t_s:.4f} s, {lost.leg or 'all'}: {lost.rule}: {lost.what}"
            )
    if as_json is not None:
        told = {
            "hours": hours,
            "seed": seed,
            "wall_s": round(wall_s, 1),
            "n_lost": n_lost,
            "stretches": msgspec.to_builtins(sorted(walked, key=lambda one: one.stretch.number)),
        }
        as_json.write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")
    sys.exit(1 if n_lost else 0)


def _refuse(only: int | None, n_stretches: int, as_json: Path | None) -> None:
    """Say before hours of walking what would be in vain.

    Raises:
        click.BadParameter: There is no such stretch, or no folder for the figures.
    """
    if only is not None and only >= n_stretches:
        raise click.BadParameter(f"this walk has stretches 0 to {n_stretches - 1}", param_hint="--only")
    if as_json is not None and not as_json.parent.is_dir():
        raise click.BadParameter(f"{as_json}: there is no directory {as_json.parent}", param_hint="--json")


def _line(walked: Walked) -> str:
    stretch = walked.stretch
    growth = f"{walked.resident_mib[0]:.1f} to {walked.resident_mib[1]:.1f} MiB"
    return (
        f"stretch {stretch.number}: {stretch.hours:g} h {_way(stretch)}: {walked.n_faults} faults, "
        f"{sum(walked.n_lost.values())} lost, worst gap {1e3 * walked.worst_gap_s:.0f} ms, {growth} "
        f"({walked.growth_mib_per_h:+.2f} MiB/h), {walked.virtual_s / walked.wall_s:.1f} x real time"
    )


def _way(stretch: Stretch) -> str:
    parts = [f"{stretch.rate_sps} S/s", stretch.publish]
    if stretch.kelvin:
        parts.append(f"{stretch.kelvin:+g} K")
    if stretch.stands_s:
        parts.append("with a stand")
    return ", ".join(parts)
