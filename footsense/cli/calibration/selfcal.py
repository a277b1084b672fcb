"""Command `footsense selfcal`: find the electrodes of the feet while the robot walks, and watch them."""

import math
from collections.abc import Mapping, Sequence
from datetime import datetime
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import click

from footsense.calibration.evaluation import DesignModels
from footsense.calibration.selfcal.instants import LegScans
from footsense.calibration.selfcal.proposal import propose, proposed_feet, withdraw
from footsense.calibration.selfcal.state import (
    FootIdentity,
    SelfcalState,
    other_foot,
    read_state,
    state_path,
    write_state,
)
from footsense.calibration.selfcal.walking_foot import N_FAST, WalkingFoot
from footsense.cli.options import FILE, FOLDER, config_option, json_option, ring_option
from footsense.cli.tables import echo_json
from footsense.clock import stopwatch_ns, wall_time_iso
from footsense.config import DEFAULT, Config, load_config
from footsense.daemon.estimation import mounted_feet
from footsense.daemon.models import load_models
from footsense.daemon.recording_header import recorded_config, recorded_start
from footsense.daemon.setup.expected_error import electrodes_error_deg
from footsense.errors import CalibrationError
from footsense.estimation.network import Network
from footsense.foot.calibration_files import read_calibration
from footsense.foot.network_card import NETWORK_FILE
from footsense.foot.parameters import FootParameters
from footsense.foot.response_table import FootResponse
from footsense.foot.type_folders import foot_type_folder
from footsense.frames import Cycle
from footsense.progress import file_progress_bar
from footsense.recording.replay import Replay
from footsense.ring.following import follow_services
from footsense.telemetry.electrodes import STATE_FOLDER

#: Time between two judgements, of new feet and of others [s].
_NEW_PERIOD_S, _PERIOD_S = 60.0, 600.0
#: Cycles of a recording that are used at once.
_CHUNK = 1024


@click.command()
@config_option("all defaults")
@ring_option
@click.option("--recording", type=FILE, help="Read this recording once, instead of the ring of a service.")
@click.option(
    "--state",
    "state_folder",
    type=FOLDER,
    help=f"Folder of the states, and of what is proposed. Default: {STATE_FOLDER}; of a recording none.",
)
@json_option
def selfcal(
    config_file: Path | None,
    ring: Path | None,
    recording: Path | None,
    state_folder: Path | None,
    *,
    as_json: bool,
) -> None:
    """Say by how much the electrodes of each foot have changed since its calibration, while the robot walks.

    It reads the cycles of the running service, beside the loop, and finds strays, gains and gaps of all elements from
    a few instants of each stance. What it knows survives a restart in a file for each leg. Where a change is certain,
    or a walk knows more than an old calibration, it writes a calibration beside the state, which `footsense calibration
    accept` takes into use. The service may start, end and start again meanwhile.
    """
    if recording is not None:
        with file_progress_bar("read", recording) as on_bytes_read:
            replay = Replay(recording, on_bytes_read)
            robot = _Robot(recorded_config(replay), state_folder, recorded_start(replay))
            chunk: list[Cycle] = []
            for cycle in replay:
                chunk.append(cycle)
                if len(chunk) == _CHUNK:
                    robot.add(chunk)
                    chunk = []
            robot.add(chunk)
        robot.judge()
        if as_json:
            echo_json([robot.figures(foot) for foot in robot.feet])
        else:
            robot.tell()
        return
    config = load_config(config_file) if config_file else DEFAULT
    follow_services(
        ring or config.ring_path,
        lambda reader: _WalkingRobot(recorded_config(reader), state_folder or STATE_FOLDER),
    )


