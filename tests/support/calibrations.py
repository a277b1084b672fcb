"""Calibrations of feet that nobody pressed."""

from pathlib import Path
from typing import Any

import numpy as np

import footsense
from footsense.calibration.writer import write_calibration
from footsense.daemon.foot_types import DEFAULT_FOOT_TYPE, released_path
from footsense.foot.calibration_files import FootCalibration, HeldOutErrors, Manifest
from footsense.foot.force_errors import ForceErrors
from footsense.foot.parameters import FootParameters

#: What the simulator's designed foot reads unloaded [pF].
REST_PF = 5.387

BEFORE = ForceErrors(15.9, 30.0, 40.0, 18.7, 30.0, 50.0, 180)
AFTER = ForceErrors(1.5, 3.0, 4.0, 1.8, 4.0, 6.0, 180)


def parameters(**given: Any) -> FootParameters:
    """Return those of a foot that differs in all there is; `given` replaces some."""
    turn = np.radians(4.0)
    mount = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    values: dict[str, Any] = {
        "stray_pf": np.linspace(0.1, 0.5, 9),
        "unloaded_pf": np.linspace(5.0, 6.1, 9),
        "gap_um": np.linspace(18.0, 23.0, 9),
        "gain_rel": np.linspace(0.9, 1.1, 9),
        "stiffness_rel": 0.07,
        "mount": mount,
        "error_rel": 0.02,
    }
    return FootParameters(**{**values, **given})


def as_designed(**given: Any) -> FootParameters:
    """Return those of a foot exactly as the simulator has it; `given` replaces some."""
    values: dict[str, Any] = {
        "stray_pf": np.zeros(9),
        "unloaded_pf": np.full(9, REST_PF),
        "gap_um": np.full(9, 20.0),
    }
    return FootParameters(**{**values, **given})


def content(foot: str = "foot-0007", **given: Any) -> dict[str, Any]:
    """Return the arguments of `write_calibration`; `given` replaces some, or fields of the manifest."""
    fields: dict[str, Any] = {
        "foot": foot,
        "foot_type": DEFAULT_FOOT_TYPE,
        "footsense": footsense.__version__,
        "made": "2026-03-01T12:00:00Z",
        "n_loads": 362,
        "n_sessions": 3,
        "held_out": HeldOutErrors(
            protocol="each session by the two others", design_only=BEFORE, calibrated=AFTER
        ),
        "recordings": {"one.mcap": "1" * 64, "two.mcap": "2" * 64},
    }
    values: dict[str, Any] = {
        "parameters": parameters(),
        "network": released_path("network.onnx"),
        "temperature_c": 23.5,
    }
    manifest = Manifest(**{name: given.pop(name, value) for name, value in fields.items()})
    return {"manifest": manifest, **values, **given}


def calibration(calibrations: Path, foot: str = "foot-0007", **given: Any) -> FootCalibration:
    """Write a calibration and return it."""
    return write_calibration(calibrations, **content(foot, **given))
