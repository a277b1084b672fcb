"""Commands `footsense test-stand calibrate` and `evaluate`: recordings of a foot to its calibration and errors."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import click
import msgspec
from rich.console import Console

import footsense
from footsense.calibration.calibrate import (
    MAX_MEDIAN_MAHALANOBIS_DISTANCE,
    WARNING_MEDIAN_MAHALANOBIS_DISTANCE,
    CalibrationResult,
    calibrate_sessions,
)
from footsense.calibration.evaluation import MAGNITUDE_BANDS_GF, Evaluation
from footsense.calibration.evaluation import evaluate as evaluate_sessions
from footsense.calibration.recorded_session import RecordedSession, read_sessions
from footsense.calibration.writer import check_calibration_target, write_calibration
from footsense.cli.options import FILE, FOLDER, foot_option, json_option
from footsense.cli.tables import Column, echo_figures, echo_json, errors_text, figures_table, json_row, table
from footsense.cli.test_stand.design_models import load_design_models
from footsense.cli.test_stand.standing import calibrate_by_standing
from footsense.clock import stopwatch_ns, wall_time_iso
from footsense.errors import require
from footsense.estimation.network import Network
from footsense.foot.calibration_files import FootCalibration, HeldOutErrors, Manifest, read_calibration
from footsense.foot.force_errors import GRAM_FORCE_N, ForceErrors
from footsense.progress import file_progress_bar

_MN_PER_GF = 1e3 * GRAM_FORCE_N

#: Parameters of single elements, and why loads may not identify them.
_WHY_NOT_IDENTIFIED = {
    "stray_pf": "too few loads from their side",
    "gap_um": "no load closes them",
    "gain_rel": "too few loads from their side",
}

_recordings_argument = click.argument("recordings", nargs=-1, required=True, type=FILE)
_foot_type_option = click.option(
    "--foot-type",
    "foot_type_folder",
    type=FOLDER,
    help="Folder with network.onnx and response.npz of the foot's type; by default the released one.",
)


@click.command()
@_recordings_argument
@click.option(
    "--foot", help="The foot, such as foot-0007; with --no-reference, by default every foot that has a name."
)
@click.option(
    "--no-reference",
    "by_standing",
    is_flag=True,
    help="Calibrate the electrodes alone, from a robot that stood in some postures.",
)
@click.option(
    "--mass-kg",
    type=click.FloatRange(0.0, min_open=True),
    help="Mass of the robot, with --no-reference: its weight gives the size of each foot's forces.",
)
@click.option(
    "--calibrations",
    "folder",
    type=FOLDER,
    default=Path("feet"),
    show_default=True,
    help="Folder of all calibrations; this foot's is named after the foot.",
)
@_foot_type_option
@click.option("--hold-out", help="Session to hold out for the accuracy; by default the last of several.")
@click.option("--replace", is_flag=True, help="Replace an existing calibration; the old one is kept.")
@json_option
def calibrate(
    recordings: tuple[Path, ...],
    foot: str | None,
    folder: Path,
    foot_type_folder: Path | None,
    hold_out: str | None,
    *,
    by_standing: bool,
    mass_kg: float | None,
    replace: bool,
    as_json: bool,
) -> None:
    """Fit the parameters in which a foot differs from its design, and write its calibration.

    The RECORDINGS are those of `footsense test-stand record --reference`, one or more of each session; with
    --no-reference of `footsense run --record` while the robot stands in five or more postures, a second each, and
    hangs free at the begin and at the end.
    """  # noqa: DOC501
    if by_standing:
        if hold_out is not None:
            raise click.UsageError("--hold-out needs a reference")
        calibrate_by_standing(
            recordings, foot, folder, foot_type_folder, mass_kg=mass_kg, replace=replace, as_json=as_json
        )
        return
    if mass_kg is not None:
        raise click.UsageError("--mass-kg is of a robot that stood: it needs --no-reference")
    if foot is None:
        raise click.UsageError("--foot names the foot on the test stand, such as foot-0007")
    began_ns = stopwatch_ns()
    check_calibration_target(folder / foot, replace=replace)
    sessions = _read_sessions(recordings, foot)
    models, design = load_design_models(sessions[0].foot_type, foot_type_folder)
    result = calibrate_sessions(models, sessions, hold_out)
    manifest = Manifest(
        foot=foot,
        foot_type=sessions[0].foot_type,
        footsense=footsense.__version__,
        made=wall_time_iso(),
        n_loads=result.n_loads,
        n_sessions=len({session.name for session in sessions}),
        held_out=result.held_out,
        recordings={session.path.name: session.sha256 for session in sessions},
    )
    calibration = write_calibration(
        folder,
        manifest,
        result.parameters,
        design / "network.onnx",
        temperature_c=result.temperature_c,
        replace=replace,
    )
    took_s = (stopwatch_ns() - began_ns) * 1e-9
    figures = _calibration_figures(calibration, result, took_s)
    if as_json:
        echo_json(figures)
    else:
        echo_figures(_in_words(figures, result.held_out), as_json=False)
    if result.median_mahalanobis_distance > WARNING_MEDIAN_MAHALANOBIS_DISTANCE:
        click.echo(
            f"warning: the median distance of the loads from the fitted foot is more than usual, 2 to "
            f"{WARNING_MEDIAN_MAHALANOBIS_DISTANCE:g}; something differs from the design's kind (refused from "
            f"{MAX_MEDIAN_MAHALANOBIS_DISTANCE:g})",
            err=True,
        )
    if result.held_out is None:
        click.echo("accuracy unknown, no load was held out; record a second session", err=True)


@click.command()
@_recordings_argument
@foot_option
@click.option(
    "--calibration",
    "folder",
    type=FOLDER,
    help="Folder of its calibration; by default ./feet/FOOT, and if that is missing, none.",
)
@click.option(
    "--map",
    "error_map",
    type=click.Path(dir_okay=False, writable=True, path_type=Path),
    help="Picture of the direction errors over the ball, such as errors.png (extra lab).",
)
@_foot_type_option
@json_option
def evaluate(
    recordings: tuple[Path, ...],
    foot: str,
    folder: Path | None,
    error_map: Path | None,
    foot_type_folder: Path | None,
    *,
    as_json: bool,
) -> None:
    """Compare a foot's forces with the reference of the test stand, with its calibration and without."""
    if error_map is not None:
        require("--map", "lab", "matplotlib")
        from footsense.cli.lab.options import ensure_writable_folder

        ensure_writable_folder(error_map.parent)
    sessions = _read_sessions(recordings, foot)
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
    used = set() if calibration is None else set(calibration.manifest.recordings.values())
    if fitted := [str(session.path) for session in sessions if session.sha256 in used]:
        click.echo(
            f"warning: the calibration was fitted on {', '.join(fitted)}: its errors there are smaller than on "
            "other loads",
            err=True,
        )
    rows = [
        ErrorRow(band, source, errors)
        for band, range_gf in MAGNITUDE_BANDS_GF.items()
        for source, estimates in evaluation.estimates.items()
        if (errors := evaluation.errors_of(estimates, *range_gf)) is not None
    ]
    figures = _evaluation_figures(foot, foot_type, sessions, calibration, evaluation, rows)
    if error_map is not None:
        from footsense.cli.lab.error_map import write_error_map

        compared = evaluation.is_compared
        estimates_n = {source: one.force_n[compared] for source, one in evaluation.estimates.items()}
        write_error_map(error_map, evaluation.reference_n[compared], estimates_n)
        click.echo(f"wrote {error_map}", err=True)
    if as_json:
        echo_json(figures)
    else:
        console = Console(highlight=False)
        if not console.is_terminal:
            console.width = 200  # no line of a file or a pipe is folded
        console.print(figures_table(figures | {"bands": None}), table(ERROR_COLUMNS, rows))


