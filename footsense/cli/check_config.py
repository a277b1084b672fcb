"""Command `footsense check-config FILE`: check and explain a configuration file."""

from datetime import datetime
from pathlib import Path
from typing import Any

import click
import msgspec

from firmware_interface.can.dbc import make_dbc
from firmware_interface.can.force import force_step_mn
from firmware_interface.can.reports import foot_type_hash
from footsense.cli.options import FILE, json_option
from footsense.cli.tables import echo_figures
from footsense.clock import wall_time_iso
from footsense.config import load_config
from footsense.config.contradictions import warnings
from footsense.daemon.can_output import frames_destination
from footsense.daemon.estimation import contact_threshold_n, pipeline_for
from footsense.daemon.models import Models, load_models
from footsense.daemon.simulation import is_simulated
from footsense.foot.calibration_files import FootCalibration


@click.command("check-config")
@click.argument("file", type=FILE)
@click.option(
    "--dbc", type=click.Path(dir_okay=False, path_type=Path), help="Write the DBC of this robot's CAN frames."
)
@json_option
def check_config(file: Path, dbc: Path | None, *, as_json: bool) -> None:
    """Print every setting of the configuration FILE, defaults too, or name its first error and the remedy."""
    config = load_config(file)
    models = load_models(config)
    pipeline_for(models, 0)  # raises as a run would
    card = models.network.card
    step_mn = force_step_mn(card.max_trained_force_n)
    told: dict[str, Any] = {
        "force_step_mn": step_mn,
        "foot_type_hash": f"{foot_type_hash(card.foot_type):08x}",
    }
    if is_simulated(config):
        told["can_frames"] = frames_destination(config, None)
    echo_figures(_settings(models) | told, as_json=as_json)
    if dbc is not None:
        dbc.write_text(make_dbc(config.legs, step_mn), "utf-8")
        click.echo(f"wrote {dbc}", err=True)
    for warning in warnings(config):
        click.echo(f"warning: {warning}", err=True)


def _settings(models: Models) -> dict[str, Any]:
    """Return the settings by their keys in the file, those that depend on others filled in, and what the feet are."""
    config, card = models.config, models.network.card
    settings: dict[str, Any] = msgspec.to_builtins(config)
    for bus in settings["buses"]:
        bus["mux"]["address"] = f"{bus['mux']['address']:#04x}"
    settings["buses"] = {bus["device"]: bus for bus in settings["buses"]}
    design = card.trained_inputs.design
    return settings | {
        **config.effective,
        "contact": {"threshold_n": contact_threshold_n(models)},
        "calibrations": {leg: _calibration(foot) for leg, foot in models.calibrations_by_leg.items()},
        "network_sha256": models.network.sha256,
        "designed": {"unloaded_pf": design.unloaded_pf, "gap_um": design.gap_um},
    }


def _calibration(calibration: FootCalibration) -> dict[str, Any]:
    """Return what is known of a leg's calibration: foot, age, and its errors on the loads held out, where known."""
    manifest = calibration.manifest
    age = datetime.fromisoformat(wall_time_iso()) - datetime.fromisoformat(manifest.made)
    return {
        "foot": manifest.foot,
        "made": manifest.made,
        "days_ago": age.days,
        "n_loads": manifest.n_loads,
        "held_out": msgspec.to_builtins(manifest.held_out),
    }
