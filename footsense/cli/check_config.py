"""Command `footsense check-config FILE`: check and explain a configuration file."""

from datetime import datetime
from pathlib import Path

import click

from firmware_interface.can.dbc import make_dbc
from firmware_interface.can.force import force_step_mn
from footsense.cli.options import FILE
from footsense.clock import wall_time_iso
from footsense.config import Config, load_config
from footsense.config.contradictions import warnings
from footsense.config.sections import Bus
from footsense.daemon.estimation import contact_threshold_n, pipeline_for
from footsense.daemon.models import Models, load_models
from footsense.foot.files.calibration_reader import FootCalibration


@click.command("check-config")
@click.argument("file", type=FILE)
@click.option(
    "--dbc", type=click.Path(dir_okay=False, path_type=Path), help="Write the DBC of this robot's CAN frames."
)
def check_config(file: Path, dbc: Path | None) -> None:
    """Explain the configuration FILE, or name its first error and the remedy."""
    config = load_config(file)
    models = load_models(config)
    pipeline_for(models, 0)  # raises as a run would
    for line in _summary_lines(models):
        click.echo(line)
    if dbc is not None:
        step_mn = force_step_mn(models.network.card.max_trained_force_n)
        dbc.write_text(make_dbc(config.legs, step_mn), "utf-8")
        click.echo(f"wrote {dbc}")
    for warning in warnings(config):
        click.echo(f"warning: {warning}", err=True)


def _summary_lines(models: Models) -> list[str]:
    """Return the explanation of a configuration, as lines of text."""
    config, network, calibrations = models.config, models.network, models.calibrations_by_leg
    realtime, metrics = config.realtime, config.metrics
    model = "that of the calibrations" if calibrations else config.model
    cpu = "" if realtime is None or realtime.cpu is None else f" on processor {realtime.cpu}"
    design = network.card.trained_inputs.design
    return [
        f"{len(config.legs)} legs on the board {config.board}",
        f"feet: {config.foot_type}, {design.unloaded_pf:.2f} pF per unloaded element, gaps of {design.gap_um:g} um",
        f"scan: {_scan_text(config)}",
        f"forces: {_force_rate_text(config)}",
        *(_bus_line(bus, config) for bus in config.buses),
        *(_calibration_line(leg, calibration) for leg, calibration in calibrations.items()),
        f"tare: over {config.tare.window_scans} scans",
        f"  quiet below {config.tare.noise_limit_ff:g} fF of noise",
        f"  unloaded within {config.tare.unloaded_limit_rel:.1%} of the free foot's readings",
        f"baseline: {'follows the foot in swing' if config.baseline.track else 'constant between tares'}",
        f"contact from {contact_threshold_n(models):g} N",
        f"stale after {config.stale_after_ms:g} ms",
        f"network: {model or 'that of the foot type'}, {network.sha256[:12]}",
        f"CAN: {_can_text(models)}",
        f"metrics: {f'http://{metrics.address}:{metrics.port}/metrics' if metrics else 'none'}",
        f"real time: {f'SCHED_FIFO {realtime.priority}{cpu}' if realtime else 'not requested'}",
    ]


def _can_text(models: Models) -> str:
    """Return the CAN interface as text, with the force unit if it is not the usual millinewton."""
    config, step_mn = models.config, force_step_mn(models.network.card.max_trained_force_n)
    coarse = "" if step_mn == 1 else f", {step_mn} mN per bit of a force and {2 * step_mn} mN of its sigma"
    return f"{config.can.interface} {config.can.channel}, {config.can.bitrate // 1000} kbit/s{coarse}"


def _scan_text(config: Config) -> str:
    """Return scan rate and order as text."""
    serial = config.serial
    if serial is None:
        return f"{config.rate_sps} conversions/s in {config.conversion_order} order"
    return f"{serial.rate_hz:g}/s by the microcontroller at {serial.device}, {serial.baud} bit/s"


def _calibration_line(leg: str, calibration: FootCalibration) -> str:
    """Return a leg's calibration as a line of text."""
    manifest = calibration.manifest
    age = datetime.fromisoformat(wall_time_iso()) - datetime.fromisoformat(manifest.made)
    line = f"{leg}: {manifest.foot}, calibrated {manifest.made[:10]}, {age.days} days ago, {manifest.n_loads} loads"
    if manifest.held_out is None:
        return f"{line}, errors not known"
    errors, before = manifest.held_out.calibrated, manifest.held_out.design_only
    return (
        f"{line}, {errors.direction_deg:.1f} deg and {errors.magnitude_gf:.1f} gf on those held out "
        f"({before.direction_deg:.1f} deg and {before.magnitude_gf:.1f} gf without the calibration)"
    )


def _force_rate_text(config: Config) -> str:
    """Return the rate of the published forces as text."""
    n = config.cap_frames_per_force
    each = "record of the microcontroller" if config.serial is not None else "conversion"
    return f"one of {n} {each}s on CAN, a change at once" if n > 1 else f"one on CAN for every {each}"


def _bus_line(bus: Bus, config: Config) -> str:
    """Return an I2C bus and its legs as a line of text."""
    where = "behind" if bus.adapters else "on channel"
    legs = ", ".join(
        f"{leg} {where} {place}" + (f" ({config.feet[leg]})" if leg in config.feet else "")
        for leg, place in sorted(bus.legs.items(), key=lambda item: item[1])
    )
    mux = "a mux that the kernel drives" if bus.adapters else f"TCA9548A at {bus.mux.address:#04x}"
    return f"{bus.device} at {bus.rate_hz // 1000} kHz, {mux}: {legs}"