class ErrorRow(NamedTuple):
    """Force errors of the loads of one magnitude by one estimator."""

    band: str
    source: str
    errors: ForceErrors


#: The errors of `footsense test-stand evaluate`, in JSON and as a table.
ERROR_COLUMNS: list[Column[ErrorRow]] = [
    Column("", lambda row: row.band, "<1", ("magnitude",)),
    Column("", lambda row: row.source, "<1", ("forces by the",)),
    Column("loads", lambda row: row.errors.n, ">1"),
    Column("direction_deg", lambda row: row.errors.direction_deg, ">.2f", ("deg",)),
    Column("direction_p95_deg", lambda row: row.errors.direction_p95_deg, ">.2f", ("p95",)),
    Column("magnitude_mn", lambda row: _MN_PER_GF * row.errors.magnitude_gf, ">.1f", ("mN",)),
    Column("magnitude_p95_mn", lambda row: _MN_PER_GF * row.errors.magnitude_p95_gf, ">.1f", ("p95",)),
]


def _evaluation_figures(
    foot: str,
    foot_type: str,
    sessions: Sequence[RecordedSession],
    calibration: FootCalibration | None,
    evaluation: Evaluation,
    rows: Sequence[ErrorRow],
) -> dict[str, Any]:
    """Return all results of an evaluation as plain values; bands without loads are left out."""
    bands: dict[str, dict[str, Any]] = {}
    for row in rows:
        bands.setdefault(row.band, {})[row.source] = json_row(ERROR_COLUMNS, row)
    kept = ("made", "footsense", "n_loads", "sha256")
    return {
        "foot": foot,
        "foot_type": foot_type,
        "calibration": calibration and {key: getattr(calibration.manifest, key) for key in kept},
        "sessions": {session.name: len(session.loads) for session in sessions},
        "n_loads": len(evaluation.reference_n),
        "n_compared": int(evaluation.is_compared.sum()),
        "outside_training_range": {
            source: int((~estimates.has_force).sum()) for source, estimates in evaluation.estimates.items()
        },
        "bands": bands,
    }


