"""`footsense evaluate`: errors of a foot's forces by the network of its design alone and with its calibration."""

import importlib.util
import json
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import click

from footsense.calibration.evaluation import BANDS, Evaluation
from footsense.calibration.evaluation import evaluate as evaluate_sessions
from footsense.calibration.session.recorded_session import RecordedSession, read_sessions
from footsense.cli.options import FOLDER, json_option
from footsense.cli.test_stand_options import design_models, foot_option, foot_type_option, recordings_argument
from footsense.errors import ConfigError
from footsense.estimation.network import Network
from footsense.foot.files.calibration_reader import FootCalibration, read_calibration
from footsense.foot.force_errors import GRAM_FORCE_N, Errors


@click.command()
@recordings_argument
@foot_option
@click.option(
    "--calibration",
    "folder",
    type=FOLDER,
    help="Folder of its calibration; by default ./feet/FOOT, and if that is missing, none.",
)
@click.option(
    "--out",
    type=FOLDER,
    help="Folder for a page with figures: error map, patterns, histograms (needs footsense[lab]).",
)
@foot_type_option
@json_option
def evaluate(
    recordings: tuple[Path, ...],
    foot: str,
    folder: Path | None,
    out: Path | None,
    foot_type_folder: Path | None,
    *,
    as_json: bool,
) -> None:
    """Compare a foot's forces with the reference of the test stand, with its calibration and without."""
    if out is not None:
        _require_figures(out)
    sessions = read_sessions(recordings, foot)
    foot_type = sessions[0].foot_type
    models, _ = design_models(foot_type, foot_type_folder)
    parameters = None
    calibration = _calibration_of(folder, foot, foot_type)
    if calibration is not None:
        models, parameters = (
            models._replace(network=partial(Network, calibration.network)),
            calibration.parameters,
        )
    evaluation = evaluate_sessions(sessions, models, parameters)
    warnings = [line for session in sessions for line in session.warnings] + _fitted_on(sessions, calibration)
    for line in warnings:
        click.echo(f"warning: {line}", err=True)
    figures = _figures(foot, foot_type, sessions, calibration, evaluation)
    if out is not None:
        from footsense.cli.evaluate.page import write_page

        page = write_page(out, figures, warnings, evaluation, parameters, models.response)
        click.echo(f"wrote {page}", err=True)
    click.echo(json.dumps(figures, indent=2) if as_json else _text(figures))


def _figures(
    foot: str,
    foot_type: str,
    sessions: Sequence[RecordedSession],
    calibration: FootCalibration | None,
    evaluation: Evaluation,
) -> dict[str, Any]:
    """Return all numbers as plain values; a band without loads is left out."""
    ways = evaluation.estimates
    bands = {
        band.name: {way: evaluation.errors_of(estimates, band) for way, estimates in ways.items()}
        for band in BANDS
    }
    kept = ("made", "footsense", "n_loads", "sha256")
    return {
        "foot": foot,
        "foot_type": foot_type,
        "calibration": calibration and {key: getattr(calibration.manifest, key) for key in kept},
        "sessions": {session.name: len(session.loads) for session in sessions},
        "n_loads": len(evaluation.reference_n),
        "n_compared": int(evaluation.compared.sum()),
        "outside_training_range": {way: int((~estimates.usable).sum()) for way, estimates in ways.items()},
        "bands": {
            name: {way: _errors(errors) for way, errors in of_way.items() if errors is not None}
            for name, of_way in bands.items()
            if any(of_way.values())
        },
    }


def _errors(errors: Errors) -> dict[str, float]:
    return {
        "loads": errors.n,
        "direction_deg": errors.direction_deg,
        "direction_p95_deg": errors.direction_p95_deg,
        "magnitude_gf": errors.magnitude_gf,
        "magnitude_p95_gf": errors.magnitude_p95_gf,
        "magnitude_n": errors.magnitude_gf * GRAM_FORCE_N,
        "magnitude_p95_n": errors.magnitude_p95_gf * GRAM_FORCE_N,
    }


def table(figures: dict[str, Any]) -> list[list[str]]:
    """Return the table of errors, its header first."""
    rows = [["magnitude", "forces by the", "loads", "deg", "p95", "gf", "p95", "N", "p95"]]
    for band, of_way in figures["bands"].items():
        for number, (way, errors) in enumerate(of_way.items()):
            n, *values = errors.values()
            cells = [f"{value:.{digits}f}" for value, digits in zip(values, (2, 2, 2, 2, 4, 4), strict=True)]
            rows.append([band if number == 0 else "", way, str(n), *cells])
    return rows


def headline(figures: dict[str, Any]) -> str:
    """Return foot, calibration and number of loads in one line."""
    calibration = figures["calibration"]
    by = "no calibration"
    if calibration:
        by = f"its calibration of {calibration['made']} on {calibration['n_loads']} loads"
    n_sessions = len(figures["sessions"])
    return (
        f"{figures['foot']}, type {figures['foot_type']}, {by}: {figures['n_compared']} of {figures['n_loads']} loads "
        f"in {n_sessions} session{'s' * (n_sessions > 1)} compared"
    )


def _text(figures: dict[str, Any]) -> str:
    rows = table(figures)
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = [
        "  ".join(
            cell.ljust(width) if column < 2 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]
    return "\n".join([headline(figures), *lines])


def _calibration_of(folder: Path | None, foot: str, foot_type: str) -> FootCalibration | None:
    """Return the calibration of the foot, None if none is named and there is none in the default folder."""
    if folder is None:
        folder = Path("feet") / foot
        if not folder.exists():
            click.echo(
                f"no calibration at {folder}: the network of the design alone; --calibration names another folder",
                err=True,
            )
            return None
    return read_calibration(folder, foot_type, foot)


def _fitted_on(sessions: Sequence[RecordedSession], calibration: FootCalibration | None) -> list[str]:
    """Return a warning if the calibration was fitted on some of the recordings."""
    used = set() if calibration is None else set(calibration.manifest.recordings.values())
    fitted = [str(session.path) for session in sessions if session.sha256 in used]
    if not fitted:
        return []
    return [
        f"the calibration was fitted on {', '.join(fitted)}: its errors there are smaller than on other loads"
    ]


def _require_figures(out: Path) -> None:
    """Check, before the work, that the page can be drawn and written.

    Raises:
        ConfigError: A library is missing, or the folder cannot be written.
    """
    if missing := [name for name in ("jinja2", "matplotlib") if importlib.util.find_spec(name) is None]:
        raise ConfigError(
            f"--out needs {', '.join(missing)}: pip install 'footsense[lab]'; without --out the table alone"
        )
    from footsense.cli.lab.options import require_writable

    require_writable(out)
