"""`footsense lab response`, `study`, `ladder`, `limit`, `tolerance`, `report`: questions to the models."""

import json
from pathlib import Path

import click

from footsense import app
from footsense.cli.lab_options import models_option, released_folder, require_writable, stopwatch_report
from footsense.errors import FootsenseError

_quick_option = click.option("--quick", is_flag=True, help="Every step in seconds; its numbers say nothing.")
_output_option = click.option(
    "--output",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("docs/report"),
    show_default=True,
    help="Folder for pages and figures.",
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
    """Print what one centred load does to the nine elements.

    Raises:
        FootsenseError: There is no such rung, or it cannot answer for such a load.
    """
    from footsense.lab.evaluate_models import RESPONSE_FILE
    from footsense.lab.geometry import SoleDesign
    from footsense.lab.ladder.query import response_to
    from footsense.sim.foot import FootResponse

    table = FootResponse.load((models or released_folder()) / RESPONSE_FILE)
    try:
        found = response_to(table, SoleDesign(), direction_deg, force_n, rung_name)
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


def _study(name: str, models: Path | None, output: Path, *, quick: bool) -> None:
    """Run one study, write its page, and print it."""
    require_writable(output)
    from footsense.lab.report import bind, make_page
    from footsense.lab.study.page import Workbench

    bench = Workbench(models=models or released_folder(), quick=quick, say=stopwatch_report())
    page = make_page(name, bench)
    page.write(output)
    bind(output)
    click.echo(page.markdown)
    click.echo(f"wrote {output / page.name}.md, and bound it into {output / 'README.md'}")


@click.command()
@click.argument("name")
@models_option
@_output_option
@_quick_option
def study(*, name: str, models: Path | None, output: Path, quick: bool) -> None:
    """Run the study NAME: its page with tables and figures goes into the report. A name that is none lists all."""
    _study(name, models, output, quick=quick)


@click.command()
@models_option
@_output_option
@_quick_option
def ladder(*, models: Path | None, output: Path, quick: bool) -> None:
    """Print time and error of the four models of the foot, and draw one against the other."""
    _study("ladder", models, output, quick=quick)


@click.command()
@models_option
@_output_option
@_quick_option
def limit(*, models: Path | None, output: Path, quick: bool) -> None:
    """Print the Cramer-Rao bound over the loading range, and the network's error over it."""
    _study("limit", models, output, quick=quick)


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
    *, scheduler: str | None, file: Path | None, models: Path | None, output: Path, quick: bool
) -> None:
    """Run the Monte Carlo over fabricated feet on a cluster, resumable."""
    require_writable(output)
    from footsense.lab.cluster import on_cluster
    from footsense.lab.report import bind
    from footsense.lab.study.page import Workbench
    from footsense.lab.study.tolerance import campaign_page
    from footsense.lab.sweeps import FULL, QUICK

    bench = Workbench(models=models or released_folder(), quick=quick, say=stopwatch_report())
    page = campaign_page(bench, QUICK if quick else FULL, on_cluster(scheduler), file)
    page.write(output)
    bind(output)
    click.echo(page.markdown)


@click.command()
@click.option(
    "--models",
    type=click.Path(file_okay=False, path_type=Path),
    help=f"Folder that the models are built into; without it ./models/{app.FOOT_TYPE}.",
)
@_output_option
@_quick_option
@click.option("--resume", is_flag=True, help="Keep models and pages that are there; make what is missing.")
def report(*, models: Path | None, output: Path, quick: bool, resume: bool) -> None:
    """Build the models from nothing, run every study on them, and bind the pages into one report."""
    folder = models or Path("models") / (f"{app.FOOT_TYPE}-quick" if quick else app.FOOT_TYPE)
    for path in (folder, output):
        require_writable(path)
    from footsense.lab.build import FULL, QUICK, build
    from footsense.lab.evaluate_models import NETWORK_FILE, RESPONSE_FILE
    from footsense.lab.report import make_report
    from footsense.lab.study.page import Workbench

    say = stopwatch_report()
    built = all((folder / name).exists() for name in (NETWORK_FILE, RESPONSE_FILE))
    if not (resume and built):
        build(folder, QUICK if quick else FULL, say)
    bench = Workbench(models=folder, quick=quick, say=say)
    say(f"wrote {make_report(output, bench, resume=resume, report=say)}")
