"""Header of a recording (configuration, scene, flags, network, calibrations): written by a run, read by a replay."""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from footsense import __version__
from footsense.clock import wall_time_ns
from footsense.config import Config
from footsense.config.schema import gone_board
from footsense.daemon.estimation import mounted_feet
from footsense.daemon.models import Models
from footsense.errors import RecordingError
from footsense.frames import ELEMENTS, Flag
from footsense.recording.machine import platform_versions
from footsense.ring.records import leg_entries
from footsense.sim.scene import Scene

if TYPE_CHECKING:
    from footsense.recording.replay import Replay  # a run needs no reader of recordings
    from footsense.ring.cycle_reader import CycleReader

_CALIBRATIONS_KEY = "calibrations"
_STARTED_KEY = "started"
#: Key of the parameters that convert readings into gap closures; older recordings lack it.
_CLOSURE_CONVERSION_KEY = "elements"


def recording_header(models: Models, scene: Scene | None, flags: Flag, now_ns: int) -> dict[str, str]:
    """Return the header of a new recording; `now_ns` is the start on the clock of its time stamps."""
    config, network = models.config, models.network
    hashes = (
        f"{leg}={calibration.manifest.sha256}" for leg, calibration in models.calibrations_by_leg.items()
    )
    return {
        "footsense": __version__,
        _STARTED_KEY: models.at,
        "wall_offset_ns": str(wall_time_ns() - now_ns),
        "config": msgspec.json.encode(config).decode(),
        "scene": msgspec.json.encode(scene).decode() if scene else "",
        "flags": str(int(flags)),
        "model_sha256": network.sha256,
        "foot_type": network.card.foot_type,
        "feet": ",".join(f"{leg}={foot}" for leg, foot in config.feet.items()),
        _CALIBRATIONS_KEY: ",".join(hashes),
        **platform_versions(),
        _CLOSURE_CONVERSION_KEY: msgspec.json.encode(closure_conversion(models)).decode(),
    }


class ClosureConversion(msgspec.Struct, frozen=True):
    """Parameters that convert readings into gap closures: stray, and plate distance times capacitance.

    Attributes:
        stray_pf: Capacitance in parallel with each element [pF], shape (legs, elements).
        distance_times_capacitance_pf: Distance of the plates over the gap, times capacitance without stray [pF],
            shape (legs, elements).
    """

    stray_pf: list[list[float]]
    distance_times_capacitance_pf: list[list[float]] = msgspec.field(name="distance_pf")


def closure_conversion(models: Models) -> ClosureConversion:
    """Return the parameters that convert a robot's readings into gap closures."""
    feet = mounted_feet(models)
    distance_pf = feet.distance_times_capacitance_pf(models.network.card.trained_inputs.design)
    return ClosureConversion(feet.stray_pf.tolist(), distance_pf.tolist())


def recorded_closure_conversion(header: Mapping[str, str], legs: Sequence[str]) -> ClosureConversion:
    """Return the parameters in the header of a ring or recording.

    Raises:
        ValueError: It has none, or those of other legs.
    """
    try:
        found = msgspec.json.decode(header[_CLOSURE_CONVERSION_KEY], type=ClosureConversion)
    except KeyError:
        raise ValueError("it does not tell how to compute closures") from None
    for values in (found.stray_pf, found.distance_times_capacitance_pf):
        if np.shape(values) != (len(legs), ELEMENTS):
            raise ValueError("its elements are those of other legs")
    return found


def recorded_flags(recording: "Replay") -> int:
    """Return the flags that every frame of a recording has; 0 if its header does not name any.

    Raises:
        RecordingError: The header's flags are not a number from 0 to 255.
    """
    text = recording.header.get("flags", "0")
    if text not in map(str, range(0x100)):
        raise RecordingError(f"{recording.path}: the flags of its header are {text[:20]!r}, not 0 to 255")
    return int(text)


def recorded_start(recording: "Replay") -> str | None:
    """Return when the service of a recording started, UTC, ISO 8601; None if its header does not tell.

    Raises:
        RecordingError: It tells no time.
    """
    text = recording.header.get(_STARTED_KEY)
    try:
        return text and datetime.strptime(text, "%Y-%m-%dT%H:%M:%S%z").astimezone(UTC).isoformat()[:-6] + "Z"
    except (ValueError, OverflowError):
        raise RecordingError(f"{recording.path}: the start in its header is {text!r:.40}, no time") from None


def recorded_config(recording: "Replay | CycleReader") -> Config:
    """Return the configuration of a recording or ring, with CAN replaced by a virtual one, and without scheduling.

    Raises:
        RecordingError: The header has no configuration that this version reads, or one of a board that is gone, or of
            other legs.
    """
    try:
        recorded = msgspec.json.decode(recording.header["config"], type=dict[str, Any])
        if gone := gone_board(recorded):
            raise RecordingError(f"{recording.path}: {gone}")
        config = msgspec.convert(recorded | {"can": {"interface": "virtual"}, "realtime": None}, Config)
    except (KeyError, msgspec.DecodeError, RecursionError) as error:
        raise RecordingError(
            f"{recording.path}: no configuration that this version reads: {error}"
        ) from error
    if config.legs != recording.legs:
        then, now = ", ".join(recording.legs), ", ".join(config.legs)
        raise RecordingError(f"{recording.path}: holds the legs {then}, but a configuration of {now}")
    return config


def model_mismatch_reason(header: Mapping[str, str], models: Models) -> str | None:
    """Return why a replay cannot reproduce the recorded forces; None if network and calibrations match.

    Args:
        header: Header of the recording; without calibrations in it, it was made without.
        models: Network and calibrations used now.
    """
    recorded = header.get("model_sha256", "unknown")
    if recorded != models.network.sha256:
        return (
            f"recorded with network {recorded[:12]}, here is {models.network.sha256[:12]}; "
            "only the same network can give the same forces"
        )
    recorded_with = leg_entries(header, _CALIBRATIONS_KEY)
    then = {leg: f"the calibration {sha256[:12]}" for leg, sha256 in recorded_with.items()}
    here = {
        leg: f"the calibration {found.manifest.sha256[:12]}"
        for leg, found in models.calibrations_by_leg.items()
    }
    for leg in sorted(then.keys() | here.keys()):
        if then.get(leg) != here.get(leg):
            return (
                f"{leg} was recorded with {then.get(leg, 'no calibration')}, here is "
                f"{here.get(leg, 'no calibration')}; only the same calibrations give the same forces, "
                "--calibrations names their folder"
            )
    return None
