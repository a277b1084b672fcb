"""Part of `footsense test-stand calibrate`: calibrations without a reference, of the feet of a robot that stood."""

from collections.abc import Callable, Sequence
from dataclasses import replace as replace_fields
from functools import partial
from itertools import accumulate
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np
from rich.console import Console

import footsense
from footsense.calibration.evaluation import DesignModels
from footsense.calibration.standing.calibrate import StandingCalibration, calibrate_standing
from footsense.calibration.standing.recording import StandingLoads, StandingRecording, read_standing
from footsense.calibration.standing.weight import sizes_by_weight
from footsense.calibration.twin import GAIN
from footsense.calibration.writer import check_calibration_target, write_calibration
from footsense.cli.tables import Column, echo_json, json_row, table
from footsense.cli.test_stand.design_models import load_design_models
from footsense.clock import wall_time_iso
from footsense.errors import CalibrationError
from footsense.estimation.network import Network
from footsense.foot.calibration_files import FootCalibration, Manifest, read_calibration
from footsense.progress import file_progress_bar
from footsense.recording.replay import Replay
from footsense.sim.fabrication import size_sigma_rel


class StoodFoot(NamedTuple):
    """Result of standing for one foot."""

    foot: str
    loads: StandingLoads
    result: StandingCalibration


class StandingRow(NamedTuple):
    """The same, and what was written of it."""

    foot: str
    loads: StandingLoads
    result: StandingCalibration
    calibration: FootCalibration

    @property
    def size_text(self) -> str:
        """Size of its forces over that of a foot as designed."""
        of = self.result.parameters
        return f"{1.0 + of.stiffness_rel:.2f} +- {size_sigma_rel(of) or of.error_rel:.2f}"

    @property
    def gain_sigma_rel(self) -> list[float]:
        """Standard deviation of the gain of each element [1], of which they have a part in common."""
        variance = np.diag(self.result.fit.electrodes.covariance)[GAIN]
        found: list[float] = np.sqrt(variance).round(4).tolist()
        return found

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
    Column("gain_sigma_rel", lambda row: row.gain_sigma_rel),
    Column("gap_um", lambda row: row.values("gap_um")),
    Column("stiffness_rel", lambda row: round(row.result.parameters.stiffness_rel, 4)),
    Column("size_sigma_rel", lambda row: round(row.result.parameters.size_sigma_rel, 4)),
    Column("", lambda row: row.size_text, ">1", ("size [1]",)),
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
    mass_kg: float | None,
    replace: bool,
    as_json: bool,
) -> None:
    """Calibrate the feet of a robot that stood, and write each that its loads identify; others are an error at the end.

    Args:
        recordings: Recordings of the robot.
        foot: The one foot that is wanted; None for every named one.
        folder: Folder of all calibrations.
        foot_type_folder: Folder of the models of the feet's type; None for the released one's.
        mass_kg: Mass of the robot, whose weight gives the sizes of the forces [kg]; None if they stay as known.
        replace: Whether existing calibrations are replaced.
        as_json: Whether the result is printed as JSON.

    Raises:
        CalibrationError: A foot cannot be calibrated, or its calibration exists and is not to be replaced.
    """
    models, design, read = _read(recordings, foot, foot_type_folder)
    names = list(dict.fromkeys(name for one in read for name in one.feet))
    for name in names:
        check_calibration_target(folder / name, replace=replace)
    stood, failed = list[StoodFoot](), list[str]()
    for name in names:
        loads = StandingLoads.joined([one.feet[name] for one in read if name in one.feet])
        known = read_calibration(folder / name).parameters if (folder / name).exists() else None
        try:
            stood.append(StoodFoot(name, loads, calibrate_standing(models, loads, known)))
        except CalibrationError as error:
            failed.append(f"{name}: {error}")
    if mass_kg is not None and not failed:
        stood = _weighed(models, read, stood, mass_kg)
    rows = list[StandingRow]()
    for name, loads, result in stood if mass_kg is None or not failed else []:
        parts = [one for one in read if name in one.feet]
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
            f"written to {folder}; "
            + ("stiffness and mounting are" if mass_kg is None else "mounting is")
            + " as known before: no reading tells it",
            err=True,
        )
    if failed:
        raise CalibrationError("; ".join(failed))


def _weighed(
    models: DesignModels, read: Sequence[StandingRecording], stood: Sequence[StoodFoot], mass_kg: float
) -> list[StoodFoot]:
    """Return the feet with the sizes that follow from the robot's weight.

    Raises:
        CalibrationError: Some of its feet have no name or were left out, or the sums of the forces are not its weight.
    """
    names = [one.foot for one in stood]
    for one in read:
        if set(one.feet) != set(names) or len(names) != one.n_legs:
            raise CalibrationError(
                f"{one.path}: {len(one.feet)} of the robot's {one.n_legs} feet are named or wanted, and all of them "
                "carry its weight: name each under `feet`, and leave out --foot"
            )
    sizes = sizes_by_weight(
        models,
        [[one.feet[name] for name in names] for one in read],
        [one.result.parameters for one in stood],
        mass_kg,
    )
    if sizes.doubt:
        click.echo(f"warning: {sizes.doubt}", err=True)
    weighed = []
    for foot, size_rel, sigma_rel in zip(stood, sizes.size_rel, sizes.sigma_rel, strict=True):
        known = foot.result.parameters
        parameters = replace_fields(
            known,
            stiffness_rel=float(size_rel) * (1.0 + known.stiffness_rel) - 1.0,
            size_sigma_rel=float(sigma_rel),
        )
        weighed.append(foot._replace(result=foot.result._replace(parameters=parameters)))
    return weighed


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
