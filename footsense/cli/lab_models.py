"""`footsense lab build`, `evaluate`, `compare`: make the released models, and say how good they are."""

import json
from pathlib import Path

import click

from footsense import app
from footsense.cli.lab_options import models_option, released_folder, require_writable, stopwatch_report
from footsense.errors import FootsenseError


@click.command()
@click.option(
    "--output",
    type=click.Path(file_okay=False, path_type=Path),
    help=f"Folder for the files; without it ./models/{app.FOOT_TYPE}.",
)
@click.option("--quick", is_flag=True, help="Coarse mesh, short training: every step, no release.")
def build(*, output: Path | None, quick: bool) -> None:
    """Solve the foot, train the network, write both with their card, and print the error table."""
    folder = output or Path("models") / (f"{app.FOOT_TYPE}-quick" if quick else app.FOOT_TYPE)
    require_writable(folder)
    from footsense.lab.build import FULL, QUICK
    from footsense.lab.build import build as build_models
    from footsense.lab.evaluate_models import as_markdown

    report = stopwatch_report()
    built = build_models(folder, QUICK if quick else FULL, report)
    report(f"wrote {folder}; JAX and ONNX Runtime differ by at most {1000 * built.parity_n:.4f} mN")
    click.echo(as_markdown(built.table))


@click.command()
@models_option
@click.option(
    "--protocol",
    type=click.Choice(["table", "paper"]),
    default="table",
    show_default=True,
    help="paper: also train the paper's own way anew and compare with the Cramer-Rao bound; a minute.",
)
@click.option("--json", "as_json_text", is_flag=True, help="Print JSON.")
def evaluate(*, models: Path | None, protocol: str, as_json_text: bool) -> None:
    """Print the error table of the released network beside the paper and the linear read-outs."""
    from footsense.lab.evaluate_models import as_json, as_markdown, evaluate_models, paper_protocol

    folder = models or released_folder()
    table = evaluate_models(folder)
    beside = paper_protocol(folder) if protocol == "paper" else {}
    if as_json_text:
        click.echo(json.dumps(as_json(table, beside), indent=2))
        return
    click.echo(as_markdown(table))
    for name, value in beside.items():
        click.echo(f"{name}: {value:.3f}")


@click.command()
@click.argument("other", type=click.Path(file_okay=False, path_type=Path))
@models_option
def compare(*, other: Path, models: Path | None) -> None:
    """Print how far a build in OTHER is from the released files, and by how much its network is worse.

    Ends with exit code 1 where one is beyond what is tolerated; a better network is none.
    """
    from footsense.lab.compare import compare as compare_builds

    differences = compare_builds(models or released_folder(), other)
    for row in differences:
        verdict = "same" if row.same else "DIFFERS"
        click.echo(f"{row.what}: {row.found:.3g}, tolerated {row.tolerated:.3g}: {verdict}")
    _require_same(all(row.same for row in differences), other)


def _require_same(same: bool, other: Path) -> None:  # noqa: FBT001 - one question, one answer
    """Turn a verdict into an exit code.

    Raises:
        FootsenseError: The builds differ.
    """
    if not same:
        raise FootsenseError(f"{other} is not the same release")
