"""Walking robots: the log of one for a scene of kind `log`, and what the service's estimation tells of many."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from footsense.cli.lab import options
from footsense.cli.options import FILE, json_option
from footsense.cli.tables import echo_figures, echo_json
from footsense.clock import stopwatch_ns
from footsense.errors import require
from footsense.progress import timed_bar

#: Usual time of a second of a walk, and longest walk, which a scene still reads [s].
_COST_S, _LONGEST_S = 0.35, 300.0


@click.command()
@click.argument("gait")
@click.argument("output", type=FILE)
@click.option("--robot", default="hexapod-2kg", help="Robot; another name lists them all.")
@click.option("--ground", default="flat", help="Ground; another name lists them all.")
@click.option("--seed", type=click.IntRange(min=0), default=1)
@click.option(
    "--duration", "duration_s", type=click.FloatRange(0.1, _LONGEST_S), default=20.0, metavar="SECONDS"
)
@json_option
def walk(
    *, gait: str, output: Path, robot: str, ground: str, seed: int, duration_s: float, as_json: bool
) -> None:
    """Let a robot walk in MuJoCo, and write what its feet feel.

    GAIT: another name lists them all. OUTPUT is an .npz file for scenes of kind log, a thousand samples a second. Needs
    the extra walkers alone.
    """
    require("lab walk", "walkers", "mujoco")
    from footsense.lab.walkers.robots import GRAVITY_M_S2, ROBOTS
    from footsense.lab.walkers.split import WalkerRun

    options.ensure_writable_folder(output.parent)
    started_ns = stopwatch_ns()
    with timed_bar("the robot walks", _COST_S * duration_s):
        log = WalkerRun(robot, gait, ground, seed, duration_s).log()
    took_s = (stopwatch_ns() - started_ns) / 1e9
    log.save(output)
    figures = {
        "file": str(output),
        "seconds_per_simulated_second": took_s / duration_s,
        "peak_n": log.peak_n(),
        "peak_over_weight": log.peak_n() / (ROBOTS[robot].mass_kg * GRAVITY_M_S2),
        "n_touches": log.n_touches(),
    }
    echo_figures(figures, as_json=as_json)


def _echo(figures: Any, as_markdown: Callable[[Any], str], *, as_json: bool) -> None:  # noqa: ANN401 - of a study
    if as_json:
        echo_json(figures)
    else:
        click.echo(as_markdown(figures))


@click.command()
@json_option
def selection(*, as_json: bool) -> None:
    """Print how contact is told on the selection of gaits.

    Robots, gaits and slow loads of the selection go through the service's estimation: touches found, in the air and
    twice, when they are told, how they are dated. Numbers of `footsense/estimation` are chosen by it, and judged by
    `footsense lab study motion`, which has other robots and gaits. Takes a few minutes.
    """
    from footsense.foot.type_folders import released_folder, released_names
    from footsense.lab.walkers.selection import as_markdown, select

    _echo(select([released_folder(foot) for foot in released_names()]), as_markdown, as_json=as_json)


@click.command()
@click.option("--feet", "n_feet", type=click.IntRange(11, 2000), default=44, help="Feet in all cases.")
@json_option
def selfcal(n_feet: int, *, as_json: bool) -> None:
    """Print what feet gain that find their electrodes.

    How far forces err before and after a minute of walking: feet as made, with calibrations that are right or old, and
    with wear, in gaits of which nothing was chosen; and whether `footsense selfcal` proposes a calibration. Feet 0, 1,
    ... of seed 0, a case each in turn. Takes a quarter of a minute for each foot.
    """
    from footsense.lab.studies.boards.walking_electrodes import as_markdown, walking_figures

    _echo(walking_figures(n_feet), as_markdown, as_json=as_json)
