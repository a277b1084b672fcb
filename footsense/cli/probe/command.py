"""Command `footsense probe`: check I2C buses, chips and unloaded feet before the robot walks."""

import logging
import sys
from pathlib import Path

import click
from rich.console import Console

from footsense.cli.options import FILE, config_option, json_option
from footsense.cli.probe.json_values import adapters_json, probe_json
from footsense.cli.probe.picture import adapters_picture, probe_picture
from footsense.cli.tables import echo_json
from footsense.config import DEFAULT, load_config
from footsense.daemon.probe.bus_probe import probe as probe_robot
from footsense.daemon.probe.bus_probe import probe_adapters
from footsense.daemon.simulation import is_simulated
from footsense.sim.scene_files import load_scene

#: Exit code if there is a fault.
_EXIT_CODE_FAULTY = 1
_DEFAULT_SCENE = "hanging"


@click.command()
@config_option("none, scan only the addresses on this computer's adapters")
@click.option(
    "--scene",
    "scene_name",
    help="Simulate this scene: a name or a YAML file. Its feet should hang free, as in `hanging`.",
)
@json_option
@click.option("--png", type=FILE, help="Draw the feet into this file (needs footsense[lab]).")
def probe(config_file: Path | None, scene_name: str | None, png: Path | None, *, as_json: bool) -> None:
    """Scan the buses, measure their timing, and read every element of the free feet.

    Unknown addresses are only asked for an acknowledge, as `i2cdetect` does. Exit code 1 if there is a fault.
    """  # noqa: DOC501 - click shows this text
    console = Console(highlight=False)
    if config_file is None and scene_name is None:
        if png is not None:
            raise click.BadParameter(
                "without --config or --scene there are no feet to draw", param_hint="--png"
            )
        adapters = probe_adapters()
        if as_json:
            echo_json(adapters_json(adapters))
        else:
            console.print(adapters_picture(adapters))
        return
    config = load_config(config_file) if config_file else DEFAULT
    if scene_name is None and is_simulated(config):
        scene_name = _DEFAULT_SCENE
    # The diagnoses replace the scanner's own warnings about legs.
    logging.getLogger("footsense.acquisition").setLevel(logging.ERROR)
    result = probe_robot(config, load_scene(scene_name) if scene_name else None)
    title = f"scene {scene_name}, simulated" if scene_name else str(config_file)
    if png is not None:
        from footsense.cli.probe.figure import draw_probed_feet

        draw_probed_feet(result, title, png)
    if as_json:
        echo_json(probe_json(result))
    else:
        console.print(probe_picture(result, title))
    if result.diagnoses:
        sys.exit(_EXIT_CODE_FAULTY)