class _Robot:
    """The feet of a robot that walks, as the header of its ring or recording has them.

    Args:
        config: The robot.
        state_folder: Folder of the states; None to keep none.
        at: When they walk, as of `load_models`.
    """

    def __init__(self, config: Config, state_folder: Path | None, at: str | None = None) -> None:
        models = load_models(config, at)
        calibrations, mounted = models.calibrations_by_leg, mounted_feet(models)
        folder = foot_type_folder(config.foot_type)
        path = Path(config.model) if config.model else folder / NETWORK_FILE
        self._network = next((one.network for one in calibrations.values()), path)
        self._models = DesignModels(
            FootResponse.load(folder / "response.npz"),
            lru_cache(maxsize=8)(partial(Network, self._network)),
        )
        self._state_folder, self._at = state_folder, at
        names: Mapping[str, str] = dict(config.feet.items())
        self._told: dict[str, str] = {}
        self.feet: list[WalkingFoot] = []
        for row, leg in enumerate(config.legs):
            found = calibrations.get(leg)
            of = FootIdentity(
                leg=leg,  # type: ignore[arg-type]
                foot=names.get(leg, ""),
                foot_type=models.network.card.foot_type,
                board=config.board,
                calibration=found.manifest.sha256 if found else "",
                since=found.manifest.made if found else "",
            )
            known = FootParameters(
                stray_pf=mounted.stray_pf[row],
                unloaded_pf=mounted.unloaded_pf[row] + mounted.stray_pf[row],
                gap_um=mounted.gap_um[row],
            )
            expected_deg = electrodes_error_deg(models.uncertainties[row], found, models.at)
            self.feet.append(self._foot(of, found.parameters if found else known, expected_deg))
        self._calibrated_at_c = {leg: found.calibrated_at_c for leg, found in calibrations.items()}
        self._calibrations = Path(config.calibrations) if config.calibrations else None

    def _foot(self, of: FootIdentity, known: FootParameters, expected_deg: float) -> WalkingFoot:
        """Return a foot, with its state if there is one of it; another one is set aside."""
        path = None if self._state_folder is None else state_path(self._state_folder, of.leg)
        if path is None or not path.exists():
            return WalkingFoot(self._models, of, known, expected_deg)
        state: SelfcalState | None = None
        try:
            state = read_state(path)
            reason = other_foot(state, of)
        except CalibrationError as error:
            reason = str(error)
        if reason or state is None:
            kept = path.with_suffix(".json.old")
            path.replace(kept)
            click.echo(
                f"{of.leg}: begins anew, the state is not of this foot: {reason}; kept as {kept}", err=True
            )
            return WalkingFoot(self._models, of, known, expected_deg)
        slept = datetime.fromisoformat(wall_time_iso()) - datetime.fromisoformat(state.written)
        return WalkingFoot(
            self._models, of, known, expected_deg, state, max(slept.total_seconds(), 0.0) / 60.0
        )

    def add(self, cycles: Sequence[Cycle]) -> None:
        """Use further cycles."""
        if cycles:
            for foot, scans in zip(self.feet, LegScans.of_cycles(cycles), strict=True):
                foot.add(scans)

    def judge(self) -> None:
        """Judge all feet, keep their states, and propose what there is to propose."""
        for foot in self.feet:
            foot.judge()
            if self._state_folder is not None:
                write_state(self._state_folder, foot.state(wall_time_iso()))
                if not foot.is_proposed or self._is_replaced(foot.of):
                    withdraw(self._state_folder, foot.of.foot)
                elif foot.of.foot not in proposed_feet(self._state_folder):
                    calibrated_at_c = self._calibrated_at_c.get(foot.of.leg, math.nan)
                    made = self._at or wall_time_iso()
                    propose(self._state_folder, foot, self._network, calibrated_at_c, made)

    def _is_replaced(self, of: FootIdentity) -> bool:
        """Return whether another calibration of a foot waits for a restart of the service."""
        folder = self._calibrations and self._calibrations / of.foot
        return bool(folder and folder.exists() and read_calibration(folder).manifest.sha256 != of.calibration)

    def tell(self) -> None:
        """Print a line for each leg of which there is something new."""
        for foot in self.feet:
            line = line_of(foot)
            if self._told.get(foot.of.leg) != line:
                click.echo(line)
            self._told[foot.of.leg] = line

    def figures(self, foot: WalkingFoot) -> dict[str, Any]:
        """Return what is known of a foot as plain values."""
        turn = foot.turn
        return {
            "leg": foot.of.leg,
            "foot": foot.of.foot or None,
            "calibrated": foot.of.since or None,
            "n_instants": foot.n_instants,
            "turned_deg": turn and round(turn.deg, 3),
            "turned_sigma_deg": turn and round(turn.sigma_deg, 3),
            "is_proposed": foot.is_proposed,
            "objection": foot.objection or None,
        }


def line_of(foot: WalkingFoot) -> str:
    """Return what is known of a foot as one line for people."""
    name = f"{foot.of.leg} {foot.of.foot}".rstrip()
    since = f"since the calibration of {foot.of.since[:10]}" if foot.of.since else "against the design"
    if foot.turn is None:
        return f"{name}: no stances so far"
    deg, sigma_deg = foot.turn
    told = f"{name}: electrodes turned by {deg:.1f} +- {sigma_deg:.1f} deg {since}"
    if foot.objection:
        return f"{told}; nothing proposed: {foot.objection}"
    if not foot.of.foot:
        return f"{told}; a foot needs a name under `feet` before a calibration is proposed"
    expected_deg = max(math.hypot(deg, sigma_deg), foot.expected_deg)
    return f"{told}; a calibration is proposed: {expected_deg:.1f} to {sigma_deg:.1f} deg expected"


class _WalkingRobot(_Robot):
    """The same robot while it walks: judged after a minute, and then every ten once its feet are known."""

    def __init__(self, config: Config, state_folder: Path) -> None:
        super().__init__(config, state_folder)
        self._judged_ns, self._is_new = stopwatch_ns(), True

    def add(self, cycles: Sequence[Cycle]) -> None:
        """Use further cycles; judge, keep and tell in time."""
        super().add(cycles)
        if 1e-9 * (stopwatch_ns() - self._judged_ns) >= (_NEW_PERIOD_S if self._is_new else _PERIOD_S):
            self._judged_ns = stopwatch_ns()
            self._is_new = any(foot.n_instants < N_FAST for foot in self.feet)
            self.judge()
            self.tell()

    def end(self) -> None:
        """Judge and keep what is known now."""
        self.judge()
