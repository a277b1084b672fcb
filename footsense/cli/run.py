"""Command `footsense run`: the service (daemon), on a robot or in simulation."""

import subprocess
import sys
import webbrowser
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from msgspec.structs import replace

from footsense.cli import options
from footsense.cli.tables import echo_figures, echo_json
from footsense.clock import process_age_ns
from footsense.config import DEFAULT, Config, load_config
from footsense.config.sections import PageServer
from footsense.daemon.can_output import frames_destination, others_hear
from footsense.daemon.foot_types import foot_type_of
from footsense.daemon.scheduling import resident_mib
from footsense.daemon.service import open_service
from footsense.daemon.simulation import PacedSource, is_simulated
from footsense.daemon.walker_scene import PREFIX, scene_of
from footsense.frames import FAULT_FREE, State
from footsense.ring.ring_file import default_ring, free_ring
from footsense.sim.scene import scene_names
from footsense.telemetry.run_statistics import RunStatistics

if TYPE_CHECKING:
    from rich.console import Console

_DEFAULT_SCENE = "tripod"
_NS_PER_S = 1_000_000_000


@contextmanager
def _page_of(ring: Path, view: PageServer) -> Iterator[subprocess.Popen[str]]:
    """Run `footsense view` as a child process beside the main loop; its first line is the URL of the page.

    It starts before the loop asks for real-time scheduling, on the configured port or on a free one.

    Yields:
        The process.
    """
    place = ["--ring", str(ring), "--address", view.address, "--port", str(view.port)]
    with subprocess.Popen(  # noqa: S603 - our own module
        [sys.executable, "-P", "-m", "footsense", "view", *place, "--with-parent"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as page:
        try:
            yield page
        finally:
            page.terminate()


@click.command()
@options.config_option("six simulated legs")
@click.option(
    "--scene",
    "scene_name",
    help=f"Simulate this scene: a name ({', '.join(scene_names())}), a YAML file, or walker:GAIT or "
    "walker:GAIT:GROUND for a robot that walks in MuJoCo, such as walker:trot-fast (extra walkers).",
)
@options.duration_option("Stop after this time of the robot.")
@click.option("--record", type=options.FILE, help="Record every reading and force to this .mcap file.")
@options.can_log_option
@click.option(
    "--summary", type=click.Choice(["text", "json"]), help="Print figures at the end; no live table."
)
@options.pace_option
@click.option(
    "--view",
    "opens_view",
    is_flag=True,
    help="Serve the page of the robot (footsense view), and open it in the browser; paces a simulation.",
)
def run(
    config_file: Path | None,
    scene_name: str | None,
    duration_s: float,
    record: Path | None,
    can_log: Path | None,
    summary: str | None,
    *,
    realtime: bool | None,
    opens_view: bool,
) -> None:
    """Read the feet, estimate their forces, publish them on CAN.

    Without --config this is the built-in simulation of a walking robot.
    """
    config = load_config(config_file) if config_file else DEFAULT
    if scene_name is None and is_simulated(config):
        scene_name = _default_scene(config)
    scene = scene_of(scene_name, config, duration_s) if scene_name else None
    live = summary is None and _console().is_terminal
    followed = live or opens_view or others_hear(config, scene)
    paced = options.is_paced(simulated=scene is not None, realtime=realtime, followed=followed)
    stop = options.StopRequest()
    with ExitStack() as stack:
        page = None
        if opens_view or (config_file is None and paced):
            ring = free_ring(config.ring_path or default_ring(is_simulated=scene is not None))
            config = replace(config, ring=str(ring))
            page = stack.enter_context(_page_of(ring, config.view))
        service = stack.enter_context(
            open_service(config, scene, record=record, can_log=can_log, real_time=paced or scene is None)
        )
        statistics = RunStatistics(
            service.legs, service.true_force_n_at, service.network.card.max_trained_force_n, process_age_ns
        )
        service.observers.append(statistics)
        title = f"{scene_name}, simulated" if scene else "on the robot"
        url = page.stdout.readline().strip() if page is not None and page.stdout is not None else ""
        if page is not None and not live:
            click.echo(f"footsense  {title}  {url}", err=summary == "json")
        if scene and summary != "json":
            if scene_name and scene_name.startswith(PREFIX):
                click.echo(scene.description)
            click.echo(frames_destination(config, scene))
        if page is None and service.is_viewable and summary is None and (paced or scene is None):
            click.echo(f"page: run footsense view --config {config_file}")
        if opens_view and url:
            webbrowser.open(url)
        if live:
            from footsense.cli.live import LiveView, legs_table

            console = _console()
            max_force_n = service.network.card.max_trained_force_n
            picture = partial(
                legs_table, console, service.legs, title, url, service.true_force_n_at, max_force_n
            )
            service.observers.append(stack.enter_context(closing(LiveView(console, picture))))
        service.run(lambda: stop.requested, service.clock.now_ns() + duration_s * _NS_PER_S)
    can, source = service.sink.stats, service.source
    figures: dict[str, Any] = {
        "scene": scene_name,
        "real_time_factor": source.real_time_factor if isinstance(source, PacedSource) else None,
        **statistics.summary(),
        "can": {
            "published": can.published_cycles,
            "sent": can.sent,
            "dropped": can.dropped,
            "rejected_commands": can.rejected_commands,
        },
        "cycles_not_recorded": service.recorder and service.recorder.n_lost_cycles,
        "resident_mib": resident_mib(),
    }
    if summary == "json":
        echo_json(figures)
    else:
        # Of the states those of a fault; all of them are in JSON.
        states = {
            leg: {s: n for s, n in of_leg.items() if State[s.upper()] not in FAULT_FREE}
            for leg, of_leg in figures["states"].items()
        }
        echo_figures(figures | {"states": states}, as_json=False)


def _default_scene(config: Config) -> str:
    """Return the scene of the foot type, which has the forces of its robot; for one without a scene a tripod gait."""
    name = foot_type_of(config).replace("-", "_")
    return name if name in scene_names() else _DEFAULT_SCENE


def _console() -> "Console":
    """Return the console for tables; imports `rich` only when called."""
    from rich.console import Console

    return Console()
