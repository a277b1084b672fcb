"""Command `footsense evaluate`: force errors against the reference sensor, without and with the foot's calibration."""

import importlib.util
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import click

from footsense.calibration.evaluation import evaluate as evaluate_sessions
from footsense.calibration.session.recorded_session import RecordedSession, read_sessions
from footsense.cli.evaluate.summary import evaluation_results, summary_text
from footsense.cli.options import FOLDER, json_option
from footsense.cli.recordings.file_bar import file_progress_bar
from footsense.cli.tables import echo_json
from footsense.cli.test_stand_options import (
    foot_option,
    foot_type_option,
    load_design_models,
    recordings_argument,
)
from footsense.errors import ConfigError
from footsense.estimation.network import Network
from footsense.foot.files.calibration_reader import FootCalibration, read_calibration


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
        _require_writable_page(out)
    with file_progress_bar("read", *recordings) as on_bytes_read:
        sessions = read_sessions(recordings, foot, on_bytes_read)
    foot_type = sessions[0].foot_type
    models, _ = load_design_models(foot_type, foot_type_folder)
    parameters = None
    calibration = _calibration_of(folder, foot, foot_type)
    if calibration is not None:
        models, parameters = (
            models._replace(network_for_rows=partial(Network, calibration.network)),
            calibration.parameters,
        )
    evaluation = evaluate_sessions(sessions, models, parameters)
    warnings = [line for session in sessions for line in session.warnings] + _warnings_of_fitted_recordings(
        sessions, calibration
    )
    for line in warnings:
        click.echo(f"warning: {line}", err=True)
    figures = evaluation_results(foot, foot_type, sessions, calibration, evaluation)
    if out is not None:
        from footsense.cli.evaluate.page import write_page

        page = write_page(out, figures, warnings, evaluation, parameters, models.response)
        click.echo(f"wrote {page}", err=True)
    if as_json:
        echo_json(figures)
    else:
        click.echo(summary_text(figures))


def _calibration_of(folder: Path | None, foot: str, foot_type: str) -> FootCalibration | None:
    """Return the foot's calibration; None if no folder is given and the default folder has none."""
    if folder is None:
        folder = Path("feet") / foot
        if not folder.exists():
            click.echo(
                f"no calibration at {folder}: the network of the design alone; --calibration names another folder",
                err=True,
            )
            return None
    return read_calibration(folder, foot_type, foot)


def _warnings_of_fitted_recordings(
    sessions: Sequence[RecordedSession], calibration: FootCalibration | None
) -> list[str]:
    """Return a warning if the calibration was fitted on some of the evaluated recordings."""
    used = set() if calibration is None else set(calibration.manifest.recordings.values())
    fitted = [str(session.path) for session in sessions if session.sha256 in used]
    if not fitted:
        return []
    return [
        f"the calibration was fitted on {', '.join(fitted)}: its errors there are smaller than on other loads"
    ]


def _require_writable_page(out: Path) -> None:
    """Raise an error if the result page cannot be drawn or written.

    Raises:
        ConfigError: A library is missing, or the folder cannot be written.
    """
    if missing := [name for name in ("jinja2", "matplotlib") if importlib.util.find_spec(name) is None]:
        raise ConfigError(
            f"--out needs {', '.join(missing)}: pip install 'footsense[lab]'; without --out the table alone"
        )
    from footsense.cli.lab.options import ensure_writable_folder

    ensure_writable_folder(out)
