"""Command `footsense info`: what a file of footsense is and holds, or what is installed here."""

import hashlib
import os
import platform
import re
from collections import Counter, defaultdict
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Any

import click
import numpy as np

import footsense
from footsense.cli.file_kinds import kind_of_text
from footsense.cli.options import FILE
from footsense.cli.tables import echo_figures, errors_text
from footsense.daemon.setup.expected_error import error_text, uncertainty_of_calibrated
from footsense.errors import FootsenseError, RecordingError
from footsense.estimation.network import Network
from footsense.foot.calibration_files import MANIFEST, Manifest, read_calibration
from footsense.foot.response_table import FootResponse
from footsense.frames import FAULT_FREE, Cause, ContactFrame, Flag, State
from footsense.leg_words import word_of
from footsense.progress import file_progress_bar
from footsense.recording.fault_recordings import fault_recordings
from footsense.recording.machine import platform_versions
from footsense.recording.replay import Replay
from footsense.regular_file import open_regular
from footsense.ring.records import LostCycles, leg_entries

_NS_PER_S = 1_000_000_000
#: Versions in the header of a recording, on which the bits of the forces depend.
_LIBRARIES = ("libc", "blas", "python", "numpy", "onnxruntime")


@click.command()
@click.argument("file", type=FILE, required=False)
def info(file: Path | None) -> None:
    """Say what FILE is and what is in it; without it, what is installed here.

    FILE is a recording (.mcap), a network (.onnx), a response table (.npz), or the folder of a foot's calibration, or
    of the recordings of faults that `footsense snapshot --of-faults` keeps.
    A report of a defect has the output of `footsense info`, and that for its recording.
    """  # noqa: DOC501 - click shows this text
    if file is None:
        echo_figures(_installed(), as_json=False)
        return
    if file.is_dir() and (recordings := fault_recordings(file)):
        for recording in recordings:
            click.echo(f"{recording}  {recording.stat().st_size / 1e6:.1f} MB")
        return
    if file.is_dir() or file.name == MANIFEST:
        _print_calibration(file if file.is_dir() else file.parent)
        return
    try:
        with os.fdopen(open_regular(file), "rb") as stream:
            begin = stream.read(8)
    except OSError as error:
        raise RecordingError(f"{file}: cannot be read: {error.strerror}") from None
    for magic, print_file in _KINDS.items():
        if begin.startswith(magic):
            print_file(file)
            return
    if (kind := kind_of_text(file)) is not None:
        raise FootsenseError(f"{file}: is {kind[0]}: {kind[1]}")
    raise FootsenseError(f"{file}: is no recording, network, response table or calibration")


def _installed() -> dict[str, Any]:
    """Return the versions of footsense, of what it runs on, and of each package that it can use, where installed."""
    found: dict[str, Any] = {"footsense": footsense.__version__, "platform": platform.platform()}
    found |= platform_versions()
    for requirement in (*(requires("footsense") or ()), *(requires("footsense-client") or ())):
        name = re.split(r"[^\w.-]", requirement)[0]
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


@dataclass
class _Contents:
    """What the cycles of a recording hold.

    Attributes:
        n_cycles: Cycles.
        n_lost: Cycles that were lost when it was recorded.
        flags: Flags of any leg in any cycle.
        first_ns: Time of the first cycle [ns].
        last_ns: Time of the last one [ns].
        begin_ns: First time of each fault [ns], by row, state and cause.
        total_ns: Its duration in all [ns]: each time up to the next cycle, so that nothing is behind the last one.
        present: Faults of the last cycle.
    """

    n_cycles: int = 0
    n_lost: int = 0
    flags: int = 0
    first_ns: int = 0
    last_ns: int = 0
    begin_ns: dict[tuple[int, State, Cause], int] = field(default_factory=dict)
    total_ns: Counter[tuple[int, State, Cause]] = field(default_factory=Counter)
    present: list[tuple[int, State, Cause]] = field(default_factory=list)

    def add(self, forces: ContactFrame) -> None:
        """Add the next cycle."""
        t_ns = forces.t_sent_ns
        if not self.n_cycles:
            self.first_ns = self.last_ns = t_ns
        for fault in self.present:
            self.total_ns[fault] += t_ns - self.last_ns
        faulty = forces.cause.astype(bool) | ~_IS_FAULT_FREE[forces.state]
        self.present = [
            (row, State(int(forces.state[row])), Cause(int(forces.cause[row])))
            for row in faulty.nonzero()[0].tolist()
        ]
        for fault in self.present:
            self.begin_ns.setdefault(fault, t_ns)
        self.flags |= int(np.bitwise_or.reduce(forces.flags))
        self.n_cycles, self.last_ns = self.n_cycles + 1, t_ns

    def faults(self, legs: tuple[str, ...]) -> dict[str, str]:
        """Return the faults of each leg in words."""
        texts = defaultdict(list)
        for (row, state, cause), begin_ns in self.begin_ns.items():
            why = f" ({word_of(cause)})" if cause else ""
            begin_s = (begin_ns - self.first_ns) / _NS_PER_S
            total_s = self.total_ns[row, state, cause] / _NS_PER_S
            texts[f"faults of {legs[row]}"].append(
                f"{word_of(state)}{why} for {total_s:.2f} s, first at {begin_s:.2f} s"
            )
        return {leg: "; ".join(parts) for leg, parts in sorted(texts.items())} or {"faults": "none"}


