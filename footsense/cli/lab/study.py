"""`footsense lab study` and `footsense lab report`: one page of the report, or all."""

from pathlib import Path

import click

from footsense.cli.lab import options
from footsense.cli.options import json_option
from footsense.cli.tables import echo_json


@click.command()
@click.argument("name")
@options.models_option
@options.output_option
@options.quick_option
@options.scheduler_option
@json_option
def study(
    *, name: str, models: Path | None, output: Path | None, quick: bool, scheduler: str | None, as_json: bool
) -> None:
    """Make the page NAME of the report. Another name lists them all."""
    from footsense.lab.report import StudyContext, make_page, require_study, write_list_of_pages

    require_study(name)
    folder = options.ensure_report_folder(output, quick=quick)
    progress = (lambda _: None) if as_json else options.elapsed_time_reporter()
    context = StudyContext(
        models=models or options.released_folder(),
        quick=quick,
        scheduler=scheduler,
        report_progress=progress,
    )
    markdown, values = make_page(name, context, folder)
    if models is None:
        write_list_of_pages(folder)
    if as_json:
        echo_json(values)
        return
    click.echo(markdown)
    click.echo(f"wrote {folder / name}.md")


@click.command()
@options.output_option
@options.quick_option
@options.scheduler_option
def report(*, output: Path | None, quick: bool, scheduler: str | None) -> None:
    """Make all pages of the report anew, about the released foot."""
    from footsense.lab.report import StudyContext, make_report

    folder = options.ensure_report_folder(output, quick=quick)
    progress = options.elapsed_time_reporter()
    context = StudyContext(
        models=options.released_folder(), quick=quick, scheduler=scheduler, report_progress=progress
    )
    progress(f"wrote {make_report(folder, context, progress)}")
