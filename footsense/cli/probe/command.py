"""`footsense probe`: what is on the buses, and what is wrong with it, before a robot walks."""

import json
import logging
import sys
from pathlib import Path

import click
from rich.console import Console

from footsense import daemon
from footsense.cli.options import FILE, config_option, json_option
from footsense.cli.probe.picture import adapters_picture, probe_picture
from footsense.cli.probe.plain_values import plain, plain_adapters
from footsense.config import DEFAULT, load_config
from footsense.daemon.probe.bus_probe import adapters_seen
from footsense.daemon.probe.bus_probe import probe as probe_robot
from footsense.daemon.probe.report import Adapter
from footsense.sim.scene import load_scene

#: Something was found that is wrong.
_FAULTY = 1
_SCENE = "hanging"


@click.command()
@config_option("none, only scan the addresses on this computer's adapters")
@click.option(
    "--scene",
    "scene_name",
    help="Simulate this scene: a name or a YAML file. Its feet should hang in the air, as in `hanging`.",
)
@json_option
@click.option("--png", type=FILE, help="Draw the feet into this file (needs footsense[lab]).")
def probe(config_file: Path | None, scene_name: str | None, png: Path | None, *, as_json: bool) -> None:
    """Say what is on the buses, what it costs, and what every element of the free feet reads.

    Unknown addresses are only asked whether they are there, as `i2cdetect` does. Exit code 1 if something is wrong.
    """
    # What the scanner says of legs while it looks for them is told below, with what to check.
    logging.getLogger("footsense.drivers").setLevel(logging.ERROR)
    console = Console(highlight=False)
    if config_file is None and scene_name is None:
        _show_adapters(console, adapters_seen(), png, as_json=as_json)
        return
    config = load_config(config_file) if config_file else DEFAULT
    if scene_name is None and daemon.is_simulated(config):
        scene_name = _SCENE
    probed = probe_robot(config, load_scene(scene_name) if scene_name else None)
    title = f"scene {scene_name}, simulated" if scene_name else str(config_file)
    if png is not None:
        from footsense.cli.probe.figure import draw

        draw(probed, title, png)
    if as_json:
        click.echo(json.dumps(plain(probed), indent=2))
    else:
        console.print(probe_picture(probed, title))
    if probed.complaints:
        sys.exit(_FAULTY)


def _show_adapters(console: Console, found: list[Adapter], png: Path | None, *, as_json: bool) -> None:
    """Show who answers where nothing is configured.

    Raises:
        BadParameter: There are no feet to be drawn.
    """
    if png is not None:
        raise click.BadParameter("without --config or --scene there are no feet to draw", param_hint="--png")
    if as_json:
        click.echo(json.dumps(plain_adapters(found), indent=2))
    else:
        console.print(adapters_picture(found))
