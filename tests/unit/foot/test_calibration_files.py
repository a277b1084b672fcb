"""A calibration is whole and its own foot's, or it is refused with one line."""

import dataclasses
import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from footsense.calibration.writer import check_calibration_target, write_calibration
from footsense.daemon.foot_types import DEFAULT_FOOT_TYPE, released_path
from footsense.errors import CalibrationError, FootsenseError, ModelError
from footsense.foot.calibration_files import Manifest, read_calibration
from footsense.foot.network_card import add_checksum
from tests.support.calibrations import calibration, content, parameters


def reseal(folder: Path, **changed: Any) -> None:
    """Change entries of a manifest and its own hash with them; the files' hashes are made anew."""
    found = msgspec.json.decode((folder / "manifest.json").read_bytes(), type=Manifest)
    files = {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in found.files}
    found = msgspec.structs.replace(found, **{"files": files, **changed})
    found = msgspec.structs.replace(found, sha256=found.computed_sha256)
    (folder / "manifest.json").write_bytes(msgspec.json.encode(found))


def set_parameter(folder: Path, **changed: Any) -> None:
    """Change parameters, hashes and all."""
    file = folder / "parameters.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), **changed}))
    reseal(folder)


def change_byte(file: Path, old: bytes, new: bytes) -> None:
    data = file.read_bytes()
    assert old in data
    file.write_bytes(data.replace(old, new, 1))


def other_network(folder: Path) -> None:
    """Put a network there that is one, but not the one."""
    content = released_path("network.onnx").read_bytes()[:-86]
    (folder / "network.onnx").write_bytes(add_checksum(content + b"\x72\x04\x0a\x00\x12\x00"))
    reseal(folder)


def test_what_is_written_is_read(tmp_path: Path) -> None:
    """Every parameter comes back bit for bit, and the manifest says of what the calibration was made."""
    feet = tmp_path / "feet"
    written = calibration(feet)
    again = read_calibration(feet / "foot-0007", DEFAULT_FOOT_TYPE)
    for field in dataclasses.fields(parameters()):
        assert np.array_equal(getattr(again.parameters, field.name), getattr(parameters(), field.name))
    assert again.manifest == written.manifest
    assert again.manifest.held_out == content()["manifest"].held_out
    assert (
        again.network_sha256 == hashlib.sha256(released_path("network.onnx").read_bytes()[:-86]).hexdigest()
    )
    assert again.calibrated_at_c == 23.5
    assert {entry.name for entry in feet.iterdir()} == {"foot-0007"}, "nothing is left beside it"
    assert (feet / "foot-0007").stat().st_mode & 0o777 == 0o755, "the service is another user"
    card = (feet / "foot-0007" / "card.md").read_text()
    for said in (
        "362 loads in 3 sessions",
        "15.90 / 30.00 / 40.00",
        "| direction [deg] | magnitude [mN] |",
        "4.0 deg off",
        again.manifest.recordings_sha256,
    ):
        assert said in card


@pytest.mark.parametrize(
    ("harm", "said"),
    [
        (shutil.rmtree, "foot-0007: no such calibration; `footsense test-stand calibrate` makes one"),
        (
            lambda folder: (folder / "manifest.json").unlink(),
            "manifest.json: missing; a calibration is used whole",
        ),
        (
            lambda folder: change_byte(folder / "parameters.json", b"0.07", b"0.08"),
            "parameters.json: does not match its hash in manifest.json: edited by hand",
        ),
        (
            lambda folder: change_byte(folder / "manifest.json", b'"n_loads": 362', b'"n_loads": 363'),
            "manifest.json: does not match its own hash: edited by hand",
        ),
        (
            lambda folder: change_byte(folder / "manifest.json", b'"format": 3', b'"format": 1'),
            "manifest.json: calibration format 1, this version reads format 3",
        ),
        (
            lambda folder: change_byte(folder / "manifest.json", b"2026-", b"0000-"),
            "manifest.json: does not fit: year 0 is out of range",
        ),
        (
            lambda folder: reseal(folder, foot="foot-0008"),
            "foot-0007: the calibration of foot-0008, not of foot-0007",
        ),
        (
            lambda folder: reseal(folder, foot_type="other-4x4"),
            "foot-0007: for foot type 'other-4x4', this robot's feet are 'aoyagi-3x3'",
        ),
        (lambda folder: reseal(folder, files={}), "manifest.json: lists"),
        (other_network, "but the parameters were fitted on"),
        (
            lambda folder: set_parameter(folder, mount=[[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]]),
            "mount: is no rotation",
        ),
        (lambda folder: set_parameter(folder, temperature_c=126.0), "parameters.json: does not fit: "),
    ],
)
def test_what_is_wrong_is_said(tmp_path: Path, harm: Callable[[Path], Any], said: str) -> None:
    """One line: which file, what is wrong with it, and what would be right."""
    calibration(tmp_path)
    harm(tmp_path / "foot-0007")
    with pytest.raises(ModelError) as refusal:
        read_calibration(tmp_path / "foot-0007", DEFAULT_FOOT_TYPE)
    assert said in str(refusal.value)
    assert str(tmp_path / "foot-0007") in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_calibration_is_never_overwritten(tmp_path: Path) -> None:
    """A second one is refused; asked for, it takes the name, and the first is kept under a number and stays whole."""
    first = calibration(tmp_path)
    with pytest.raises(CalibrationError, match=r"with --replace the old one is kept as foot-0007\.1"):
        write_calibration(tmp_path, **content(n_loads=20))
    assert read_calibration(first.folder, DEFAULT_FOOT_TYPE).manifest == first.manifest
    for n_loads in (20, 50):
        write_calibration(tmp_path, **content(n_loads=n_loads), replace=True)
    kept = [
        read_calibration(tmp_path / name, DEFAULT_FOOT_TYPE)
        for name in ("foot-0007", "foot-0007.1", "foot-0007.2")
    ]
    assert [one.manifest.n_loads for one in kept] == [50, 362, 20]


def test_a_name_that_is_none_is_refused_first(tmp_path: Path) -> None:
    """One line, and no folder; nor does a check of a right name leave one."""
    with pytest.raises(CalibrationError, match=r"^seven: is no identity of a foot, such as foot-0007$"):
        write_calibration(tmp_path / "feet", **content("seven"))
    check_calibration_target(tmp_path / "feet" / "foot-0007", replace=False)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "given", [{"network": Path("/nowhere/network.onnx")}, {"n_loads": 0}, {"foot": "foot-7"}]
)
def test_what_robots_would_refuse_is_not_written(tmp_path: Path, given: dict[str, Any]) -> None:
    """A calibration that could not be read leaves nothing behind, not even a draft, and the old one where it was."""
    first = calibration(tmp_path)
    with pytest.raises(FootsenseError):
        write_calibration(tmp_path, **content(**given), replace=True)
    assert read_calibration(first.folder, DEFAULT_FOOT_TYPE).manifest == first.manifest
    assert [entry.name for entry in tmp_path.iterdir()] == ["foot-0007"]
