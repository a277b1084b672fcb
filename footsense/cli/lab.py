"""`footsense lab`: make the released network and foot response, and say how good they are. Needs the extra `lab`."""

import importlib.util
import json
import tempfile
from pathlib import Path

import click

from footsense import app
from footsense.clock import stopwatch_ns
from footsense.errors import FootsenseError

#: What only the workshop's install has.
_EXTRA = ("ngsolve", "jax", "optax", "onnx", "scipy")


def _released() -> Path:
    """Return the folder of the released files."""
    return app.released("network.onnx").parent


def _require_extra() -> None:
    """Check that the workshop's libraries are installed.

    Raises:
        FootsenseError: One is not.
    """
    missing = [name for name in _EXTRA if importlib.util.find_spec(name) is None]
    if missing:
        raise FootsenseError(
            f"the lab needs {', '.join(missing)}: pip install 'footsense[lab]', "
            "or in a checkout .venv/bin/pip install -e '.[lab]'"
        )


def _require_writable(folder: Path) -> None:
    """Make a folder and try to write to it, so that minutes of work do not end there.

    Raises:
        FootsenseError: It cannot be made, or not be written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryDirectory(dir=folder).cleanup()
    except OSError as error:
        raise FootsenseError(
            f"{folder}: cannot be written to: {error.strerror}; choose another --output"
        ) from error


@click.group()
def lab() -> None:
    """From rubber to network: build, judge and compare the released models."""
    _require_extra()


@lab.command()
@click.option(
    "--output",
    type=click.Path(file_okay=False, path_type=Path),
    help=f"Folder for the files; without it ./models/{app.FOOT_TYPE}.",
)
@click.option("--quick", is_flag=True, help="Coarse mesh, short training: every step, no release.")
def build(*, output: Path | None, quick: bool) -> None:
    """Solve the foot, train the network, write both with their card, and print the error table."""
    folder = output or Path("models") / (f"{app.FOOT_TYPE}-quick" if quick else app.FOOT_TYPE)
    _require_writable(folder)
    from footsense.lab.build import FULL, QUICK
    from footsense.lab.build import build as build_models
    from footsense.lab.evaluate_models import as_markdown

    started_ns = stopwatch_ns()

    def report(line: str) -> None:
        click.echo(f"[{(stopwatch_ns() - started_ns) / 1e9:6.1f} s] {line}")

    built = build_models(folder, QUICK if quick else FULL, report)
    report(f"wrote {folder}; JAX and ONNX Runtime differ by at most {1000 * built.parity_n:.4f} mN")
    click.echo(as_markdown(built.table))


_models_option = click.option(
    "--models",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder with network.onnx and response.npz; without it the released ones.",
)


@lab.command()
@_models_option
@click.option("--json", "as_json_text", is_flag=True, help="Print JSON.")
def evaluate(*, models: Path | None, as_json_text: bool) -> None:
    """Print the error table of the released network beside the paper and the linear read-outs."""
    from footsense.lab.evaluate_models import as_json, as_markdown, evaluate_models

    table = evaluate_models(models or _released())
    click.echo(json.dumps(as_json(table), indent=2) if as_json_text else as_markdown(table))


@lab.command()
@click.argument("other", type=click.Path(file_okay=False, path_type=Path))
@_models_option
def compare(*, other: Path, models: Path | None) -> None:
    """Print how far a build in OTHER is from the released files, and by how much its network is worse.

    Ends with exit code 1 where one is beyond what is tolerated; a better network is none.
    """
    from footsense.lab.compare import compare as compare_builds

    differences = compare_builds(models or _released(), other)
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
