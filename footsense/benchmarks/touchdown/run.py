"""Feet that touch down repeatedly, read by whole scans and by single elements: the runs of the study `touchdown`.

All feet of a run are legs of one daemon's pipeline. The bus has the pace of the study `tradeoff`.
"""

import json
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_interface import fdc1004
from footsense.benchmarks.latency_vs_error.chain import ORDERS, pace
from footsense.estimation.alignment.element_by_element import ElementByElement
from footsense.estimation.alignment.scan_by_scan import ScanByScan
from footsense.estimation.baseline.contact import ContactLimits
from footsense.estimation.baseline.tare import TareLimits
from footsense.estimation.pipeline import Pipeline
from footsense.estimation.sensitivity import sensitivity
from footsense.foot.gap_contact import capacitance_pf
from footsense.foot.network_card import read_card
from footsense.foot.specimen import Foot
from footsense.frames import ELEMENTS, CapFrame, Flag, Reading, State
from footsense.lab.studies.page import Workbench

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

TOUCH_N = 0.03
#: Ways to read a foot.
FRAME, ELEMENT = WAYS = ("full scan per frame", "element by element")

_RATE_SPS = 400
_ORDER = ORDERS["lo_shu"]
#: First touchdown, and how long a foot is in the air and on the ground after that [s].
_FIRST_S, _SWING_S, _STANCE_S = 1.6, (0.55, 0.75), 0.35
#: How long a load takes to go [s].
_LIFT_S = 0.05
#: 20 K in ten minutes at 1.5 fF/K, and how much elements differ in that [pF/s, 1].
_DRIFT_PF_PER_S, _DRIFT_SPREAD_REL = -1.5e-3 * 20 / 600, 0.2
#: What a neighbour's step does to a foot in the air [N, Hz, s]: an assumption, a quarter of what counts as contact.
SHAKE_N, _SHAKE_HZ, _SHAKE_S = TOUCH_N / 4, 25.0, 0.05
_PROBE_N = 1e-3


class Kind(NamedTuple):
    """A way to touch down.

    Attributes:
        force_n: What the foot carries then [N].
        rise_s: Time until it does [s]; evenly up to 10 ms, else rounded like a step of the walk.
        lean_deg: How far from the middle of its ball it touches [deg], to any side.
    """

    force_n: float
    rise_s: float
    lean_deg: float


KINDS = {
    "hard, upright": Kind(0.5, 5e-3, 0.0),
    "hard, leaning by 25 deg": Kind(0.5, 5e-3, 25.0),
    "soft, upright": Kind(1.0, 0.144, 0.0),
    "soft, leaning by 25 deg": Kind(1.0, 0.144, 25.0),
}


