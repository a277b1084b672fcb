"""Latency from a foot's touchdown to the first frame that reports contact, and contacts reported without one.

Feet touch down at random, hard or soft, upright or leaning; their readings come at the service's pace
(`conversions.py`), and the service's own pipeline makes frames of them.
"""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_interface.conversion_order import CONVERSION_ORDERS
from footsense.benchmarks.conversions import (
    conversion_timing,
    latest_conversion_indices,
    quantized_capacitance_pf,
)
from footsense.estimation.network import sensitivity
from footsense.estimation.pipeline import Pipeline
from footsense.estimation.settings import EstimationLimits, MountedFeet, TareLimits
from footsense.foot.gap_contact import capacitance_pf
from footsense.foot.specimen import Foot
from footsense.frames import ELEMENTS, CapFrame, Flag, Mask, Reading, Stamps, Vector

if TYPE_CHECKING:
    from footsense.lab.report import StudyContext

#: Conversions per second, and elements in the order of the scan.
RATE_SPS = 400
SCAN_ORDER = CONVERSION_ORDERS["lo_shu"]
#: 20 K in ten minutes at 1.5 fF/K, and the difference between elements in that [pF/s, 1].
_DRIFT_PF_PER_S, _DRIFT_SPREAD_REL = -1.5e-3 * 20 / 600, 0.2
#: Force at which the response is linearised [N].
_SENSITIVITY_PROBE_N = 1e-3
#: Feet of each manner, and length of the run [s].
_FULL, _QUICK = (6, 25.0), (2, 4.0)
#: Time after a touchdown in which the error counts [s].
FORCE_ERROR_WINDOW_S = 0.05
#: Upper bound of a Poisson mean at 95 % without an occurrence.
_POISSON_UPPER_95_FOR_ZERO_EVENTS = 3
_SEED = 5


class Touchdown(NamedTuple):
    """Type of touchdown: full load [N], rise time [s], and lean [deg].

    Attributes:
        force_n: Full load [N].
        rise_s: Time to the full load [s].
        lean_deg: Distance of the contact from the middle of the ball [deg], to any side.
    """

    force_n: float
    rise_s: float
    lean_deg: float


TOUCHDOWNS = {
    "hard, upright": Touchdown(0.5, 5e-3, 0.0),
    "hard, leaning by 25 deg": Touchdown(0.5, 5e-3, 25.0),
    "soft, upright": Touchdown(1.0, 0.144, 0.0),
    "soft, leaning by 25 deg": Touchdown(1.0, 0.144, 25.0),
}


#: Load from which a foot counts as in contact [N].
CONTACT_THRESHOLD_N = 0.03
#: First touchdown, and times in the air and on the ground after that [s].
_FIRST_S, _SWING_S, _STANCE_S = 1.6, (0.55, 0.75), 0.35
#: Fall time of the load [s], and time after lift-off until a foot counts as in swing [s].
_LIFT_S, _SETTLED_S = 0.05, 0.1
#: Rise time up to which a load rises evenly [s], else rounded like a step of the walk.
_MAX_LINEAR_RISE_S = 0.01
#: Tremor of a foot in the air after a step of its neighbour [N, Hz, s]: an assumption, a quarter of a contact.
VIBRATION_N, _VIBRATION_HZ, _VIBRATION_DECAY_S = CONTACT_THRESHOLD_N / 4, 25.0, 0.05


