"""`footsense lab response`, `study`, `fidelity`, `cramer-rao`, `tradeoff`, `tolerance`, `report`."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from footsense.cli.lab.options import (
    models_option,
    output_option,
    released_folder,
    report_folder,
    require_writable,
    stopwatch_report,
)
from footsense.cli.options import FOLDER, echo_json, json_option
from footsense.clock import stopwatch_ns
from footsense.daemon.foot_types import DEFAULT_FOOT_TYPE, released_path
from footsense.errors import FootsenseError

if TYPE_CHECKING:
    from collections.abc import Callable

    from footsense.lab.studies.page import Page, StudyContext

#: Studies of the daemon, which the lab does not import, with their modules.
DAEMON_STUDIES = {
    "tradeoff": "footsense.benchmarks.latency_vs_error.page",
    "touchdown": "footsense.benchmarks.touchdown.page",
}

#: Pages that have commands of their own, with their modules.
OTHER_PAGES = {
    "experiment": "footsense.cli.lab.experiment_page",
    "faults": "footsense.cli.lab.faults_page",
}

_quick_option = click.option(
    "--quick", is_flag=True, help="Every step in seconds; its figures are no results."
)


def _direction(_: click.Context, __: click.Parameter, text: str) -> tuple[float, float]:
    """Return the two angles of a direction [deg].

    Raises:
        click.BadParameter: They are not two numbers.
    """
    try:
        azimuth, elevation = map(float, text.split(","))
    except ValueError as error:
        raise click.BadParameter(f"two angles in degrees, such as 0,45; got {text!r}") from error
    return azimuth, elevation


@click.command()
@click.option(
    "--direction",
    "direction_deg",
    required=True,
    callback=_direction,
    metavar="T1,T2",
    help="Azimuth and elevation of the force [deg].",
)
@click.option("--force-n", type=float, required=True, help="Its magnitude [N].")
@click.option("--level", default="contact", show_default=True, help="half-space, linear, contact or full.")
@models_option
@json_option
def response(
    *,
    direction_deg: tuple[float, float],
    force_n: float,
    level: str,
    models: Path | None,
    as_json: bool,
) -> None:
    """Print closures and capacitances of the nine elements under one centred load."""  # noqa: DOC501 - click shows this text
    from footsense.lab.evaluation.evaluate_models import open_models
    from footsense.lab.fidelity.levels import response_to
    from footsense.lab.foot_file import FOOT_FILE, load_foot

    folder = models or released_folder()
    table, _ = open_models(folder)
    try:
        found = response_to(table, load_foot(folder / FOOT_FILE), direction_deg, force_n, level)
    except ValueError as error:
        raise FootsenseError(str(error)) from error
    if as_json:
        echo_json(found)
        return
    click.echo(
        f"{level}: {force_n:g} N at {direction_deg[0]:g}, {direction_deg[1]:g} deg; row 0 forward, column 0 left"
    )
    for what, unit in (("closure_um", "um"), ("capacitance_pf", "pF")):
        click.echo(f"{what.partition('_')[0]} [{unit}]")
        for row in found[what]:
            click.echo("  " + "  ".join(f"{value:8.3f}" for value in row))


def write_study(
    study: "str | Callable[[StudyContext], Page]",
    models: Path | None,
    output: Path | None,
    *,
    quick: bool,
    as_json: bool = False,
    bound: bool = True,
) -> None:
    """Run a study, write its Markdown page, and print the page, or only the numbers of the page as JSON.

    Args:
        study: Its name, or what makes its page.
        models: Folder of a foot type; None for the released one.
        output: Folder for the page; None for the default one.
        quick: Whether it answers in seconds.
        as_json: Whether to print JSON.
        bound: Whether the page becomes part of the report.
    """
    folder = report_folder(output, quick=quick)
    from footsense.lab.report import STUDIES, bind, make_page
    from footsense.lab.studies.page import StudyContext

    say = (lambda _: None) if as_json else stopwatch_report()
    context = StudyContext(models=models or released_folder(), quick=quick, say=say)
    page = make_page(study, context, STUDIES | DAEMON_STUDIES) if isinstance(study, str) else study(context)
    page.write(folder)
    if bound:
        bind(folder, context)
    if as_json:
        echo_json(page.values)
        return
    click.echo(page.markdown)
    into = f", and bound it into {folder / 'README.md'}" if bound else ""
    click.echo(f"wrote {folder / page.name}.md{into}")


@click.command()
@click.argument("name")
@models_option
@output_option
@_quick_option
def study(*, name: str, models: Path | None, output: Path | None, quick: bool) -> None:
    """Run the study NAME: its page with tables and figures goes into the report. An unknown name lists all."""
    write_study(name, models, output, quick=quick)


def _named(name: str, words: str) -> click.Command:
    """Return the dedicated command of a study."""

    def run(*, models: Path | None, output: Path | None, quick: bool, as_json: bool) -> None:
        write_study(name, models, output, quick=quick, as_json=as_json)

    run.__doc__ = words
    return click.command(name)(models_option(output_option(_quick_option(json_option(run)))))


fidelity = _named(
    "fidelity", "Print time and error of the four models of the foot, and draw one against the other."
)
cramer_rao = _named(
    "cramer-rao", "Print the Cramer-Rao bound over the loading range, and the network's error over it."
)
tradeoff = _named(
    "tradeoff",
    "Print what rate, averaging, publish mode and network size cost in latency and bring in error.",
)


def _renamed_file(_: click.Context, __: click.Parameter, given: str | None) -> None:
    """Answer the former name of `--file`.

    Raises:
        FootsenseError: It is used.
    """
    if given is not None:
        raise FootsenseError("`--campaign` is now `--file`")


@click.command()
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Of a dask cluster, such as tcp://host:8786; without it two processes on this machine.",
)
@click.option("--campaign", hidden=True, expose_value=False, callback=_renamed_file)
@click.option(
    "--file",
    type=click.Path(dir_okay=False, path_type=Path),
    help="File of the finished feet; an interrupted run continues with the others.",
)
@models_option
@output_option
@_quick_option
def tolerance(
    *, scheduler: str | None, file: Path | None, models: Path | None, output: Path | None, quick: bool
) -> None:
    """Run the Monte Carlo over fabricated feet, on this machine or a cluster, resumable."""
    from footsense.lab.monte_carlo.workers import parallel
    from footsense.lab.studies.accuracy.tolerance import STUDY, run_study

    own = replace(STUDY, compute=partial(run_study, workers=parallel(scheduler), file=file))
    write_study(own.page, models, output, quick=quick)


@click.command()
@click.option(
    "--models",
    type=FOLDER,
    help=f"Folder that the models are built into; without it ./models/{DEFAULT_FOOT_TYPE}.",
)
@output_option
@_quick_option
@click.option("--resume", is_flag=True, help="Keep models, and pages that are not stale.")
@click.option("--stale", is_flag=True, help="Make nothing: list the pages that are stale, and why.")
def report(*, models: Path | None, output: Path | None, quick: bool, resume: bool, stale: bool) -> None:
    """Build the models from nothing, run every study on them, and bind the pages into one report."""
    if stale:
        _print_stale(models or released_folder(), output or Path("docs") / "report", quick=quick)
        return
    folder = models or Path("models") / (f"{DEFAULT_FOOT_TYPE}-quick" if quick else DEFAULT_FOOT_TYPE)
    require_writable(folder)
    pages = report_folder(output, quick=quick)
    from footsense.cli.lab.faults_page import STUDY as FAULTS
    from footsense.lab.build import FULL, QUICK, build
    from footsense.lab.evaluation.evaluate_models import NETWORK_FILE, RESPONSE_FILE
    from footsense.lab.foot_file import FOOT_FILE
    from footsense.lab.report import STUDIES, is_made, make_report
    from footsense.lab.studies.page import StudyContext

    say, started_ns, build_s = stopwatch_report(), stopwatch_ns(), None
    if not (resume and all((folder / name).exists() for name in (NETWORK_FILE, RESPONSE_FILE))):
        build(released_path(FOOT_FILE), folder, QUICK if quick else FULL, say)
        build_s = (stopwatch_ns() - started_ns) / 1e9
    context = StudyContext(models=folder, quick=quick, say=say)
    if not (resume and is_made("faults", pages, context)):
        page = FAULTS.page(context)
        page.write(pages)
        say(f"faults: {page.seconds:.0f} s")
    studies = STUDIES | DAEMON_STUDIES
    say(f"wrote {make_report(pages, context, studies, build_s=build_s, resume=resume, report=say)}")


def _print_stale(models: Path, pages: Path, *, quick: bool) -> None:
    """Print each page that has to be made again, with the reason."""
    from footsense.lab.report import STUDIES, why_stale
    from footsense.lab.studies.page import StudyContext

    context, studies = StudyContext(models=models, quick=quick), STUDIES | DAEMON_STUDIES | OTHER_PAGES
    for name in studies:
        if reason := why_stale(name, pages, context, studies):
            click.echo(f"{name}: {reason}")
