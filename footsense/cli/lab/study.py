"""`footsense lab study`, and dedicated commands of single studies: `fidelity`, `cramer-rao`, `gaits`, `tolerance`..."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from footsense.cli.lab import options
from footsense.cli.options import Decorator, json_option
from footsense.cli.tables import echo_json
from footsense.errors import FootsenseError
from footsense.progress import timed_bar

if TYPE_CHECKING:
    from collections.abc import Callable

    from footsense.lab.studies.page import Page, StudyContext

#: Studies of the daemon, which the lab does not import, with their modules.
DAEMON_STUDIES = {
    "tradeoff": "footsense.benchmarks.latency_vs_error.page",
    "touchdown": "footsense.benchmarks.touchdown.page",
    "faults": "footsense.cli.lab.pages.faults",
}

#: The studies that are too long for the report, with their modules.
STUDIES_NOT_RUN_BY_REPORT = {
    "experiment": "footsense.cli.lab.pages.experiment",
    "mismatch": "footsense.cli.lab.pages.mismatch",
}


def run_and_write_study(
    study: "str | Callable[[StudyContext], Page]",
    models: Path | None,
    output: Path | None,
    *,
    quick: bool,
    as_json: bool = False,
    bound: bool = True,
) -> None:
    """Run a study and write its page; print the page, or with `--json` its numbers.

    Args:
        study: Its name, or what makes its page.
        models: Folder of a foot type; None for the released one.
        output: Folder for the page; None for the default one.
        quick: Whether it answers in seconds.
        as_json: Whether to print JSON.
        bound: Whether the page becomes part of the report.
    """
    folder = options.ensure_report_folder(output, quick=quick)
    from footsense.lab.report import STUDY_MODULES, bind_pages, last_duration_s, make_page
    from footsense.lab.studies.page import StudyContext

    report_progress = (lambda _: None) if as_json else options.elapsed_time_reporter()
    context = StudyContext(
        models=models or options.released_folder(), quick=quick, report_progress=report_progress
    )
    usual_s = last_duration_s(study, folder, quick=quick) if isinstance(study, str) else 0.0
    with timed_bar(str(study), usual_s):
        page = (
            make_page(study, context, STUDY_MODULES | DAEMON_STUDIES)
            if isinstance(study, str)
            else study(context)
        )
    page.write(folder)
    if bound:
        bind_pages(folder, context)
    if as_json:
        echo_json(page.values)
        return
    click.echo(page.markdown)
    into = f", and bound it into {folder / 'README.md'}" if bound else ""
    click.echo(f"wrote {folder / page.name}.md{into}")


@click.command()
@click.option("--rows", help="Names of rows, separated by commas; all without it.")
@click.option("--feet", "n_feet", type=click.IntRange(min=1), help="Feet of each row; 20, 2 if quick.")
@options.scheduler_option
@click.option(
    "--kept",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder of solved tables and finished feet, to go on with; build/mismatch.",
)
@options.models_option
@options.output_option
@options.quick_option
@json_option
def mismatch(
    *,
    rows: str | None,
    n_feet: int | None,
    scheduler: str | None,
    kept: Path | None,
    models: Path | None,
    output: Path | None,
    quick: bool,
    as_json: bool,
) -> None:
    """Calibrate and read feet whose physics the calibration does not know, on this machine or a cluster, resumable."""
    from footsense.cli.lab.pages.mismatch import DEFAULT_CACHE_FOLDER, STUDY, run_study
    from footsense.lab.monte_carlo.workers import job_runner

    given = tuple(rows.split(",")) if rows else ()
    own = replace(
        STUDY,
        compute=partial(
            run_study,
            workers=job_runner(scheduler) if scheduler else None,
            rows=given,
            n_feet=n_feet,
            kept=kept or DEFAULT_CACHE_FOLDER,
        ),
    )
    run_and_write_study(own.compute_page, models, output, quick=quick, as_json=as_json, bound=not given)


@click.command()
@click.argument("name")
@options.models_option
@options.output_option
@options.quick_option
def study(*, name: str, models: Path | None, output: Path | None, quick: bool) -> None:
    """Run the study NAME: its page with tables and figures goes into the report. An unknown name lists all."""
    run_and_write_study(name, models, output, quick=quick)


def _study_command(name: str, help_text: str, *own_options: Decorator) -> click.Command:
    """Return the click command of one study, with additional options."""

    def run(*, output: Path | None, quick: bool, models: Path | None = None, as_json: bool = False) -> None:
        """Run the study and write its page."""
        run_and_write_study(name, models, output, quick=quick, as_json=as_json, bound=models is None)

    run.__doc__ = help_text
    command = click.command(name)(run)
    for option in own_options:
        option(command)
    return command


_STUDY_OPTIONS = (options.models_option, options.output_option, options.quick_option, json_option)

fidelity = _study_command(
    "fidelity",
    "Print time and error of the four models of the foot, and draw one against the other.",
    *_STUDY_OPTIONS,
)
cramer_rao = _study_command(
    "cramer-rao",
    "Print the Cramer-Rao bound over the loading range, and the network's error over it.",
    *_STUDY_OPTIONS,
)
gaits = _study_command(
    "gaits",
    "Print the network's errors on gaits that it was not trained on, and at rest.",
    *_STUDY_OPTIONS,
)
tradeoff = _study_command(
    "tradeoff",
    "Print what conversion rate and publishing rate cost in latency and bring in error.",
    *_STUDY_OPTIONS,
)
faults = _study_command(
    "faults",
    "Walk with every fault that a scene can have, and print detection, recovery and effect on the other legs.",
    options.models_option,
    options.output_option,
    click.option("--quick", is_flag=True, help="A few faults, in seconds."),
)


def _refuse_former_option(_: click.Context, __: click.Parameter, given: str | None) -> None:
    """Refuse `--campaign`, the former name of `--file`, with a message.

    Raises:
        FootsenseError: It is used.
    """
    if given is not None:
        raise FootsenseError("`--campaign` is now `--file`")


@click.command()
@options.scheduler_option
@click.option("--campaign", hidden=True, expose_value=False, callback=_refuse_former_option)
@click.option(
    "--file",
    type=click.Path(dir_okay=False, path_type=Path),
    help="File of the finished feet; an interrupted run continues with the others.",
)
@options.models_option
@options.output_option
@options.quick_option
def tolerance(
    *, scheduler: str | None, file: Path | None, models: Path | None, output: Path | None, quick: bool
) -> None:
    """Run the Monte Carlo over fabricated feet, on this machine or a cluster, resumable."""
    from footsense.lab.monte_carlo.workers import job_runner
    from footsense.lab.studies.accuracy.tolerance import STUDY, run_study

    own = replace(STUDY, compute=partial(run_study, workers=job_runner(scheduler), file=file))
    run_and_write_study(own.compute_page, models, output, quick=quick)
