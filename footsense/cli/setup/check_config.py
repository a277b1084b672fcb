"""Command `footsense check-config FILE`: check and explain a configuration file."""

import logging
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

import click
import msgspec

from firmware_interface.can.dbc import make_dbc
from firmware_interface.can.force import force_step_mn
from firmware_interface.can.reports import foot_type_hash
from firmware_interface.wire_timing import can_bits_per_s
from footsense.cli.file_kinds import ROBOT, kind_of_text
from footsense.cli.options import FILE, json_option
from footsense.cli.tables import echo_figures, echo_json
from footsense.clock import wall_time_iso
from footsense.config import Config, load_config
from footsense.config.contradictions import warnings
from footsense.daemon.can_output import frames_destination
from footsense.daemon.estimation import contact_threshold_n, pipeline_for, unloaded_limit_n
from footsense.daemon.models import Models, load_models
from footsense.daemon.setup.expected_error import (
    error_text,
)
from footsense.daemon.simulation import is_simulated
from footsense.errors import ConfigError
from footsense.foot.calibration_files import FootCalibration
from footsense.ring.ring_file import is_written_ring

#: Largest normal load of the released feet, as designed, with a force and no overload, if the force leans from an
#: upright contact normal by 14 and by 30 deg, to the worst side [N]. Source: model cards, and docs/report/design.md.
RANGES_N = {"aoyagi-3x3": (0.648, 0.363), "hexapod-2kg": (27.9, 15.4), "quadruped-12kg": (251.0, 146.0)}


@click.command("check-config")
@click.argument("file", type=FILE)
@click.option(
    "--dbc", type=click.Path(dir_okay=False, path_type=Path), help="Write the DBC of this robot's CAN frames."
)
@json_option
def check_config(file: Path, dbc: Path | None, *, as_json: bool) -> None:
    """Say what the configuration FILE makes of a robot, or name its first error and the remedy.

    With -v every setting follows, defaults too.
    """  # noqa: DOC501 - click shows this text
    try:
        config = load_config(file)
    except ConfigError:
        if (kind := kind_of_text(file)) is not None and kind[0] != ROBOT:
            raise ConfigError(f"{file}: is {kind[0]}, not a robot's: {kind[1]}") from None
        raise
    models = load_models(config)
    pipeline_for(models, 0)  # raises as a run would
    if config.ring_path is not None:
        is_written_ring(config.ring_path, or_of_its_folder=True)  # likewise, but for one that runs
    card = models.network.card
    step_mn = force_step_mn(card.max_trained_force_n)
    settings = _settings(models) | {
        "can_load_rel": round(_can_load_rel(config), 3),
        "force_step_mn": step_mn,
        "foot_type_hash": f"{foot_type_hash(card.foot_type):08x}",
        "uncalibrated": [leg for leg in config.legs if leg not in models.calibrations_by_leg],
    }
    if as_json:
        echo_json(settings)
    else:
        click.echo(f"{file} is right.\n")
        echo_figures(_explanation(models), as_json=False)
        click.echo("".join(f"\n{line}" for line in _uncalibrated(models)) or "\nevery foot is calibrated")
        if logging.getLogger().isEnabledFor(logging.INFO):
            click.echo("\nEvery setting:")
            echo_figures(settings, as_json=False)
    if dbc is not None:
        dbc.write_text(make_dbc(config.legs, step_mn), "utf-8")
        click.echo(f"wrote {dbc}", err=True)
    for warning in warnings(config):
        click.echo(f"warning: {warning}", err=True)


def _can_load_rel(config: Config) -> float:
    """Return the share of the bit rate that all frames of the robot take [1]."""
    return can_bits_per_s(len(config.legs), config.forces_hz) / config.can.bitrate


