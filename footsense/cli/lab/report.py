"""`footsense lab report`: run all studies and bind them into one document, or list the outdated pages."""

from pathlib import Path

import click

from footsense.cli.lab import options
from footsense.cli.lab.study import DAEMON_STUDIES, STUDIES_NOT_RUN_BY_REPORT
from footsense.cli.options import FOLDER
from footsense.clock import stopwatch_ns
from footsense.daemon.foot_types import DEFAULT_FOOT_TYPE, released_path


@click.command()
@click.option(
    "--models",
    type=FOLDER,
    help=f"Folder that the models are built into; without it ./models/{DEFAULT_FOOT_TYPE}.",
)
@options.output_option
@options.quick_option
@click.option("--resume", is_flag=True, help="Keep models, and pages that are not stale.")
@click.option("--stale", is_flag=True, help="Make nothing: list the pages that are stale, and why.")
def report(*, models: Path | None, output: Path | None, quick: bool, resume: bool, stale: bool) -> None:
    """Build the models from nothing, run every study on them, and bind the pages into one report."""
    if stale:
        _print_stale_pages(
            models or options.released_folder(), output or Path("docs") / "report", quick=quick
        )
        return
    folder = models or Path("models") / (f"{DEFAULT_FOOT_TYPE}-quick" if quick else DEFAULT_FOOT_TYPE)
    options.ensure_writable_folder(folder)
    pages = options.ensure_report_folder(output, quick=quick)
    from footsense.lab.build import FULL_BUILD, QUICK_BUILD, build
    from footsense.lab.evaluation.evaluate_models import NETWORK_FILE, RESPONSE_FILE
    from footsense.lab.foot_file import FOOT_FILE
    from footsense.lab.report import STUDY_MODULES, make_report
    from footsense.lab.studies.page import StudyContext

    report_progress, started_ns, build_s = options.elapsed_time_reporter(), stopwatch_ns(), None
    if not (resume and all((folder / name).exists() for name in (NETWORK_FILE, RESPONSE_FILE))):
        build(released_path(FOOT_FILE), folder, QUICK_BUILD if quick else FULL_BUILD, report_progress)
        build_s = (stopwatch_ns() - started_ns) / 1e9
    context = StudyContext(models=folder, quick=quick, report_progress=report_progress)
    studies = STUDY_MODULES | DAEMON_STUDIES
    report_progress(
        f"wrote {make_report(pages, context, studies, build_s=build_s, resume=resume, report=report_progress)}"
    )


def _print_stale_pages(models: Path, pages: Path, *, quick: bool) -> None:
    """Print each outdated page with the reason."""
    from footsense.lab.report import STUDY_MODULES, stale_reason
    from footsense.lab.studies.page import StudyContext

    context, studies = (
        StudyContext(models=models, quick=quick),
        STUDY_MODULES | DAEMON_STUDIES | STUDIES_NOT_RUN_BY_REPORT,
    )
    for name in studies:
        if reason := stale_reason(name, pages, context, studies):
            click.echo(f"{name}: {reason}")
