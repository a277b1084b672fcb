"""Commands `footsense calibration accept` and `revert`: proposed calibrations into use, and the former ones back."""

from pathlib import Path

import click

from footsense.calibration.selfcal import proposal
from footsense.calibration.writer import revert_calibration
from footsense.cli.options import FOLDER
from footsense.errors import CalibrationError
from footsense.telemetry.electrodes import STATE_FOLDER

_calibrations_option = click.option(
    "--calibrations",
    "folder",
    type=FOLDER,
    default=Path("feet"),
    show_default=True,
    help="Folder of all calibrations, as in the robot's file.",
)


@click.command()
@click.argument("feet", nargs=-1, metavar="[FOOT]...")
@_calibrations_option
@click.option(
    "--state",
    "state_folder",
    type=FOLDER,
    default=STATE_FOLDER,
    show_default=True,
    help="Folder of the states of `footsense selfcal`.",
)
def accept(feet: tuple[str, ...], folder: Path, state_folder: Path) -> None:
    """Take what `footsense selfcal` proposes for each FOOT into use; without FOOT, for all.

    The former calibration is kept beside the new one. The service reads calibrations when it starts.
    """  # noqa: DOC501
    if not (chosen := feet or tuple(proposal.proposed_feet(state_folder))):
        raise CalibrationError(f"nothing is proposed in {state_folder}")
    for foot in chosen:
        taken = proposal.accept(state_folder, foot, folder)
        click.echo(f"{foot}: {taken.folder} is now the calibration of {taken.manifest.made[:10]}, by walking")
    click.echo("start the service again to use them", err=True)


@click.command()
@click.argument("feet", nargs=-1, required=True, metavar="FOOT...")
@_calibrations_option
def revert(feet: tuple[str, ...], folder: Path) -> None:
    """Take the former calibration of each FOOT back into use; the present one is kept in its place."""
    for foot in feet:
        taken = revert_calibration(folder, foot)
        click.echo(f"{foot}: {taken.folder} is the calibration of {taken.manifest.made[:10]} again")
    click.echo("start the service again to use them", err=True)
