"""Command group `footsense calibration`: take what `footsense selfcal` proposes, or go back."""

import click

from footsense.cli import LazyGroup


@click.group(
    cls=LazyGroup,
    modules={
        "accept": ("calibration.proposals", "Take proposed calibrations into use."),
        "revert": ("calibration.proposals", "Take the former calibration of a foot back into use."),
    },
)
def calibration() -> None:
    """Take calibrations that `footsense selfcal` proposes into use, or the former ones back."""
