"""`footsense lab walk`: the log of a robot that walks in MuJoCo, for a scene of kind `log`."""

from pathlib import Path

import click

from footsense.cli.lab import options
from footsense.cli.options import FILE, json_option
from footsense.cli.tables import echo_figures
from footsense.clock import stopwatch_ns
from footsense.errors import require
from footsense.progress import timed_bar

#: Usual time of a second of a walk, and longest walk, which a scene still reads [s].
_COST_S, _LONGEST_S = 0.35, 300.0


@click.command()
@click.argument("gait")
@click.argument("output", type=FILE)
@click.option("--robot", default="hexapod-2kg", show_default=True, help="Robot; another name lists them all.")
@click.option("--ground", default="flat", show_default=True, help="Ground; another name lists them all.")
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True)
@click.option(
    "--duration",
    "duration_s",
    type=click.FloatRange(0.1, _LONGEST_S),
    default=20.0,
    show_default=True,
    metavar="SECONDS",
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
