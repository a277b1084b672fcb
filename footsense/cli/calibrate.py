"""`footsense calibrate`: from recordings of a foot on the bench to its calibration."""

import json
from functools import partial
from pathlib import Path
from typing import Any

import click

from footsense.calibration.fit.calibrate import Design
from footsense.calibration.fit.sessions import CalibratedFoot, calibrate_sessions
from footsense.calibration.session.recorded_session import RecordedSession, read_sessions
from footsense.calibration.writer import CalibrationContent, check_calibration_target, write_calibration
from footsense.cli.test_stand_options import foot_files, foot_type_option
from footsense.clock import stopwatch_ns, wall_time_iso
from footsense.estimation.network import Network
from footsense.foot.calibration_reader import FootCalibration
from footsense.foot.force_errors import Errors
from footsense.foot.response_table import FootResponse


@click.command()
@click.argument("recordings", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--foot", required=True, help="Which foot was on the test_stand, such as foot-0007.")
@click.option(
    "--feet",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("feet"),
    show_default=True,
    help="Folder of all calibrations; this foot's gets its name in it.",
)
@foot_type_option
@click.option(
    "--hold-out", help="Session that tells how good the calibration is; without it, the last of several."
)
@click.option(
    "--replace", is_flag=True, help="Take the place of a calibration that is there; that one is kept."
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def calibrate(
    recordings: tuple[Path, ...],
    foot: str,
    feet: Path,
    foot_type_folder: Path | None,
    hold_out: str | None,
    *,
    replace: bool,
    as_json: bool,
) -> None:
    """Find what makes a foot differ from its design, and write its calibration.

    The RECORDINGS are those of `footsense record --reference`, one for each session.
    """
    began_ns = stopwatch_ns()
    check_calibration_target(feet / foot, replace=replace)
    sessions = read_sessions(recordings, foot)
    for line in (line for session in sessions for line in session.warnings):
        click.echo(f"warning: {line}", err=True)
    files = foot_files(sessions[0].foot_type, foot_type_folder)
    design = Design(FootResponse.load(files.response), partial(Network, files.network), files.trained_inputs)
    found = calibrate_sessions(design, sessions, hold_out)
    calibration = write_calibration(feet, _content(foot, files.network, sessions, found), replace=replace)
    figures = _figures(calibration, found, (stopwatch_ns() - began_ns) * 1e-9)
    click.echo(json.dumps(figures, indent=2) if as_json else _text(calibration, found, figures))


def _content(
    foot: str, network: Path, sessions: list[RecordedSession], found: CalibratedFoot
) -> CalibrationContent:
    return CalibrationContent(
        foot=foot,
        foot_type=sessions[0].foot_type,
        parameters=found.calibrated.parameters,
        network=network,
        made=wall_time_iso(),
        n_loads=found.n_loads,
        n_sessions=len({session.name for session in sessions}),
        held_out=found.held_out,
        recordings={session.path.name: session.sha256 for session in sessions},
        temperature_c=found.temperature_c,
    )


def _figures(calibration: FootCalibration, found: CalibratedFoot, took_s: float) -> dict[str, Any]:
    foreseen, parameters = found.calibrated.foreseen, calibration.parameters
    held_out = calibration.manifest.held_out
    return {
        "calibration": str(calibration.folder),
        "sha256": calibration.manifest.sha256,
        "n_loads": found.n_loads,
        "took_s": round(took_s, 2),
        "temperature_c": found.temperature_c,
        "stiffness_rel": parameters.stiffness_rel,
        "stray_pf": parameters.stray_pf.tolist(),
        "gap_um": parameters.gap_um.tolist(),
        "gain_rel": parameters.gain_rel.tolist(),
        "corrected": bool(parameters.correction.any()),
        "foreseen": {"direction_deg": foreseen.direction_deg, "magnitude_rel": foreseen.magnitude_rel},
        "not_told": list(foreseen.untold),
        "held_out": None
        if held_out is None
        else {
            "protocol": held_out.protocol,
            "design_only": _errors(held_out.design_only),
            "calibrated": _errors(held_out.calibrated),
        },
    }


def _errors(found: Errors) -> dict[str, float]:
    return {"direction_deg": found.direction_deg, "magnitude_gf": found.magnitude_gf, "loads": found.n}


def _text(calibration: FootCalibration, found: CalibratedFoot, figures: dict[str, Any]) -> str:
    own, foreseen, held_out = calibration.parameters, found.calibrated.foreseen, calibration.manifest.held_out
    strays = f"stray {own.stray_pf.min():+.3f} to {own.stray_pf.max():+.3f} pF"
    gaps = f"gaps {own.gap_um.min():.1f} to {own.gap_um.max():.1f} um"
    warmth = "" if found.temperature_c is None else f" at {found.temperature_c:.1f} degC"
    made = f"{found.n_loads} loads in {calibration.manifest.n_sessions} sessions{warmth}"
    lines = [
        f"{calibration.folder}: {made}, {figures['took_s']:.1f} s",
        f"  stiffness {1.0 + own.stiffness_rel:.3f} of the design's, {strays}, {gaps}",
        f"  known well enough for {foreseen.direction_deg:.2f} deg and {foreseen.magnitude_rel:.1%} of a force",
    ]
    if foreseen.untold:
        lines.append(f"  not told by the loads, as designed: {', '.join(foreseen.untold)}")
    if held_out is None:
        lines.append("  no load was kept to tell how good it is; record a second session")
    else:
        before, after = held_out.design_only, held_out.calibrated
        lines.append(f"  held out: {held_out.protocol}, {after.n} loads")
        lines.append(f"    network alone   {before.direction_deg:6.2f} deg {before.magnitude_gf:6.2f} gf")
        lines.append(
            f"    with its calibration   {after.direction_deg:6.2f} deg {after.magnitude_gf:6.2f} gf"
        )
    return "\n".join(lines)
