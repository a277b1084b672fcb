"""Study `history`: errors of networks with earlier scans as inputs, on rubber that creeps."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from footsense.foot.capacitor import CapacitorDesign
from footsense.foot.force_errors import errors
from footsense.foot.specimen import Foot
from footsense.frames import Vector
from footsense.lab.creep import ASSUMED, Kelvin, crept_closure, uncrept_closure
from footsense.lab.studies.page import Figures, Study, StudyContext
from footsense.lab.training.load_cases import measured_closure_rel, sensed_closure_um
from footsense.lab.training.scan_network import HIDDEN, train_scans
from footsense.sim.loads.measured_walk import measured_walk
from footsense.sim.loads.smooth_stance import smooth_stance
from footsense.sim.loads.walk import Walk

#: A scan of nine conversions on the default board [s].
PERIOD_S = 24.1e-3
#: Scans of one walk, walks for training, and measured walks for the test.
SCANS, TRAINING_WALKS, TEST_WALKS = 192, 240, 40
QUICK_TRAINING_WALKS, QUICK_TEST_WALKS = 40, 10
#: Steps of training.
STEPS, QUICK_STEPS = 4000, 300
#: Largest vertical force of a walk [N]: with creep on top, still no gap closes.
LARGEST_N = (0.2, 0.5)
#: Time constants of the low-pass filters [s]: not the times of the chain, which are unknown on a real foot.
FILTERS_S = (0.1, 1.0)
#: Above this a foot counts as loaded [N].
LOADED_N = 0.1

#: Feet that creep by 30 % more, and 30 % more slowly, than those of the training.
OTHER = tuple(Kelvin(share_rel=1.3 * part.share_rel, time_s=1.3 * part.time_s) for part in ASSUMED)

_NS = 1_000_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Walks:
    """Feet that walk, scan by scan.

    Attributes:
        force_n: Forces [N], shape (walks, scans, 3).
        elastic_um: Closures of a foot that does not creep [um], shape (walks, scans, 9).
    """

    force_n: Vector
    elastic_um: Vector

    def measured_rel(self, design: CapacitorDesign, chain: tuple[Kelvin, ...], seed: int) -> Vector:
        """Return measured closures over the gap of feet that creep by a chain, shape (walks, scans, 9)."""
        crept = np.stack([crept_closure(walk, PERIOD_S, chain) for walk in self.elastic_um])
        return measured_closure_rel(design, crept, np.random.default_rng(seed))


def _synthetic(rng: np.random.Generator) -> Walk:
    """Return a walk with rounded flanks, of random pace, weight, friction and lean."""
    duty = rng.uniform(0.5, 0.75)
    reaction = smooth_stance(duty, rng.uniform(*LARGEST_N), rng.uniform(-0.3, 0.3))
    return Walk({"lf": reaction}, int(rng.uniform(0.7, 1.6) * _NS), duty, rng.uniform(-15.0, 15.0), 0)


def _measured(rng: np.random.Generator) -> Walk:
    """Return the measured walk of a person, scaled to a random weight, with a random lean."""
    return measured_walk(rng.uniform(*LARGEST_N), rng.uniform(-15.0, 15.0), 0)


def _walks(foot: Foot, draw: Callable[[np.random.Generator], Walk], n: int, seed: int) -> Walks:
    """Return n walks of one leg, in random headings and phases, on ground tilted by up to 10 deg."""
    rng = np.random.default_rng(seed)
    normals, forces = [], []
    for _ in range(n):
        walk, start_s = draw(rng), rng.uniform(0.0, 1.0)
        contacts = [walk.contact("lf", round((start_s + PERIOD_S * k) * _NS)) for k in range(SCANS)]
        # The foot is unloaded before the first scan: a walk begins in swing, whatever its phase.
        landed = np.cumsum([float(c.force_n[2]) == 0.0 for c in contacts]) > 0
        turn, tilt_deg = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.0, 10.0)
        turned = Rotation.from_euler("ZY", [turn, np.radians(tilt_deg)])
        normals.append(turned.apply([c.normal for c in contacts]))
        forces.append(landed[:, None] * turned.apply([c.force_n for c in contacts]))
    normal, force = np.stack(normals), np.stack(forces)
    elastic = np.zeros((n, SCANS, 9))
    loaded = np.linalg.norm(force, axis=-1) > 0.0
    elastic[loaded] = sensed_closure_um(foot, normal[loaded], force[loaded])
    return Walks(force, elastic)


def last_scans(n: int) -> Callable[[Vector], Vector]:
    """Return the function that appends earlier scans, newest first: (walks, scans, 9) becomes (walks, scans, 9 n)."""

    def append(scans: Vector) -> Vector:
        delayed = [
            np.concatenate([np.zeros_like(scans[:, :k]), scans[:, : SCANS - k]], axis=1) for k in range(n)
        ]
        return np.concatenate(delayed, axis=-1)

    return append


def low_passed(scans: Vector) -> Vector:
    """Return the scans and the states of the low-pass filters, shape (walks, scans, 27)."""
    shares = [-np.expm1(-PERIOD_S / time_s) for time_s in FILTERS_S]
    states = [lfilter([share], [1.0, share - 1.0], scans, axis=1) for share in shares]
    return np.concatenate([scans, *states], axis=-1)


def _without_creep(scans: Vector) -> Vector:
    """Return the scans with the creep of the assumed chain taken out."""
    return np.stack([uncrept_closure(walk, PERIOD_S, ASSUMED) for walk in scans])


class _Readout(NamedTuple):
    """A way to read forces from scans.

    Attributes:
        name: In words.
        training_creep: Chain of the feet of the training.
        inputs: Makes the network's inputs of scans.
        correct: Corrects the scans of the test before.
    """

    name: str
    training_creep: tuple[Kelvin, ...]
    inputs: Callable[[Vector], Vector]
    correct: Callable[[Vector], Vector] = np.asarray


_THIS_SCAN = last_scans(1)
ALONE, FILTERED, UNDONE = (
    "this scan, trained with creep",
    "this scan and 2 low-pass states",
    "this scan, creep undone by its chain",
)
_READOUTS = (
    _Readout("this scan, trained without creep", (), _THIS_SCAN),
    _Readout(ALONE, ASSUMED, _THIS_SCAN),
    _Readout("last 2 scans", ASSUMED, last_scans(2)),
    _Readout("last 4 scans", ASSUMED, last_scans(4)),
    _Readout(FILTERED, ASSUMED, low_passed),
    _Readout(UNDONE, (), _THIS_SCAN, _without_creep),
)
#: Each network takes seconds to compile.
_LEFT_OUT_QUICK = ("last 2 scans", "last 4 scans")


class ForceErrors(NamedTuple):
    """Rms and direction errors of forces, loaded and in swing.

    Attributes:
        loaded_n: rms under load [N].
        direction_deg: Mean angle under load [deg].
        swing_n: rms in swing [N].
    """

    loaded_n: float
    direction_deg: float
    swing_n: float


@dataclass(frozen=True, slots=True)
class Tested:
    """One way to read forces.

    Attributes:
        n_inputs: Inputs of the network.
        same: Errors on feet that creep as in the training.
        other: Errors on feet that creep more, and more slowly.
    """

    n_inputs: int
    same: ForceErrors
    other: ForceErrors


@dataclass(frozen=True, kw_only=True)
class Results:
    """All ways to read forces.

    Attributes:
        steps: Training steps.
        training_walks: Walks of the training.
        test_walks: Walks of the test.
        without_creep: Errors of one scan where no foot creeps.
        readouts: By name.
    """

    steps: int
    training_walks: int
    test_walks: int
    without_creep: ForceErrors
    readouts: dict[str, Tested]


def _errors(truth_n: Vector, estimate_n: Vector) -> ForceErrors:
    """Return the errors of forces [N], both of shape (walks, scans, 3)."""
    size = np.linalg.norm(truth_n, axis=-1)
    loaded, square = size > LOADED_N, ((estimate_n - truth_n) ** 2).sum(axis=-1)
    return ForceErrors(
        float(np.sqrt(square[loaded].mean())),
        errors(truth_n[loaded], estimate_n[loaded]).direction_deg,
        float(np.sqrt(square[size == 0.0].mean())),
    )


def compute(context: StudyContext) -> tuple[Results, Figures]:
    """Train a network for each kind of inputs, test each network on measured walks, and return the errors."""
    quick, design, foot = context.quick, context.response.design, Foot(context.response)
    steps = QUICK_STEPS if quick else STEPS
    training = _walks(foot, _synthetic, QUICK_TRAINING_WALKS if quick else TRAINING_WALKS, 1)
    test = _walks(foot, _measured, QUICK_TEST_WALKS if quick else TEST_WALKS, 2)
    networks: dict[tuple[Any, ...], Callable[[Vector], Vector]] = {}
    readouts, drawn = {}, {}
    for readout in _READOUTS:
        if quick and readout.name in _LEFT_OUT_QUICK:
            continue
        key = readout.training_creep, readout.inputs
        if key not in networks:
            inputs = readout.inputs(training.measured_rel(design, readout.training_creep, 3))
            networks[key] = train_scans(
                inputs.reshape(-1, inputs.shape[-1]), training.force_n.reshape(-1, 3), steps
            )
            context.say(f"history: {readout.name} trained")
        inputs_of = [
            readout.inputs(readout.correct(test.measured_rel(design, c, 4))) for c in (ASSUMED, OTHER)
        ]
        estimates = [networks[key](inputs) for inputs in inputs_of]
        same, other = (_errors(test.force_n, estimate) for estimate in estimates)
        readouts[readout.name] = Tested(inputs_of[0].shape[-1], same, other)
        drawn[readout.name] = estimates[0][0]
    elastic = networks[(), _THIS_SCAN](test.measured_rel(design, (), 4))
    results = Results(
        steps=steps,
        training_walks=len(training.force_n),
        test_walks=len(test.force_n),
        without_creep=_errors(test.force_n, elastic),
        readouts=readouts,
    )
    return results, {"history.png": _figure(test.force_n[0], drawn)}


def _figure(walk_n: Vector, estimates_n: dict[str, Vector]) -> Figure:
    """Draw one walk's force and the error of each read-out over time."""
    figure = Figure(figsize=(8.4, 5.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(1, 2))
    time_s = PERIOD_S * np.arange(SCANS)
    upper.plot(time_s, np.linalg.norm(walk_n, axis=-1), "k-")
    upper.set_ylabel("|force| [N]")
    for name, estimate_n in estimates_n.items():
        off_mn = 1e3 * np.linalg.norm(estimate_n - walk_n, axis=-1)
        lower.semilogy(time_s, np.maximum(off_mn, 0.1), lw=1.2, label=name)
    lower.set(xlabel="time [s]", ylabel="error of the force [mN]")
    lower.legend(fontsize=8, ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.16))
    for axes in (upper, lower):
        axes.grid(alpha=0.3)
    return figure


STUDY = Study(
    name="history", title="Does a history pay", compute=compute, names={"HIDDEN": HIDDEN}, uses_network=False
)
