"""`footsense lab response`, `study`, `ladder`, `limit`, `tradeoff`, `tolerance`, `report`: questions to the models."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from footsense import daemon
from footsense.cli.lab.options import models_option, released_folder, require_writable, stopwatch_report
from footsense.clock import stopwatch_ns
from footsense.errors import FootsenseError

if TYPE_CHECKING:
    from collections.abc import Callable

    from footsense.lab.studies.page import Page, Workbench

#: Studies of the daemon, which the lab does not import, with their modules.
DAEMON_STUDIES = {
    "tradeoff": "footsense.benchmarks.latency_vs_error.page",
    "touchdown": "footsense.benchmarks.touchdown.page",
}

_quick_option = click.option("--quick", is_flag=True, help="Every step in seconds; its numbers say nothing.")
_output_option = click.option(
    "--output",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for pages and figures; without it ./docs/report, quick ones ./docs/report-quick.",
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
@click.option(
    "--rung", "rung_name", default="contact", show_default=True, help="half-space, linear, contact or full."
)
@models_option
@click.option("--json", "as_json_text", is_flag=True, help="Print JSON.")
def response(
    *,
    direction_deg: tuple[float, float],
    force_n: float,
    rung_name: str,
    models: Path | None,
    as_json_text: bool,
) -> None:
    """Print what one centred load does to the nine elements."""  # noqa: DOC501 - click shows this text
    from footsense.lab.evaluation.evaluate_models import open_models
    from footsense.lab.fidelity.query import response_to
    from footsense.lab.foot_file import FOOT_FILE, load_foot

    folder = models or released_folder()
    table, _ = open_models(folder)
    try:
        found = response_to(table, load_foot(folder / FOOT_FILE), direction_deg, force_n, rung_name)
    except ValueError as error:
        raise FootsenseError(str(error)) from error
    if as_json_text:
        click.echo(json.dumps(found, indent=2))
        return
    click.echo(
        f"{rung_name}: {force_n:g} N at {direction_deg[0]:g}, {direction_deg[1]:g} deg; row 0 forward, column 0 left"
    )
    for what, unit in (("closure_um", "um"), ("capacitance_pf", "pF")):
        click.echo(f"{what.partition('_')[0]} [{unit}]")
        for row in found[what]:
            click.echo("  " + "  ".join(f"{value:8.3f}" for value in row))


def _study(
    study: "str | Callable[[Workbench], Page]",
    models: Path | None,
    output: Path | None,
    *,
    quick: bool,
    as_json_text: bool = False,
) -> None:
    """Run a study by name or function, write its page, bind it, and print it, or its numbers alone as JSON."""
    folder = _report_folder(output, quick=quick)
    from footsense.lab.report import STUDIES, bind, make_page, timed_page
    from footsense.lab.studies.page import Workbench

    say = (lambda _: None) if as_json_text else stopwatch_report()
    bench = Workbench(models=models or released_folder(), quick=quick, say=say)
    page = (
        make_page(study, bench, STUDIES | DAEMON_STUDIES)
        if isinstance(study, str)
        else timed_page(study, bench)
    )
    page.write(folder)
    bind(folder, bench)
    if as_json_text:
        click.echo(json.dumps(page.values, indent=2))
        return
    click.echo(page.markdown)
    click.echo(f"wrote {folder / page.name}.md, and bound it into {folder / 'README.md'}")


def _report_folder(output: Path | None, *, quick: bool) -> Path:
    """Return where pages go; quick ones do not overwrite others."""
    folder = output or Path("docs") / ("report-quick" if quick else "report")
    require_writable(folder)
    return folder


@click.command()
@click.argument("name")
@models_option
@_output_option
@_quick_option
def study(*, name: str, models: Path | None, output: Path | None, quick: bool) -> None:
    """Run the study NAME: its page with tables and figures goes into the report. A name that is none lists all."""
    _study(name, models, output, quick=quick)


@click.command()
@models_option
@_output_option
@_quick_option
def ladder(*, models: Path | None, output: Path | None, quick: bool) -> None:
    """Print time and error of the four models of the foot, and draw one against the other."""
    _study("ladder", models, output, quick=quick)


@click.command()
@models_option
@_output_option
@_quick_option
def limit(*, models: Path | None, output: Path | None, quick: bool) -> None:
    """Print the Cramer-Rao bound over the loading range, and the network's error over it."""
    _study("limit", models, output, quick=quick)


@click.command()
@models_option
@_output_option
@_quick_option
@click.option("--json", "as_json_text", is_flag=True, help="Print the numbers as JSON instead of the page.")
def tradeoff(*, models: Path | None, output: Path | None, quick: bool, as_json_text: bool) -> None:
    """Print what rate, averaging, publish mode and network size cost in latency and bring in error."""
    _study("tradeoff", models, output, quick=quick, as_json_text=as_json_text)


@click.command()
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Of a dask cluster, such as tcp://host:8786; else two workers here.",
)
@click.option(
    "--campaign",
    "file",
    type=click.Path(dir_okay=False, path_type=Path),
    help="File that finished feet are kept in; a campaign that was interrupted goes on with the others.",
)
@models_option
@_output_option
@_quick_option
def tolerance(
    *, scheduler: str | None, file: Path | None, models: Path | None, output: Path | None, quick: bool
) -> None:
    """Run the Monte Carlo over fabricated feet on a cluster, resumable."""
    from footsense.lab.monte_carlo.cluster import on_cluster
    from footsense.lab.monte_carlo.sweeps import FULL, QUICK
    from footsense.lab.studies.accuracy.tolerance import campaign_page

    plan = QUICK if quick else FULL
    _study(lambda bench: campaign_page(bench, plan, on_cluster(scheduler), file), models, output, quick=quick)


@click.command()
@click.option(
    "--models",
    type=click.Path(file_okay=False, path_type=Path),
    help=f"Folder that the models are built into; without it ./models/{daemon.FOOT_TYPE}.",
)
@_output_option
@_quick_option
@click.option("--resume", is_flag=True, help="Keep models and pages that are there; make what is missing.")
def report(*, models: Path | None, output: Path | None, quick: bool, resume: bool) -> None:
    """Build the models from nothing, run every study on them, and bind the pages into one report."""
    folder = models or Path("models") / (f"{daemon.FOOT_TYPE}-quick" if quick else daemon.FOOT_TYPE)
    require_writable(folder)
    pages = _report_folder(output, quick=quick)
    from footsense.cli.lab.faults import write_page_of_faults
    from footsense.lab.build import FULL, QUICK, build
    from footsense.lab.evaluation.evaluate_models import NETWORK_FILE, RESPONSE_FILE
    from footsense.lab.foot_file import FOOT_FILE
    from footsense.lab.report import STUDIES, is_made, make_report
    from footsense.lab.studies.page import Workbench

    say, started_ns, build_s = stopwatch_report(), stopwatch_ns(), None
    if not (resume and all((folder / name).exists() for name in (NETWORK_FILE, RESPONSE_FILE))):
        build(daemon.released(FOOT_FILE), folder, QUICK if quick else FULL, say)
        build_s = (stopwatch_ns() - started_ns) / 1e9
    bench = Workbench(models=folder, quick=quick, say=say)
    if not (resume and is_made("faults", pages, bench)):
        say(f"faults: {write_page_of_faults(pages, bench).seconds:.0f} s")
    studies = STUDIES | DAEMON_STUDIES
    say(f"wrote {make_report(pages, bench, studies, build_s=build_s, resume=resume, report=say)}")
