"""`footsense bench`: what limits the scan, what a cycle costs, and how long a start takes.

Ratios only: each figure stands beside its physical limit or beside the same work done naively in the same run.
The scan is measured in virtual time, where bus bits, conversions and host costs are exact; the cycle on this
processor, ours and the naive one in turns, so that what else the machine does strikes both alike.
"""

import importlib.util
import json
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import click
import numpy as np
from msgspec.structs import replace
from rich.console import Console
from rich.table import Table

import firmware_interface
from firmware_interface import fdc1004
from footsense import app
from footsense.cli.bench_naive import NaiveCycle, sequential_scan
from footsense.clock import stopwatch_ns
from footsense.config import DEFAULT, Bus, Config
from footsense.errors import FootsenseError
from footsense.frames import CapFrame, Flag
from footsense.loop import step
from footsense.sim.clock import VirtualClock
from footsense.sim.scene import Scene, load_scene

_SCANS = 40
_WARM_UP = 40  # scans in which the feet are tared
_TWO_BUSES = replace(
    DEFAULT,
    buses=(
        Bus(device="sim0", legs={"lf": 0, "lm": 1, "lr": 2}),
        Bus(device="sim1", legs={"rf": 0, "rm": 1, "rr": 2}),
    ),
)


@click.command()
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of a table.")
@click.option(
    "--cycles",
    type=click.IntRange(min=1),
    default=400,
    show_default=True,
    help="Cycles to time, ours and naive in turns.",
)
def bench(*, as_json: bool, cycles: int) -> None:
    """Measure scan period, cycle cost, start-up and memory, each beside its limit or a naive program."""
    figures: dict[str, Any] = {
        "conversion_limit_ms": 9 * fdc1004.RATES[DEFAULT.scan.rate_sps].conversion_ns * 1e-6,
        "scan": {
            f"{buses}_{host_cost_us}us": _scan_figures(config, host_cost_us)
            for buses, config in (("one_bus", DEFAULT), ("two_buses", _TWO_BUSES))
            for host_cost_us in (0, 40, 100)
        },
        "cycle_us": _cycle_figures(cycles),
        "start": _start_figures(),
    }
    if as_json:
        click.echo(json.dumps(figures, indent=2))
    else:
        _print(figures)


def _scan_figures(config: Config, host_cost_us: int) -> dict[str, float]:
    """Return the scan period of six legs at 400 kHz, and that of the naive loop."""
    scene = replace(load_scene("hanging"), host_cost_us=float(host_cost_us))
    limit_ns = 9 * fdc1004.RATES[config.scan.rate_sps].conversion_ns
    with app.scanning(config, scene) as scanning:
        scanning.source.read()
        start_ns = scanning.clock.now_ns()
        for _ in range(_SCANS):
            scanning.source.read()
            scanning.clock.now_ns()
        period_ns = (scanning.clock.now_ns() - start_ns) / _SCANS
    robot = app.simulated_robot(config, scene)
    sequential_scan(robot.buses[0], robot.clocks[0], config)
    # Two buses are scanned side by side also by a naive program with two threads.
    naive_ns = robot.clocks[0].now_ns()
    return {
        "period_ms": period_ns * 1e-6,
        "rate_hz": 1e9 / period_ns,
        "over_limit": period_ns / limit_ns,
        "naive_period_ms": naive_ns * 1e-6,
        "naive_over_ours": naive_ns / period_ns,
    }


def _recorded_scans(scene: Scene, n: int) -> list[CapFrame]:
    with app.scanning(DEFAULT, scene) as scanning:
        return [scanning.source.read() for _ in range(n)]


def _cycle_figures(cycles: int) -> dict[str, float | None]:
    """Return what follows one scan of six legs: normalise, infer, encode, hand to the (virtual) bus."""
    scans = _recorded_scans(load_scene("measured_walk"), _WARM_UP + cycles)
    pipeline = app.pipeline_for(DEFAULT, app.load_network(DEFAULT), Flag.SIMULATED)
    ours_ns, naive_ns = [], []
    with ExitStack() as stack:
        clock = VirtualClock()
        sink = stack.enter_context(app.can_sink(DEFAULT, clock, None))
        naive = _naive(stack)
        for scan in scans:
            clock.sleep_until_ns(int(scan.t_ns.max()) + 2_000_000)
            start_ns = stopwatch_ns()
            step(scan, (), pipeline, sink, (), clock)
            between_ns = stopwatch_ns()
            if naive is not None:
                naive.run(scan, clock.now_ns())
                naive_ns.append(stopwatch_ns() - between_ns)
            ours_ns.append(between_ns - start_ns)
    ours_us, naive_us = np.array(ours_ns[_WARM_UP:]) * 1e-3, np.array(naive_ns[_WARM_UP:]) * 1e-3
    return {
        "ours_p50": float(np.median(ours_us)),
        "ours_p99": float(np.quantile(ours_us, 0.99)),
        "naive_p50": float(np.median(naive_us)) if naive else None,
        "naive_over_ours": float(np.median(naive_us) / np.median(ours_us)) if naive else None,
    }


def _naive(stack: ExitStack) -> NaiveCycle | None:
    """Return the naive cycle, or None where cantools is not installed: the robot does not need it."""
    if importlib.util.find_spec("cantools") is None:
        return None
    import cantools

    dbc = Path(firmware_interface.__file__).parent / "footsense.dbc"
    naive = NaiveCycle(DEFAULT, cantools.database.load_file(dbc))
    stack.callback(naive.close)
    return naive


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
    return {"to_first_frame_s": answer["start_to_first_frame_s"], "resident_mib": answer["resident_mib"]}


def _print(figures: dict[str, Any]) -> None:
    console = Console()
    table = Table(
        box=None,
        title_justify="left",
        title=f"scan of six legs, limit {figures['conversion_limit_ms']:.1f} ms",
    )
    for name in ("", "period [ms]", "rate [Hz]", "over limit", "naive [ms]", "naive / ours"):
        table.add_column(name, justify="right" if name else "left")
    for name, scan in figures["scan"].items():
        table.add_row(
            name.replace("_", " "),
            f"{scan['period_ms']:.2f}",
            f"{scan['rate_hz']:.1f}",
            f"{scan['over_limit']:.3f}",
            f"{scan['naive_period_ms']:.1f}",
            f"{scan['naive_over_ours']:.1f}",
        )
    console.print(table)
    cycle, start = figures["cycle_us"], figures["start"]
    console.print(f"cycle        {cycle['ours_p50']:.0f} us, p99 {cycle['ours_p99']:.0f} us", highlight=False)
    if cycle["naive_p50"] is not None:
        console.print(
            f"naive cycle  {cycle['naive_p50']:.0f} us, {cycle['naive_over_ours']:.1f} x ours",
            highlight=False,
        )
    console.print(
        f"start        {start['to_first_frame_s']:.2f} s to the first frame, {start['resident_mib']:.0f} MiB resident",
        highlight=False,
    )
