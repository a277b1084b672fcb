"""`footsense lab faults`: detection and recovery of every fault on CAN, and its effect on the other legs."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from footsense.cli.lab.options import output_option, released_folder, report_folder, stopwatch_report

if TYPE_CHECKING:
    from footsense.lab.studies.page import Page, StudyContext


@click.command()
@output_option
@click.option("--quick", is_flag=True, help="A few faults, in seconds.")
def faults(*, output: Path | None, quick: bool) -> None:
    """Walk with every fault that a scene can have, and print detection, recovery and effect on the other legs."""
    folder = report_folder(output, quick=quick)
    from footsense.lab.report import bind
    from footsense.lab.studies.page import StudyContext

    context = StudyContext(models=released_folder(), quick=quick, say=stopwatch_report())
    page = write_page_of_faults(folder, context)
    bind(folder, context)
    click.echo(page.markdown)
    click.echo(f"wrote {folder / page.name}.md, and bound it into {folder / 'README.md'}")


def write_page_of_faults(folder: Path, context: "StudyContext") -> "Page":
    """Walk with every fault, write the page into a folder, and return it."""
    from footsense.cli.lab.faults_page import STUDY

    page = STUDY.page(context)
    page.write(folder)
    return page
