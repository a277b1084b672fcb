"""`footsense evaluate`: how wrong a foot is, by the network of its design alone and by its calibration."""

import importlib.util
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from footsense.calibration.evaluation import BANDS, Evaluation
from footsense.calibration.evaluation import evaluate as evaluate_sessions
from footsense.calibration.session.recorded_session import RecordedSession, read_sessions
from footsense.cli.test_stand_options import foot_files, foot_type_option
from footsense.errors import ConfigError
from footsense.estimation.network import Network
from footsense.foot.calibration_reader import FootCalibration, read_calibration
from footsense.foot.force_errors import GRAM_FORCE_N, Errors

DESIGN_ONLY, CALIBRATED = "network alone", "with its calibration"


@click.command()
@click.argument("recordings", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--foot", required=True, help="Which foot was on the test_stand, such as foot-0007.")
@click.option(
    "--calibration",
    "folder",
    type=click.Path(file_okay=False, path_type=Path),
    help="Its calibration; without the option ./feet/FOOT, and if that is not there, none.",
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for a page with figures: error map, patterns, histograms (needs matplotlib).",
)
@foot_type_option
@click.option("--json", "as_json_text", is_flag=True, help="Print JSON.")
def evaluate(
    recordings: tuple[Path, ...],
    foot: str,
    folder: Path | None,
    out: Path | None,
    foot_type_folder: Path | None,
    *,
    as_json_text: bool,
) -> None:
    """Compare a foot's forces with the reference of the test_stand, by its network alone and by its calibration."""
    if out is not None:
        _require_figures(out)
    sessions = read_sessions(recordings, foot)
    foot_type = sessions[0].foot_type
    files = foot_files(foot_type, foot_type_folder)
    calibration = _calibration_of(folder, foot, foot_type)
    path, trained_inputs, parameters = files.network, files.trained_inputs, None
    if calibration is not None:
        path, trained_inputs = calibration.network, Network(calibration.network, 1).card.trained_inputs
        parameters = calibration.parameters
    found = evaluate_sessions(sessions, lambda n_rows: Network(path, n_rows), trained_inputs, parameters)
    warnings = [line for session in sessions for line in session.warnings] + _fitted_on(sessions, calibration)
    for line in warnings:
        click.echo(f"warning: {line}", err=True)
    figures = as_json(foot, foot_type, sessions, calibration, found)
    if out is not None:
        from footsense.cli.evaluate.page import write_page

        page = write_page(out, figures, warnings, found, parameters, files.response)
        click.echo(f"wrote {page}", err=True)
    click.echo(json.dumps(figures, indent=2) if as_json_text else as_text(figures))


def as_json(
    foot: str,
    foot_type: str,
    sessions: Sequence[RecordedSession],
    calibration: FootCalibration | None,
    found: Evaluation,
) -> dict[str, Any]:
    """Return all numbers as plain values; a band without loads is left out."""
    ways = {DESIGN_ONLY: found.design_only} | ({CALIBRATED: found.calibrated} if found.calibrated else {})
    bands = {band.name: {name: found.errors_of(read, band) for name, read in ways.items()} for band in BANDS}
    return {
        "foot": foot,
        "foot_type": foot_type,
        "calibration": None
        if calibration is None
        else {
            "made": calibration.manifest.made,
            "footsense": calibration.manifest.footsense,
            "n_loads": calibration.manifest.n_loads,
            "sha256": calibration.manifest.sha256,
        },
        "sessions": {session.name: len(session.loads) for session in sessions},
        "n_loads": len(found.truth_n),
        "n_compared": int(found.compared.sum()),
        "beyond_what_was_taught": {name: int((~read.usable).sum()) for name, read in ways.items()},
        "bands": {
            name: {way: _plain(errors) for way, errors in of_way.items() if errors is not None}
            for name, of_way in bands.items()
            if any(of_way.values())
        },
    }


def _plain(errors: Errors) -> dict[str, float]:
    n = GRAM_FORCE_N
    return {
        "loads": errors.n,
        "direction_deg": errors.direction_deg,
        "direction_p95_deg": errors.direction_p95_deg,
        "magnitude_gf": errors.magnitude_gf,
        "magnitude_p95_gf": errors.magnitude_p95_gf,
        "magnitude_n": errors.magnitude_gf * n,
        "magnitude_p95_n": errors.magnitude_p95_gf * n,
    }


def rows(figures: dict[str, Any]) -> list[list[str]]:
    """Return the table of errors, its header first."""
    header = ["loads", "read by the", "loads", "deg", "p95", "gf", "p95", "N", "p95"]
    found = [header]
    for band, of_way in figures["bands"].items():
        for number, (way, errors) in enumerate(of_way.items()):
            values = [errors[key] for key in list(errors)[1:]]
            digits = (2, 2, 2, 2, 4, 4)
            numbers = [f"{value:.{digit}f}" for value, digit in zip(values, digits, strict=True)]
            found.append([band if number == 0 else "", way, str(errors["loads"]), *numbers])
    return found


def headline(figures: dict[str, Any]) -> str:
    """Return what was evaluated, in one line."""
    calibration = figures["calibration"]
    by = (
        f"its calibration of {calibration['made']} on {calibration['n_loads']} loads"
        if calibration
        else "no calibration"
    )
    n_sessions = len(figures["sessions"])
    return (
        f"{figures['foot']}, type {figures['foot_type']}, {by}: {figures['n_compared']} of {figures['n_loads']} loads "
        f"in {n_sessions} session{'s' * (n_sessions > 1)} compared"
    )


def as_text(figures: dict[str, Any]) -> str:
    """Return the table for a terminal."""
    table = rows(figures)
    widths = [max(len(row[column]) for row in table) for column in range(len(table[0]))]
    lines = [
        "  ".join(
            cell.ljust(width) if column < 2 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in table
    ]
    return "\n".join([headline(figures), *lines])


def _calibration_of(folder: Path | None, foot: str, foot_type: str) -> FootCalibration | None:
    """Return the calibration of the foot, None if none was named and none is where calibrations are."""
    if folder is None:
        folder = Path("feet") / foot
        if not folder.exists():
            click.echo(
                f"no calibration at {folder}: the network of the design alone; --calibration names another place",
                err=True,
            )
            return None
    return read_calibration(folder, foot_type, foot)


def _fitted_on(sessions: Sequence[RecordedSession], calibration: FootCalibration | None) -> list[str]:
    """Return the line that says which recordings flatter the calibration."""
    known = set() if calibration is None else set(calibration.manifest.recordings.values())
    fitted = [str(session.path) for session in sessions if session.sha256 in known]
    if not fitted:
        return []
    return [
        f"the calibration was made of {', '.join(fitted)}: its errors there are smaller than on loads that it never saw"
    ]


def _require_figures(out: Path) -> None:
    """Check that figures can be drawn and written, before the work.

    Raises:
        ConfigError: The library for it is not there.
    """
    if importlib.util.find_spec("matplotlib") is None:
        raise ConfigError(
            "--out draws with matplotlib: pip install 'footsense[lab]'; without --out the table alone"
        )
    from footsense.cli.lab.options import require_writable

    require_writable(out)
