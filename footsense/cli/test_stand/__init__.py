"""Command group `footsense test-stand`: record a foot beside a force sensor, calibrate and evaluate it."""

import click

from footsense.cli import LazyGroup


@click.group(
    cls=LazyGroup,
    modules={
        "record": ("test_stand.record", "Record presses of a foot beside a force sensor."),
        "calibrate": ("test_stand.calibration", "Calibrate a foot from its recordings."),
        "evaluate": ("test_stand.calibration", "Compare a foot's forces with the sensor's."),
    },
)
def test_stand() -> None:
    """Record a foot beside a force sensor, calibrate it, and measure its errors."""
