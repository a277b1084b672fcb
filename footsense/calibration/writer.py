"""Write a calibration folder atomically: complete under its final name, or not at all.

The files are made in a folder beside, read back as the robot reads them, and only then get the name. An existing
calibration is kept under the first free number, `foot-0007.1`, and only replaced on request.
"""

import hashlib
import math
import os
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np

from footsense.errors import CalibrationError
from footsense.foot import calibration_files
from footsense.foot.calibration_files import FootCalibration, Manifest, Parameters, read_calibration
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.network_card import verified_sha256
from footsense.foot.parameters import FootParameters
from footsense.regular_file import open_regular, read_regular

_MN_PER_GF = 1e3 * GRAM_FORCE_N


#: What a calibration without a reference does not know.
_WITHOUT_REFERENCE = """,
without a reference: of a robot that {}. Stiffness and mounting are those known before, or the design's"""


def card_text(manifest: Manifest, parameters: Parameters) -> str:
    """Return the summary of a calibrated foot as Markdown.

    Args:
        manifest: Its manifest; the hashes of the files are not used.
        parameters: Its parameters.
    """
    recordings = "\n".join(f"| {name} | `{sha256}` |" for name, sha256 in manifest.recordings.items())
    n_loads = _count_with_plural(manifest.n_loads, "load")
    n_sessions = _count_with_plural(manifest.n_sessions, "session")
    known_c = parameters.temperature_c
    temperature = ", at an unknown temperature" if known_c is None else f", at {known_c:.1f} degC"
    without = "walked" if manifest.by_walking else "stood" if manifest.by_standing else ""
    strayed = "stray capacitance, wiring of the test stand included [pF]"
    return f"""# {manifest.foot}

A foot of type {manifest.foot_type}, calibrated {manifest.made} by footsense {manifest.footsense}
on {n_loads} in {n_sessions}{temperature}{_WITHOUT_REFERENCE.format(without) if without else ""}. The
robot uses these files unchanged, or not at all: it detects and refuses every edit by hand.

## Errors

{_error_table(manifest)}

## How it differs from its design

| | front row on top, left column left | |
|---|---|---|
{_element_values_row("air gap [um]", parameters.gap_um, 2)}
{_element_values_row("reads unloaded [pF]", parameters.unloaded_pf, 3)}
{_element_values_row(strayed, parameters.stray_pf, 3)}
{_element_values_row("gain of the closure [1]", parameters.gain_rel, 3)}

Stiffness {parameters.stiffness_rel:+.1%}; mounted {_mount_angle_deg(parameters):.1f} deg off. Unexplained by the
calibration: {parameters.error_rel:.1%} of the force.

## Origin

Network `{parameters.network_sha256}`, training set `{manifest.recordings_sha256}`:

| recording | SHA-256 |
|---|---|
{recordings}
"""


def _count_with_plural(n: int, what: str) -> str:
    """Return a count with its noun as text, in the plural unless it is 1."""
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


def _error_table(manifest: Manifest) -> str:
    held_out = manifest.held_out
    if held_out is None:
        return "Unknown: no load was held out."
    rows = [
        f"| {name} | {e.direction_deg:.2f} / {e.direction_p95_deg:.2f} / {e.direction_max_deg:.2f} | "
        f"{' / '.join(f'{_MN_PER_GF * gf:.1f}' for gf in (e.magnitude_gf, e.magnitude_p95_gf, e.magnitude_max_gf))} |"
        for name, e in (
            ("network of the design alone", held_out.design_only),
            ("with this calibration", held_out.calibrated),
        )
    ]
    return f"""{held_out.protocol}, {_count_with_plural(held_out.calibrated.n, "load")}:

| mean / p95 / largest | direction [deg] | magnitude [mN] |
|---|---:|---:|
{chr(10).join(rows)}"""


def _element_values_row(what: str, values: Sequence[float], digits: int) -> str:
    """Return one row of a Markdown table with a value per element."""
    rows = [" ".join(f"{value:.{digits}f}" for value in values[i : i + 3]) for i in (0, 3, 6)]
    return f"| {what} | {'<br>'.join(rows)} | mean {np.mean(values):.{digits}f} |"


def _mount_angle_deg(parameters: Parameters) -> float:
    """Return the angle of the fitted mounting rotation [deg]."""
    return float(np.degrees(np.arccos(np.clip((np.trace(parameters.mount) - 1.0) / 2.0, -1.0, 1.0))))


def file_sha256(path: Path) -> str:
    """Return the SHA-256 of a file as hexadecimal digits; reads it in blocks.

    Raises:
        CalibrationError: It cannot be read.
    """
    try:
        with os.fdopen(open_regular(path), "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be read: {error.strerror}") from None