def _explanation(models: Models) -> dict[str, str]:
    """Return what somebody needs to know first, by what it is about."""
    config, card = models.config, models.network.card
    told = {"legs": " ".join(config.legs)}
    if config.serial is not None:
        told["serial"] = (
            f"{config.serial.device}, a microcontroller that sends {config.serial.rate_hz:g} scans/s"
        )
    for bus in config.buses:
        if bus.leg is not None:
            place = f"{bus.leg} alone"
        elif bus.addresses:
            place = (
                f"addresses {', '.join(f'{leg} {address:#04x}' for leg, address in bus.addresses.items())}"
            )
        else:
            channels = ", ".join(f"{leg} {channel}" for leg, channel in bus.legs.items())
            place = f"multiplexer {bus.mux.address:#04x}, channels {channels}"
        told[bus.device] = f"board {config.board}, {place}"
    told["feet"] = f"of type {card.foot_type}"
    if (range_n := RANGES_N.get(card.foot_type)) is not None:
        told["range"] = "normal loads up to {:g} N if the force leans 14 deg, {:g} N if 30".format(*range_n)
        told["overload"] = (
            "with one to three overloaded elements the force is less exact, with more there is none"
        )
    told["tare"] = (
        f"of feet that carry less than {unloaded_limit_n(models):.2g} N: more is refused, less may be drift"
    )
    told["no force"] = f"above {card.max_trained_force_n:g} N, the largest of the training"
    for leg, uncertainty in zip(config.legs, models.uncertainties, strict=True):
        if (calibration := models.calibrations_by_leg.get(leg)) is None:
            continue
        told[f"foot on {leg}"] = (
            f"{_calibrated_text(calibration)}: today expect errors of {error_text(uncertainty)}"
        )
    told["forces"] = (
        f"up to {config.forces_hz:.0f} forces/s on CAN of each leg; contact from {contact_threshold_n(models):.2g} N, "
        f"stale when older than {config.effective_max_age_ms:g} ms"
    )
    told["CAN"] = _can_text(config)
    if (step_mn := force_step_mn(card.max_trained_force_n)) != 1:
        told["CAN"] += f"; force step {step_mn} mN"
    told["page"] = f"http://{config.view.address}:{config.view.port}, served by `footsense view`"
    told["metrics"] = (
        f"http://{config.metrics.address}:{config.metrics.port}/metrics, served by `footsense exporter`"
    )
    return told


def _calibrated_text(calibration: FootCalibration) -> str:
    """Return which foot it is, since when, and how well it was known then."""
    known, manifest = _calibration(calibration), calibration.manifest
    text = f"{known['foot']}, calibrated on {manifest.made[:10]}"
    if manifest.held_out is not None:
        text += f" with {manifest.held_out.calibrated.direction_deg:.1f} deg of error"
    elif manifest.by_standing or manifest.by_walking:
        by = "walking" if manifest.by_walking else "standing"
        text += f" by {by}, which tells neither its mounting nor its stiffness"
    return text


def _can_text(config: Config) -> str:
    """Return where the frames go, and how much of the bus they take."""
    can = config.can
    load = f"{can.channel}, of whose {can.bitrate * 1e-3:g} kbit/s up to {100 * _can_load_rel(config):.0f} % are taken"
    if is_simulated(config):
        return frames_destination(config, None) + (f"; {load}" if can.interface == "socketcan" else "")
    stays = {"virtual": "within the process alone", "udp_multicast": f"{can.channel}, on this computer alone"}
    return stays.get(can.interface, load)


def _uncalibrated(models: Models) -> Iterator[str]:
    """Yield for legs without a calibration why, and how wrong their forces are to be expected: alike for all."""
    feet: dict[str, str] = dict(models.config.feet.items())
    errors = dict(zip(models.config.legs, models.uncertainties, strict=True))
    legs = [leg for leg in models.config.legs if leg not in models.calibrations_by_leg]
    unnamed = [leg for leg in legs if leg not in feet]
    reasons = [(unnamed[0], f"no foot named on {', '.join(unnamed)}")] if unnamed else []
    if named := [leg for leg in legs if leg in feet]:
        reasons.append((named[0], f"no calibration of {', '.join(f'{feet[leg]} on {leg}' for leg in named)}"))
    for leg, reason in reasons:
        expected = f"expect errors of {error_text(errors[leg])}, twice that of a single foot now and then"
        if is_simulated(models.config):
            expected = f"as simulated feet are by design; of made ones {expected}"
        yield f"{reason}: uncalibrated, {expected}"


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
