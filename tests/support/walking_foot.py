"""A made foot that walks, its calibration that wears out, and what `footsense selfcal` finds of it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from footsense.calibration.selfcal.instants import LegScans
from footsense.calibration.selfcal.state import FootIdentity
from footsense.calibration.selfcal.walking_foot import WalkingFoot
from footsense.daemon.foot_types import DEFAULT_FOOT_TYPE
from footsense.foot.directions import normalized
from footsense.foot.parameters import FootParameters
from footsense.foot.specimen import Specimen
from tests.support.test_stand_loads import design, made

Vector = NDArray[np.float64]

#: Conversion of board `ad7147`, its order of the elements, and noise of a reading.
CONVERSION_NS, _ORDER, _NOISE_PF = 768_186, np.random.default_rng(0).permutation(9), 0.5e-3
_STANCE_SCANS, _SWING_SCANS = 50, 24


def walk(
    foot: Specimen,
    n_stances: int,
    worn: Callable[[Vector, Vector], Vector] = lambda capacitance_pf, _: capacitance_pf,
    seed: int = 0,
) -> tuple[LegScans, Vector]:
    """Return the scans of a foot that walks, and all nine capacitances at each conversion [pF].

    Loads rise and fall smoothly, each stance with another lean and friction.

    Args:
        foot: The foot.
        n_stances: Number of stances.
        worn: Makes of capacitances [pF], shape (stances, conversions, 9), and the time in the stance, 0 to 1, those
            that are read.
        seed: Seed of loads and noise.
    """
    rng = np.random.default_rng(seed)
    scan = _STANCE_SCANS + _SWING_SCANS
    phase = (np.arange(9 * scan) - 9 * _SWING_SCANS) / (9 * _STANCE_SCANS)
    size_n = np.where(phase > 0.0, 0.7 * np.sin(np.pi * np.clip(phase, 0.0, 1.0)), 0.0)
    capacitance_pf = np.tile(foot.unloaded_pf, (n_stances, 9 * scan, 1))
    on = np.flatnonzero(size_n > 0.0)
    for stance in range(n_stances):
        lean, friction = rng.uniform(-0.15, 0.15, 2), rng.uniform(-0.25, 0.25, (2, 2))
        across = lean + friction[0] + (phase[on, None] - 0.5) * friction[1]
        normal = np.tile(normalized(np.append(lean, 1.0)[None]), (len(on), 1))
        force_n = rng.uniform(0.7, 1.0) * size_n[on, None] * np.column_stack([across, np.ones(len(on))])
        capacitance_pf[stance, on] = foot.capacitance_pf(normal, force_n)
    read_pf = worn(capacitance_pf, phase).reshape(-1, 9, 9)
    position = np.argsort(_ORDER)
    n = len(read_pf)
    t_ns = (9 * np.arange(n)[:, None] + position + 1) * CONVERSION_NS
    noisy_pf = read_pf[:, position, np.arange(9)] + _NOISE_PF * rng.normal(size=(n, 9))
    hangs = np.tile(size_n.reshape(-1, 9)[:, 0] < 0.03, n_stances)
    return LegScans(t_ns, noisy_pf, hangs), read_pf.reshape(-1, 9)


def made_foot(number: int) -> tuple[Specimen, FootParameters]:
    """Return a made foot, straight and as stiff as designed, and what a perfect calibration knows of it."""
    own = replace(made(number), mount=np.eye(3), stiffness_rel=0.0)
    foot = Specimen(design().response, own)
    return foot, FootParameters(
        stray_pf=np.asarray(own.stray_pf), unloaded_pf=foot.unloaded_pf, gap_um=foot.gap_um
    )


def identity(calibration_sha256: str = "", foot: str = "foot-0007") -> FootIdentity:
    return FootIdentity(
        leg="lf",
        foot=foot,
        foot_type=DEFAULT_FOOT_TYPE,
        board="ad7147",
        calibration=calibration_sha256,
        since="2026-03-01T12:00:00Z" if calibration_sha256 else "",
    )


def drifted(known: FootParameters, seed: int = 3) -> FootParameters:
    """Return a calibration whose gains are not the foot's any more, by 4 %."""
    return replace(known, gain_rel=1.0 + 0.04 * np.random.default_rng(seed).normal(size=9))


def walking_foot(
    known: FootParameters,
    calibration_sha256: str,
    scans: LegScans | None = None,
    *,
    expected_deg: float = 0.0,
) -> WalkingFoot:
    found = WalkingFoot(design(), identity(calibration_sha256), known, expected_deg)
    if scans is not None:
        found.add(scans)
        found.judge()
    return found