class RandomTouchdowns:
    """Touchdowns of some feet at random times; each foot always has the same type of touchdown.

    Args:
        n_feet: Feet of each manner.
        until_s: End of the run [s].
        rng: Source of times and sides.

    Attributes:
        kind: Number of the manner of each foot, shape (feet,).
        starts_s: First touch of each step [s], shape (feet, steps).
        crossed_s: Time at which each step reaches `CONTACT_THRESHOLD_N` along the leg [s], same shape.
        normals: Inward normal of each contact, shape (feet, steps, 3).
        upright: Share of the force of each foot that is along its leg [1], shape (feet,).
    """

    def __init__(self, n_feet: int, until_s: float, rng: np.random.Generator) -> None:
        self.kind = np.arange(len(TOUCHDOWNS)).repeat(n_feet)
        manner = np.array(list(TOUCHDOWNS.values()))[self.kind]
        self._force_n, self._rise_s, lean_rad = manner[:, 0], manner[:, 1], np.radians(manner[:, 2])
        n_steps = int((until_s - _FIRST_S) / (_SWING_S[0] + _STANCE_S)) + 1
        cycles_s = rng.uniform(*_SWING_S, (len(manner), n_steps)) + _STANCE_S
        self.starts_s = _FIRST_S - cycles_s[:, :1] + np.cumsum(cycles_s, axis=1)
        azimuth_rad = rng.uniform(0, 2 * np.pi, self.starts_s.shape)
        self.upright = np.cos(lean_rad)
        sin, up = np.sin(lean_rad)[:, None], np.broadcast_to(self.upright[:, None], azimuth_rad.shape)
        self.normals = np.stack((sin * np.cos(azimuth_rad), sin * np.sin(azimuth_rad), up), axis=2)
        share = CONTACT_THRESHOLD_N / (self._force_n * self.upright)
        rises = np.where(self._rise_s <= _MAX_LINEAR_RISE_S, share, np.arccos(1 - 2 * share) / np.pi)
        self.crossed_s = self.starts_s + (rises * self._rise_s)[:, None]

    def latest_touchdown_index(self, t_s: Vector) -> NDArray[np.intp]:
        """Return the index of each foot's latest touchdown at some times, shape (times, feet); -1 before the first."""
        return np.stack(
            [np.searchsorted(starts_s, t_s, side="right") - 1 for starts_s in self.starts_s], axis=1
        )

    def normal_force_n(self, t_s: Vector) -> Vector:
        """Return the true normal force on each foot at some times [N], shape (times, feet)."""
        since_s = self._time_since_touchdown_s(t_s)
        risen = np.clip(since_s / self._rise_s, 0.0, 1.0)
        risen = np.where(self._rise_s <= _MAX_LINEAR_RISE_S, risen, 0.5 - 0.5 * np.cos(np.pi * risen))
        force_n: Vector = self._force_n * risen * np.clip((_STANCE_S - since_s) / _LIFT_S, 0.0, 1.0)
        return force_n

    def is_swing(self, t_s: Vector) -> Mask:
        """Return the mask of feet unloaded for at least 0.1 s at some times, shape (times, feet)."""
        is_swing: Mask = self._time_since_touchdown_s(t_s) > _STANCE_S + _SETTLED_S
        return is_swing

    def vibration_after_neighbour_n(self, t_s: Vector) -> Vector:
        """Return the decaying vibration force on each foot after a neighbour's touchdown [N], shape (times, feet)."""
        since_s = np.roll(self._time_since_touchdown_s(t_s), len(TOUCHDOWNS) // 2 + 1, axis=1)
        wave = np.sin(2 * np.pi * _VIBRATION_HZ * np.minimum(since_s, 1.0))
        vibration_after_neighbour_n: Vector = VIBRATION_N * np.exp(-since_s / _VIBRATION_DECAY_S) * wave
        return vibration_after_neighbour_n

    def _time_since_touchdown_s(self, t_s: Vector) -> Vector:
        """Return the time since each foot's latest touchdown [s], shape (times, feet); infinite before the first."""
        touchdown_number = self.latest_touchdown_index(t_s)
        start_s = np.where(
            touchdown_number < 0,
            -np.inf,
            self.starts_s[np.arange(touchdown_number.shape[1]), touchdown_number],
        )
        since_s: Vector = t_s[:, None] - start_s
        return since_s


def _readings_pf(foot: Foot, steps: RandomTouchdowns, t_ns: Stamps, rng: np.random.Generator) -> Vector:
    """Return the reading of each conversion [pF], shape (conversions, feet), with drift, tremor and noise."""
    design = foot.response.design
    t_s = t_ns / 1e9
    n_feet, element = len(steps.kind), np.resize(SCAN_ORDER, len(t_ns))
    spread = 1.0 + _DRIFT_SPREAD_REL * rng.standard_normal((n_feet, ELEMENTS))
    drift_pf_per_s = _DRIFT_PF_PER_S * spread
    # No gap closes, so that closures are proportional to the force.
    normals = steps.normals.reshape(-1, 3)
    cell_closures_um = foot.cell_closures_um(normals, normals * _SENSITIVITY_PROBE_N).reshape(
        *steps.normals.shape[:2], -1
    )
    cells_um_per_n = cell_closures_um / _SENSITIVITY_PROBE_N
    up_n = np.array([[0.0, 0.0, _SENSITIVITY_PROBE_N]])
    pf_per_n = (
        foot.capacitance_pf(up_n / _SENSITIVITY_PROBE_N, up_n)[0] - foot.unloaded_pf
    ) / _SENSITIVITY_PROBE_N
    force_n, step = steps.normal_force_n(t_s), steps.latest_touchdown_index(t_s)
    all_pf = foot.unloaded_pf[element][:, None].repeat(n_feet, axis=1)
    for loaded in np.array_split(np.argwhere(force_n), 64):  # in parts, for the memory of all cells
        at, feet = loaded.T
        closure_um = cells_um_per_n[feet, step[at, feet]] * force_n[at, feet][:, None]
        distance_um = design.gap_um - closure_um + design.film_equivalent_um
        all_pf[at, feet] = capacitance_pf(design, distance_um)[np.arange(len(at)), element[at]]
    all_pf += (
        drift_pf_per_s.T[element] * t_s[:, None]
        + steps.vibration_after_neighbour_n(t_s) * pf_per_n[element][:, None]
    )
    return quantized_capacitance_pf(all_pf, RATE_SPS, rng)


class PublishedRun(NamedTuple):
    """Estimated and true forces and contacts of a run, shape (frames, feet), and the sending times.

    Attributes:
        sent_s: Time of sending [s], shape (frames,).
        contact: Flag CONTACT.
        axial_force_n: Force along the leg [N], NaN without one.
        true_axial_force_n: True force along the leg at the time of sending [N].
        is_swing: Whether the foot was in swing.
    """

    sent_s: Vector
    contact: Mask
    axial_force_n: Vector
    true_axial_force_n: Vector
    is_swing: Mask


def simulate_touchdowns(
    context: "StudyContext", steps: RandomTouchdowns, until_s: float, seed: int
) -> PublishedRun:
    """Return the daemon's frames for feet that touch down repeatedly, one frame per conversion.

    Args:
        context: Response table and network.
        steps: Steps of the feet.
        until_s: End of the run [s].
        seed: Seed of noise and drift.
    """
    step_ns, lead_ns = conversion_timing(RATE_SPS)
    n_feet, n = len(steps.kind), int(until_s * 1e9) // step_ns
    t_ns = np.arange(1, n + 1, dtype=np.int64) * step_ns
    read_pf = _readings_pf(Foot(context.response, contact=False), steps, t_ns, np.random.default_rng(seed))
    pipeline = _pipeline(context, n_feet)
    numbers = latest_conversion_indices(SCAN_ORDER, n)
    sent_ns = (t_ns + lead_ns)[ELEMENTS - 1 :]
    ok = np.full((n_feet, ELEMENTS), Reading.OK, np.uint8)
    contact, force_n = [], []
    for sequence, (number, now_ns) in enumerate(zip(numbers, sent_ns.tolist(), strict=True)):
        frame = CapFrame(sequence, np.tile(t_ns[number], (n_feet, 1)), read_pf[number].T.copy(), ok)
        forces, _ = pipeline.process(frame, now_ns)
        contact.append(forces.flags & Flag.CONTACT > 0)
        force_n.append(forces.force_n[:, 2])
    sent_s = sent_ns / 1e9
    true_force_n = steps.normal_force_n(sent_s) * steps.upright
    return PublishedRun(sent_s, np.array(contact), np.array(force_n), true_force_n, steps.is_swing(sent_s))


def _pipeline(context: "StudyContext", n_feet: int) -> Pipeline:
    """Return the daemon's pipeline with one leg per simulated foot."""
    network, trained = context.network, context.trained_inputs
    scan_ns = ELEMENTS * conversion_timing(RATE_SPS).step_ns
    return Pipeline(
        network,
        trained,
        MountedFeet.as_designed(trained.design, n_feet),
        EstimationLimits(
            tare=TareLimits(window_scans=8, noise_limit_ff=5.0, unloaded_limit_rel=0.03),
            least_contact_n=CONTACT_THRESHOLD_N,
            scan_ns=scan_ns,
            max_age_ns=4 * scan_ns,
        ),
        sensitivity(network, 1, trained.moments),
    )


def _first_report_latency_ms(reported: Mask, sent_s: Vector, starts_s: Vector, crossed_s: Vector) -> Vector:
    """Return the latency from each touchdown of one foot to its first report [ms], shape (touchdowns,)."""
    first = [np.flatnonzero(reported & (sent_s > start_s))[0] for start_s in starts_s.tolist()]
    latencies_ms: Vector = 1e3 * (sent_s[first] - crossed_s)
    return latencies_ms


def _latencies(
    result: PublishedRun, steps: RandomTouchdowns, until_s: float, kind: int
) -> tuple[tuple[Vector, Vector], float]:
    """Return all touchdown latencies of one type [ms], and the rms force error after touchdown [mN]."""
    contact_latency_ms, force_latency_ms, squares_n2 = [], [], []
    for foot in np.flatnonzero(steps.kind == kind).tolist():
        complete = steps.crossed_s[foot] < until_s - 2 * FORCE_ERROR_WINDOW_S
        times = result.sent_s, steps.starts_s[foot, complete], steps.crossed_s[foot, complete]
        contact_latency_ms.append(_first_report_latency_ms(result.contact[:, foot], *times))
        force_latency_ms.append(
            _first_report_latency_ms(result.axial_force_n[:, foot] > CONTACT_THRESHOLD_N, *times)
        )
        error_n = result.axial_force_n[:, foot] - result.true_axial_force_n[:, foot]
        for crossed_s in times[2].tolist():
            after = (result.sent_s > crossed_s) & (result.sent_s < crossed_s + FORCE_ERROR_WINDOW_S)
            squares_n2.append(np.nanmean(error_n[after] ** 2))
    force_rms_error_mn = 1e3 * float(np.sqrt(np.mean(squares_n2)))
    return (np.concatenate(contact_latency_ms), np.concatenate(force_latency_ms)), force_rms_error_mn


def _p50_p99(values_ms: Vector) -> list[float]:
    """Return the median and the 99th percentile [ms]."""
    p50_p99: list[float] = np.percentile(values_ms, (50, 99)).tolist()
    return p50_p99


def _false_reports(result: PublishedRun) -> dict[str, Any]:
    """Return how often unloaded feet were reported, in swing and in the 0.1 s after lift-off, and the time in swing."""
    hours = float(np.gradient(result.sent_s) @ result.is_swing.sum(axis=1)) / 3600
    swings = result.is_swing[1:]

    def in_swing_and_at_lift_off(reported: Mask) -> list[int]:
        begins = reported[1:] & ~reported[:-1] & (result.true_axial_force_n[1:] == 0.0)
        return [int((begins & swings).sum()), int((begins & ~swings).sum())]

    return {
        "swing_minutes": 60 * hours,
        "false_contacts_swing_liftoff": in_swing_and_at_lift_off(result.contact),
        "false_forces_swing_liftoff": in_swing_and_at_lift_off(result.axial_force_n > CONTACT_THRESHOLD_N),
        "zero_event_rate_upper95_per_h": _POISSON_UPPER_95_FOR_ZERO_EVENTS / hours,
        "max_swing_force_mn": 1e3 * float(np.nanmax(result.axial_force_n[result.is_swing])),
    }


def measure_touchdown_latencies(context: "StudyContext") -> dict[str, Any]:
    """Return latencies from `CONTACT_THRESHOLD_N` on by manner of touchdown (`latencies`), and `false_reports`.

    Of each manner `contact_ms` and `force_ms`, sorted latencies of the flag CONTACT and of the first force above the
    threshold, with `contact_p50_p99_ms` and `force_p50_p99_ms`, and `force_rms_error_mn` in the
    `FORCE_ERROR_WINDOW_S` after it.

    Args:
        context: Response table and network; in the quick form two feet of each manner for 4 s.
    """
    n_feet, until_s = _QUICK if context.quick else _FULL
    steps = RandomTouchdowns(n_feet, until_s, np.random.default_rng(_SEED))
    result = simulate_touchdowns(context, steps, until_s, _SEED)
    latencies: dict[str, dict[str, Any]] = {}
    for kind, name in enumerate(TOUCHDOWNS):
        (contact_ms, force_ms), force_rms_error_mn = _latencies(result, steps, until_s, kind)
        latencies[name] = {
            "contact_ms": np.sort(contact_ms).tolist(),
            "force_ms": np.sort(force_ms).tolist(),
            "contact_p50_p99_ms": _p50_p99(contact_ms),
            "force_p50_p99_ms": _p50_p99(force_ms),
            "force_rms_error_mn": force_rms_error_mn,
        }
    return {"latencies": latencies, "false_reports": _false_reports(result)}