_IS_FAULT_FREE = np.isin(np.arange(256), list(FAULT_FREE))


def _print_recording(file: Path) -> None:
    """Print what a recording holds, as far as it is whole.

    Raises:
        RecordingError: It is damaged, or cut short.
    """
    contents, damage = _Contents(), None
    with file_progress_bar("read", file) as on_bytes_read:
        replay = Replay(file, on_bytes_read)
        try:
            for entry in replay.entries():
                if isinstance(entry, LostCycles):
                    contents.n_lost += entry.n_cycles
                else:
                    contents.add(entry.cycle.forces)
        except RecordingError as error:
            damage = error
    header = replay.header
    duration_s = (contents.last_ns - contents.first_ns) / _NS_PER_S
    with os.fdopen(open_regular(file), "rb") as stream:
        sha256 = hashlib.file_digest(stream, "sha256").hexdigest()
    _print_figures(
        "recording",
        file,
        {
            "sha256": sha256,
            "started": header.get("started"),
            "duration_s": duration_s,
            "cycles": contents.n_cycles,
            "cycle_rate_hz": (contents.n_cycles - 1) / duration_s if duration_s else None,
            "lost_cycles": contents.n_lost,
            "legs": list(replay.legs),
            "simulated": bool(contents.flags & Flag.SIMULATED),
            "timing_degraded": bool(contents.flags & Flag.DEGRADED_TIMING),
            "feet": header.get("feet") or "none named",
            "foot_type": header.get("foot_type"),
            "network_sha256": header.get("model_sha256"),
            "calibrations_sha256": leg_entries(header, "calibrations") or "none",
            **{name: header.get(name) for name in ("footsense", "processor", *_LIBRARIES)},
            **contents.faults(replay.legs),
        },
    )
    if damage is not None:
        raise damage


def _print_network(file: Path) -> None:
    network = Network(file, n_rows=1)
    _print_figures(
        "network",
        file,
        {
            "sha256": network.sha256,
            "foot_type": network.card.foot_type,
            "largest_force_n": network.card.max_trained_force_n,
            "response_sha256": network.card.response_sha256,
        },
    )


def _print_response_table(file: Path) -> None:
    response = FootResponse.load(file)
    _print_figures(
        "response table",
        file,
        {
            "sha256": response.sha256,
            "foot_type": response.foot_type,
            "ball_radius_mm": response.ball_radius_mm,
            "lowest_elevation_deg": response.min_elevation_deg,
        },
    )


def _print_calibration(folder: Path) -> None:
    calibration = read_calibration(folder)
    manifest = calibration.manifest
    held_out = manifest.held_out
    _print_figures(
        "calibration",
        folder,
        {
            "sha256": manifest.sha256,
            "foot": manifest.foot,
            "foot_type": manifest.foot_type,
            "made": manifest.made,
            "footsense": manifest.footsense,
            "loads": manifest.n_loads,
            "sessions": manifest.n_sessions,
            "reference": _reference_text(manifest),
            "held_out": held_out and held_out.protocol,
            "as designed": held_out and errors_text(held_out.design_only),
            "calibrated": held_out and errors_text(held_out.calibrated),
            "expected error when made": error_text(uncertainty_of_calibrated(calibration)),
            "calibrated_at_c": calibration.calibrated_at_c,
            "network_sha256": calibration.network_sha256,
            "recordings_sha256": manifest.recordings,
        },
    )


def _reference_text(manifest: Manifest) -> str:
    if manifest.by_walking:
        return "none: of a robot that walked"
    return "none: of a robot that stood" if manifest.by_standing else "a force sensor"


def _print_figures(kind: str, path: Path, figures: dict[str, Any]) -> None:
    """Print the kind of a file, and its figures."""
    echo_figures({"file": str(path), "kind": kind} | figures, as_json=False)


#: How each kind of file begins, and what prints it; an ONNX file has the field of its format's version first.
_KINDS = {
    b"\x89MCAP0\r\n": _print_recording,
    b"PK\x03\x04": _print_response_table,
    b"\x08": _print_network,
}