def check_calibration_target(folder: Path, *, replace: bool) -> None:
    """Raise an error if a calibration cannot be written to `folder`; creates nothing.

    Raises:
        CalibrationError: Its name is not that of a foot; it exists and is not to be replaced; or its parent cannot be
            written to.
    """
    try:
        msgspec.convert(folder.name, calibration_files.FootId)
    except msgspec.ValidationError:
        raise CalibrationError(f"{folder.name}: is no identity of a foot, such as foot-0007") from None
    if folder.exists() and not replace:
        raise CalibrationError(
            f"{folder}: exists and is not overwritten; with --replace the old one is kept as "
            f"{_free_backup_path(folder).name}"
        )
    parent = next(parent for parent in folder.parents if parent.exists())
    try:
        tempfile.TemporaryDirectory(dir=parent, prefix=f".{folder.name}.").cleanup()
    except OSError as error:
        raise CalibrationError(f"{parent}: cannot be written to: {error.strerror}") from None


def write_calibration(
    calibrations: Path,
    manifest: calibration_files.Manifest,
    parameters: FootParameters,
    network: Path,
    *,
    temperature_c: float | None = None,
    replace: bool = False,
) -> FootCalibration:
    """Write a calibration folder, and return the calibration as loaded back from it.

    Args:
        calibrations: Folder of all calibrations, created if missing.
        manifest: Its manifest; the hashes of its files are filled in.
        parameters: Parameters of the foot.
        network: File of the network that they were fitted on, with its checksum.
        temperature_c: Temperature of the foot on the test stand [degC]; None or NaN if not measured.
        replace: Whether an existing calibration of this foot is replaced.

    Raises:
        CalibrationError: It exists and must not be replaced, or cannot be written.
        ModelError: The network is none, or the robot would refuse the result.
    """
    folder = calibrations / manifest.foot
    check_calibration_target(folder, replace=replace)
    try:
        content = read_regular(network)
        described = calibration_files.Parameters(
            format=calibration_files.FORMAT,
            network_sha256=verified_sha256(content, str(network)),
            temperature_c=None if temperature_c is None or math.isnan(temperature_c) else temperature_c,
            **parameters.as_lists(),
        )
        files = {
            calibration_files.PARAMETERS: _to_json(described),
            calibration_files.NETWORK: content,
            calibration_files.CARD: card_text(manifest, described).encode(),
        }
        hashes = {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}
        manifest = msgspec.structs.replace(manifest, files=hashes)
        manifest = msgspec.structs.replace(manifest, sha256=manifest.computed_sha256)
        calibrations.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(dir=calibrations, prefix=f".{manifest.foot}."))
        try:
            draft.chmod(0o755)  # the service runs as another user
            for name, data in {**files, calibration_files.MANIFEST: _to_json(manifest)}.items():
                (draft / name).write_bytes(data)
                _fsync(draft / name)
            _fsync(draft)
            read_calibration(draft, manifest.foot_type, manifest.foot)
            if folder.exists():
                folder.rename(_free_backup_path(folder))
            draft.rename(folder)
        finally:
            shutil.rmtree(draft, ignore_errors=True)
        _fsync(calibrations)
    except OSError as error:
        raise CalibrationError(f"{folder}: cannot be written: {error.strerror}") from None
    return read_calibration(folder, manifest.foot_type)


def revert_calibration(calibrations: Path, foot: str) -> FootCalibration:
    """Take the newest kept calibration of a foot back into use, and keep the present one in its place.

    Args:
        calibrations: Folder of all calibrations.
        foot: The foot.

    Raises:
        CalibrationError: None is kept, or a folder cannot be renamed.
        ModelError: The kept one is damaged.
    """
    folder = calibrations / foot
    kept = [path for path in calibrations.glob(f"{foot}.*") if path.suffix[1:].isdecimal()]
    if not kept or not folder.exists():
        raise CalibrationError(f"{folder}: no former calibration is kept beside it")
    former = max(kept, key=lambda path: int(path.suffix[1:]))
    read_calibration(former)
    between = folder.with_name(f".{foot}.revert")
    try:
        folder.rename(between)
        former.rename(folder)
        between.rename(former)
        _fsync(calibrations)
    except OSError as error:
        raise CalibrationError(f"{folder}: cannot be exchanged: {error.strerror}") from None
    return read_calibration(folder)


def _free_backup_path(folder: Path) -> Path:
    """Return the first unused path to which the replaced calibration can be renamed."""
    number = 1
    while (kept := folder.with_name(f"{folder.name}.{number}")).exists():
        number += 1
    return kept


def _to_json(value: msgspec.Struct) -> bytes:
    """Return a struct as indented JSON."""
    return msgspec.json.format(msgspec.json.encode(value), indent=2) + b"\n"


def _fsync(path: Path) -> None:
    """Flush a file or folder to disk, so that a power cut leaves no name without content."""
    fd = os.open(path, os.O_RDONLY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)
