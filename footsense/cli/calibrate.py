"""Command `footsense calibrate`: fit a foot's calibration to its test-stand recordings."""

from pathlib import Path
from typing import Any

import click

import footsense
from footsense.calibration.fit.calibrate import (
    MAX_MEDIAN_MAHALANOBIS_DISTANCE,
    WARNING_MEDIAN_MAHALANOBIS_DISTANCE,
    CalibrationResult,
    calibrate_sessions,
)
from footsense.calibration.session.recorded_session import read_sessions
from footsense.calibration.writer import check_calibration_target, write_calibration
from footsense.cli.options import FOLDER, json_option
from footsense.cli.recordings.file_bar import file_progress_bar
from footsense.cli.tables import echo_json
from footsense.cli.test_stand_options import (
    foot_option,
    foot_type_option,
    load_design_models,
    recordings_argument,
)
from footsense.clock import stopwatch_ns, wall_time_iso
from footsense.foot.files.calibration_format import Manifest
from footsense.foot.files.calibration_reader import FootCalibration


@click.command()
@recordings_argument
@foot_option
@click.option(
    "--calibrations",
    "folder",
    type=FOLDER,
    default=Path("feet"),
    show_default=True,
    help="Folder of all calibrations; this foot's is named after the foot.",
)
@foot_type_option
@click.option("--hold-out", help="Session to hold out for the accuracy; by default the last of several.")
@click.option("--replace", is_flag=True, help="Replace an existing calibration; the old one is kept.")
@json_option
def calibrate(
    recordings: tuple[Path, ...],
    foot: str,
    folder: Path,
    foot_type_folder: Path | None,
    hold_out: str | None,
    *,
    replace: bool,
    as_json: bool,
) -> None:
    """Fit the parameters in which a foot differs from its design, and write its calibration.

    The RECORDINGS are those of `footsense record --reference`, one or more of each session.
    """
    began_ns = stopwatch_ns()
    check_calibration_target(folder / foot, replace=replace)
    with file_progress_bar("read", *recordings) as on_bytes_read:
        sessions = read_sessions(recordings, foot, on_bytes_read)
    for session in sessions:
        for line in session.warnings:
            click.echo(f"warning: {line}", err=True)
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
    if as_json:
        echo_json(_calibration_json(calibration, result, took_s))
    else:
        click.echo(_calibration_text(calibration, result, took_s))


def _calibration_json(
    calibration: FootCalibration, result: CalibrationResult, took_s: float
) -> dict[str, Any]:
    """Return the figures of a calibration as plain values for JSON."""
    predicted, parameters = result.predicted_uncertainty, calibration.parameters
    return {
        "calibration": str(calibration.folder),
        "sha256": calibration.manifest.sha256,
        "n_loads": result.n_loads,
        "took_s": round(took_s, 2),
        "temperature_c": result.temperature_c,
        **{name: getattr(parameters, name) for name in ("stiffness_rel", "stray_pf", "gap_um", "gain_rel")},
        "corrected": bool(parameters.correction.any()),
        "distance": result.median_mahalanobis_distance,
        "predicted": {
            "direction_deg": predicted.median_direction_error_deg,
            "magnitude_rel": predicted.median_magnitude_error_rel,
        },
        "not_identified": predicted.not_identified,
        "held_out": result.held_out,
    }


def _calibration_text(calibration: FootCalibration, result: CalibrationResult, took_s: float) -> str:
    """Return the figures of a calibration as text for the terminal."""
    parameters, predicted, held_out = calibration.parameters, result.predicted_uncertainty, result.held_out
    strays = f"stray {parameters.stray_pf.min():+.3f} to {parameters.stray_pf.max():+.3f} pF"
    gaps = f"gaps {parameters.gap_um.min():.1f} to {parameters.gap_um.max():.1f} um"
    temperature = "" if result.temperature_c is None else f" at {result.temperature_c:.1f} degC"
    origin = f"{result.n_loads} loads in {calibration.manifest.n_sessions} sessions{temperature}"
    lines = [
        f"{calibration.folder}: {origin}, {took_s:.1f} s",
        f"  stiffness {1.0 + parameters.stiffness_rel:.3f} of the design's, {strays}, {gaps}",
        (
            f"  predicted uncertainty: {predicted.median_direction_error_deg:.2f} deg, "
            f"{predicted.median_magnitude_error_rel:.1%} of the force"
        ),
    ]
    doubt = (
        ""
        if result.median_mahalanobis_distance <= WARNING_MEDIAN_MAHALANOBIS_DISTANCE
        else "; more than usual: something differs from the design's kind"
    )
    lines.append(
        f"  median distance of the loads from the fitted foot: {result.median_mahalanobis_distance:.1f}, "
        f"usual are 2 to {WARNING_MEDIAN_MAHALANOBIS_DISTANCE:g}, refused from "
        f"{MAX_MEDIAN_MAHALANOBIS_DISTANCE:g}{doubt}"
    )
    if predicted.not_identified:
        lines.append(f"  not identified, near the design's value: {', '.join(predicted.not_identified)}")
    if held_out is None:
        lines.append("  accuracy unknown, no load was held out; record a second session")
    else:
        before, after = held_out.design_only, held_out.calibrated
        lines.append(f"  held out: {held_out.protocol}, {after.n} loads")
        lines.append(f"    network alone     {before.direction_deg:6.2f} deg {before.magnitude_gf:6.2f} gf")
        lines.append(f"    with calibration  {after.direction_deg:6.2f} deg {after.magnitude_gf:6.2f} gf")
    return "\n".join(lines)
