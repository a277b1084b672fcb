"""`footsense lab faults`: for every fault, detection and recovery on CAN, and the effect on other legs."""

from pathlib import Path

import click

from footsense.cli.lab.options import output_option
from footsense.cli.lab.study import write_study


@click.command()
@output_option
@click.option("--quick", is_flag=True, help="A few faults, in seconds.")
def faults(*, output: Path | None, quick: bool) -> None:
    """Walk with every fault that a scene can have, and print detection, recovery and effect on the other legs."""
    from footsense.cli.lab.faults_page import STUDY

    write_study(STUDY.page, None, output, quick=quick)