def _calibration_figures(
    calibration: FootCalibration, result: CalibrationResult, took_s: float
) -> dict[str, Any]:
    predicted, parameters = result.predicted_uncertainty, calibration.parameters
    return {
        "calibration": str(calibration.folder),
        "sha256": calibration.manifest.sha256,
        "n_loads": result.n_loads,
        "n_sessions": calibration.manifest.n_sessions,
        "took_s": round(took_s, 2),
        "temperature_c": result.temperature_c,
        "stiffness_rel": parameters.stiffness_rel,
        **{name: getattr(parameters, name).tolist() for name in ("stray_pf", "gap_um", "gain_rel")},
        "not_identified": result.not_identified,
        "distance": result.median_mahalanobis_distance,
        "predicted": {
            "direction_deg": predicted.median_direction_error_deg,
            "magnitude_rel": predicted.median_magnitude_error_rel,
        },
        "held_out": msgspec.to_builtins(result.held_out),
    }


def _in_words(figures: dict[str, Any], held_out: HeldOutErrors | None) -> dict[str, Any]:
    """Return the figures of a calibration for people; what the loads do not identify is one line for each parameter."""
    told = {"stiffness" if name == "stiffness_rel" else name: value for name, value in figures.items()}
    told["stiffness"] = f"{figures['stiffness_rel']:+.1%} of the design's"
    for name, unknown in figures["not_identified"].items():
        values = enumerate(figures[name])
        told[name] = {f"element {n}": value for n, value in values if n not in unknown}
    told["not_identified"] = {
        name: f"as designed for elements {' '.join(map(str, unknown))}, {_WHY_NOT_IDENTIFIED[name]}"
        for name, unknown in figures["not_identified"].items()
    }
    if held_out is not None:
        told["held_out"] = held_out.protocol
        told["as designed"] = errors_text(held_out.design_only)
        told["calibrated"] = errors_text(held_out.calibrated)
    return told


def _read_sessions(recordings: tuple[Path, ...], foot: str) -> list[RecordedSession]:
    """Read recordings of a foot, and print what is doubtful in them."""
    with file_progress_bar("read", *recordings) as on_bytes_read:
        sessions = read_sessions(recordings, foot, on_bytes_read)
    for session in sessions:
        for line in session.warnings:
            click.echo(f"warning: {line}", err=True)
    return sessions


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