class Steps:
    """What every foot feels: its own touchdowns at random times, all of one kind.

    Args:
        n_feet: Feet of each kind.
        until_s: When it ends [s].
        rng: Of times and sides.

    Attributes:
        kind: Number of each foot's kind, shape (feet,).
        begins_s: First touch of each foot [s], shape (feet, steps).
        crossed_s: When it carries `TOUCH_N` along the leg, same shape.
        upright: Share of each foot's force that is along the leg [1], shape (feet,).
    """

    def __init__(self, n_feet: int, until_s: float, rng: np.random.Generator) -> None:
        self.kind = np.arange(len(KINDS)).repeat(n_feet)
        kinds = np.array(list(KINDS.values()))[self.kind]
        self._force_n, self._rise_s, self._lean_rad = kinds[:, 0], kinds[:, 1], np.radians(kinds[:, 2])
        n_steps = int((until_s - _FIRST_S) / (_SWING_S[0] + _STANCE_S)) + 1
        cycles_s = rng.uniform(*_SWING_S, (len(kinds), n_steps)) + _STANCE_S
        self.begins_s = _FIRST_S - cycles_s[:, :1] + np.cumsum(cycles_s, axis=1)
        self._azimuth_rad = rng.uniform(0, 2 * np.pi, self.begins_s.shape)
        self.upright = np.cos(self._lean_rad)
        share = (TOUCH_N / (self._force_n * self.upright))[:, None]
        hard = (self._rise_s <= 0.01)[:, None]
        rises = np.where(hard, share, np.arccos(1 - 2 * share) / np.pi)
        self.crossed_s = self.begins_s + rises * self._rise_s[:, None]

    def step(self, t_s: float) -> NDArray[np.intp]:
        """Return the number of each foot's last step, shape (feet,); -1 before the first."""
        step: NDArray[np.intp] = (self.begins_s <= t_s).sum(axis=1) - 1
        return step

    def force_n(self, t_s: float) -> Vector:
        """Return the force on all feet along their normals at a time [N], shape (feet,)."""
        step = self.step(t_s)
        since_s = np.where(step < 0, -1.0, t_s - self.begins_s[np.arange(len(step)), step])
        up = np.clip(since_s / self._rise_s, 0.0, 1.0)
        up = np.where(self._rise_s <= 0.01, up, 0.5 - 0.5 * np.cos(np.pi * up))
        force_n: Vector = self._force_n * up * np.clip((_STANCE_S - since_s) / _LIFT_S, 0.0, 1.0)
        return force_n

    def normals(self) -> Vector:
        """Return the normal of every step, shape (feet, steps, 3)."""
        sin = np.sin(self._lean_rad)[:, None]
        up = np.broadcast_to(self.upright[:, None], self._azimuth_rad.shape)
        return np.stack((sin * np.cos(self._azimuth_rad), sin * np.sin(self._azimuth_rad), up), axis=2)

    def swings(self, t_s: float) -> Mask:
        """Tell who has carried nothing for 0.1 s at least, shape (feet,)."""
        since_s = t_s - np.where(self.begins_s <= t_s, self.begins_s, -np.inf).max(axis=1)
        swings: Mask = since_s > _STANCE_S + 0.1
        return swings

    def shakes_n(self, t_s: float) -> Vector:
        """Return what the last step of its neighbour does to each foot [N], shape (feet,)."""
        last_s = np.where(self.begins_s <= t_s, self.begins_s, -np.inf).max(axis=1)
        since_s = np.roll(t_s - last_s, len(KINDS) // 2 + 1)
        shakes: Vector = (
            SHAKE_N * np.exp(-since_s / _SHAKE_S) * np.sin(2 * np.pi * _SHAKE_HZ * np.minimum(since_s, 1.0))
        )
        return shakes


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """What was published, shape (frames, feet) each but for the times.

    Attributes:
        sent_s: When [s], shape (frames,).
        contact: Whether CONTACT was said.
        force_n: Force along the leg [N], NaN without one.
        true_force_n: What the foot felt along the leg when it was sent [N].
        usable: Whether the leg was valid.
        swings: Whether the foot was in the air for certain.
    """

    sent_s: Vector
    contact: Mask
    force_n: Vector
    true_force_n: Vector
    usable: Mask
    swings: Mask


class _Chain:
    """The pipeline of as many legs as there are feet, for one way to read them."""

    def __init__(self, bench: Workbench, way: str, n_feet: int) -> None:
        network = bench.network
        calibration = read_card(json.dumps(network.card), str(bench.models)).trained_inputs
        design, moments = calibration.design, calibration.moments
        rate = fdc1004.RATES[_RATE_SPS]
        self.step_ns, self.lead_ns = pace(_RATE_SPS)
        rest_rel = float(design.plate_distance_um(np.array([design.rest_pf]))[0]) / design.gap_um
        noise_rel = rate.noise_ff * 1e-3 / design.rest_pf * rest_rel
        scan_ns = ELEMENTS * self.step_ns
        self.pipeline = Pipeline(
            ScanByScan(network, n_feet, moments)
            if way == FRAME
            else ElementByElement(network, n_feet, moments, _ORDER, self.step_ns, noise_rel),
            calibration,
            np.zeros((n_feet, ELEMENTS)),
            np.full((n_feet, ELEMENTS), design.rest_pf),
            sensitivity=sensitivity(network, 1, moments),
            tare=TareLimits(window_frames=8, noise_limit_ff=5.0, unloaded_limit_rel=0.03),
            contact=ContactLimits(touch_n=TOUCH_N),
            max_age_ns=4 * scan_ns,
            settled_ns=4 * scan_ns,
        )


class _Converters:
    """What the converters of all feet last said of every element."""

    def __init__(self, foot: Foot, steps: Steps, rng: np.random.Generator) -> None:
        n_feet = len(steps.kind)
        self._foot, self._steps, self._rng = foot, steps, rng
        spread = 1.0 + _DRIFT_SPREAD_REL * rng.standard_normal((n_feet, ELEMENTS))
        self._drift_pf_per_s = _DRIFT_PF_PER_S * spread
        normals = steps.normals()
        # No gap shuts, so that closures are in proportion to the force.
        cells_um = foot.cells_um(normals.reshape(-1, 3), normals.reshape(-1, 3) * _PROBE_N)
        self._cells_um_per_n = cells_um.reshape(*normals.shape[:2], -1) / _PROBE_N
        up_n = np.array([[0.0, 0.0, _PROBE_N]])
        self._pf_per_n = (foot.capacitance_pf(up_n / _PROBE_N, up_n)[0] - foot.rest_pf) / _PROBE_N
        self.t_ns = np.zeros((n_feet, ELEMENTS), np.int64)
        self.pf = np.full((n_feet, ELEMENTS), np.nan)
        self.reading = np.full((n_feet, ELEMENTS), Reading.NOT_READY, np.uint8)

    def convert(self, element: int, t_ns: int) -> None:
        """Convert one element of all feet."""
        t_s = t_ns * 1e-9
        force_n = self._steps.force_n(t_s)
        loaded = np.flatnonzero(force_n)
        cells_um = self._cells_um_per_n[loaded, self._steps.step(t_s)[loaded]] * force_n[loaded, None]
        design = self._foot.response.design
        all_pf = np.tile(self._foot.rest_pf, (len(force_n), 1))
        all_pf[loaded] = capacitance_pf(design, design.gap_um - cells_um + design.film_equivalent_um)
        all_pf += self._drift_pf_per_s * t_s + self._steps.shakes_n(t_s)[:, None] * self._pf_per_n
        noise_ff = fdc1004.RATES[_RATE_SPS].noise_ff
        read_pf = all_pf[:, element] + noise_ff * 1e-3 * self._rng.standard_normal(len(all_pf))
        codes_per_pf = fdc1004.CODES_PER_PF >> 8
        self.pf[:, element] = np.floor(read_pf * codes_per_pf) / codes_per_pf
        self.t_ns[:, element] = t_ns
        self.reading[:, element] = Reading.OK


def run(bench: Workbench, way: str, steps: Steps, until_s: float, seed: int) -> Run:
    """Return what is published of feet that touch down.

    Args:
        bench: Response table and network.
        way: One of `WAYS`.
        steps: What the feet feel.
        until_s: When it ends [s].
        seed: Of noise and drift.
    """
    n_feet = len(steps.kind)
    chain = _Chain(bench, way, n_feet)
    converters = _Converters(Foot(bench.response, contact=False), steps, np.random.default_rng(seed))
    sent_s, rows = [], []
    for n in range(int(until_s * 1e9) // chain.step_ns):
        t_ns = (n + 1) * chain.step_ns
        converters.convert(_ORDER[n % ELEMENTS], t_ns)
        if n < ELEMENTS - 1 or (way == FRAME and n % ELEMENTS != ELEMENTS - 1):
            continue
        now_ns = t_ns + chain.lead_ns
        frame = CapFrame(n, converters.t_ns.copy(), converters.pf.copy(), converters.reading.copy())
        forces, _ = chain.pipeline.process(frame, now_ns)
        now_s = now_ns * 1e-9
        sent_s.append(now_s)
        rows.append(
            (
                forces.flags & Flag.CONTACT > 0,
                forces.force_n[:, 2],
                steps.force_n(now_s) * steps.upright,
                forces.state == State.VALID,
                steps.swings(now_s),
            )
        )
    return Run(np.array(sent_s), *(np.array(column) for column in zip(*rows, strict=True)))
