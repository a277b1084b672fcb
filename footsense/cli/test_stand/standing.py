"""Part of `footsense test-stand calibrate`: calibrations without a reference, of the feet of a robot that stood."""

from collections.abc import Callable
from functools import partial
from itertools import accumulate
from pathlib import Path
from typing import NamedTuple

import click
from rich.console import Console

import footsense
from footsense.calibration.evaluation import DesignModels
from footsense.calibration.standing.calibrate import StandingCalibration, calibrate_standing
from footsense.calibration.standing.recording import StandingLoads, StandingRecording, read_standing
from footsense.calibration.writer import check_calibration_target, write_calibration
from footsense.cli.tables import Column, echo_json, json_row, table
from footsense.cli.test_stand.design_models import load_design_models
from footsense.clock import wall_time_iso
from footsense.errors import CalibrationError
from footsense.estimation.network import Network
from footsense.foot.calibration_files import FootCalibration, Manifest, read_calibration
from footsense.progress import file_progress_bar
from footsense.recording.replay import Replay


class StandingRow(NamedTuple):
    """What standing told of one foot."""

    foot: str
    loads: StandingLoads
    result: StandingCalibration
    calibration: FootCalibration

    def values(self, name: str) -> list[float]:
        """Return a parameter of each element."""
        found: list[float] = getattr(self.result.parameters, name).round(4).tolist()
        return found


def _range_text(values: list[float], digits: int) -> str:
    return f"{min(values):.{digits}f} .. {max(values):.{digits}f}"


#: The feet of `footsense test-stand calibrate --no-reference`, in JSON and as a table.
STANDING_COLUMNS: list[Column[StandingRow]] = [
    Column("foot", lambda row: row.foot, "<1"),
    Column("n_loads", lambda row: len(row.loads), ">1", ("loads",)),
    Column("n_alike", lambda row: row.loads.n_alike, ">1", ("alike",)),
    Column("", lambda row: _range_text(row.values("stray_pf"), 2), ">1", ("strays [pF]",)),
    Column("", lambda row: _range_text(row.values("gain_rel"), 3), ">1", ("gains [1]",)),
    Column("stray_pf", lambda row: row.values("stray_pf")),
    Column("gain_rel", lambda row: row.values("gain_rel")),
    Column("gain_sigma_rel", lambda row: row.result.gain_sigma_rel.round(4).tolist()),
    Column("gap_um", lambda row: row.values("gap_um")),
    Column("turned_deg", lambda row: round(row.result.turned_deg, 3), ">.1f", ("forces turn by [deg]",)),
    Column(
        "unknown_deg",
        lambda row: round(row.result.predicted_uncertainty.median_direction_error_deg, 3),
        ">.2f",
        ("unknown [deg]",),
    ),
    Column("calibration", lambda row: str(row.calibration.folder)),
    Column("sha256", lambda row: row.calibration.manifest.sha256),
]


def calibrate_by_standing(
    recordings: tuple[Path, ...],
    foot: str | None,
    folder: Path,
    foot_type_folder: Path | None,
    *,
    replace: bool,
    as_json: bool,
) -> None:
    """Calibrate the feet of a robot that stood, and write each that its loads tell; the others are an error at the end.

    Args:
        recordings: Recordings of the robot.
        foot: The one foot that is wanted; None for every named one.
        folder: Folder of all calibrations.
        foot_type_folder: Folder of the models of the feet's type; None for the released one's.
        replace: Whether existing calibrations are replaced.
        as_json: Whether the result is printed as JSON.

    Raises:
        CalibrationError: A foot cannot be calibrated, or its calibration exists and is not to be replaced.
    """
    models, design, read = _read(recordings, foot, foot_type_folder)
    names = list(dict.fromkeys(name for one in read for name in one.feet))
    for name in names:
        check_calibration_target(folder / name, replace=replace)
    rows, failed = list[StandingRow](), list[str]()
    for name in names:
        parts = [one for one in read if name in one.feet]
        loads = StandingLoads.joined([one.feet[name] for one in parts])
        known = read_calibration(folder / name).parameters if (folder / name).exists() else None
        try:
            result = calibrate_standing(models, loads, known)
        except CalibrationError as error:
            failed.append(f"{name}: {error}")
            continue
        manifest = Manifest(
            foot=name,
            foot_type=models.response.foot_type,
            footsense=footsense.__version__,
            made=wall_time_iso(),
            n_loads=len(loads),
            n_sessions=len(parts),
            held_out=None,
            recordings={one.path.name: one.sha256 for one in parts},
            by_standing=True,
        )
        calibration = write_calibration(
            folder, manifest, result.parameters, design / "network.onnx", replace=replace
        )
        rows.append(StandingRow(name, loads, result, calibration))
    if as_json:
        echo_json([json_row(STANDING_COLUMNS, row) for row in rows])
    elif rows:
        console = Console(highlight=False)
        if not console.is_terminal:
            console.width = 200  # no line of a file or a pipe is folded
        console.print(table(STANDING_COLUMNS, rows))
        click.echo(
            f"written to {folder}; stiffness and mounting are as known before: no reading tells them",
            err=True,
        )
    if failed:
        raise CalibrationError("; ".join(failed))


def _read(
    recordings: tuple[Path, ...], foot: str | None, foot_type_folder: Path | None
) -> tuple[DesignModels, Path, list[StandingRecording]]:
    """Return the models of the feet's type, their folder, and the loads of the recordings.

    Raises:
        CalibrationError: The recordings are of different foot types.
    """
    foot_types = {path: Replay(path).header.get("foot_type", "") for path in recordings}
    if len(set(foot_types.values())) > 1:
        kinds = ", ".join(f"{path} of {foot_type!r}" for path, foot_type in foot_types.items())
        raise CalibrationError(f"the recordings are of different foot types: {kinds}")
    models, design = load_design_models(foot_types[recordings[0]], foot_type_folder)
    max_force_n = Network(design / "network.onnx", 1).card.max_trained_force_n
    with file_progress_bar("read", *recordings) as on_bytes_read:
        starts = accumulate((path.stat().st_size for path in recordings), initial=0)
        read = [
            read_standing(path, max_force_n, foot, partial(_report_bytes, on_bytes_read, start))
            for path, start in zip(recordings, starts, strict=False)
        ]
    return models, design, read


def _report_bytes(report: Callable[[float], None], n_before: int, n_read: int) -> None:
    report(n_before + n_read)
