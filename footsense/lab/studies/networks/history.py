"""Study `history`: does a network that also sees earlier scans know more, once the rubber creeps?"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from matplotlib.figure import Figure
from numpy.typing import NDArray

from footsense.foot.capacitor import CapacitorDesign
from footsense.foot.specimen import Foot
from footsense.lab.creep import ASSUMED, Kelvin, crept_closure, uncrept_closure
from footsense.lab.evaluation.evaluate import errors
from footsense.lab.studies.page import Page, Workbench, table
from footsense.lab.training.load_cases import measured_closure_rel, sensed_closure_um
from footsense.lab.training.network import SOFT_REL
from footsense.sim.loads.ground_load import Walk, measured_walk, smooth_step

Vector = NDArray[np.float64]

#: A scan of nine conversions on the default board [s].
PERIOD_S = 24.1e-3
#: Scans of one walk, walks that are learnt from, and measured walks that are asked.
SCANS, WALKS, ASKED = 192, 240, 40
QUICK_WALKS, QUICK_ASKED = 40, 10
#: Largest vertical force of a walk [N]: with creep on top, still no gap shuts.
LARGEST_N = (0.2, 0.5)
#: Units of each of two hidden layers, and how they learn.
HIDDEN, STEPS, QUICK_STEPS, BATCH, RATE, FLOOR_N = 24, 4000, 300, 512, 1e-2, 0.1
#: Low-pass filters whose states are offered [s]: not the times of the chain, which nobody would know.
FILTERS_S = (0.1, 1.0)
#: Above this a foot counts as loaded [N].
LOADED_N = 0.1

#: A foot that creeps otherwise than the ones that were learnt from: by 30 % more, and 30 % more slowly.
OTHER = tuple(Kelvin(share_rel=1.3 * part.share_rel, time_s=1.3 * part.time_s) for part in ASSUMED)

_NS = 1_000_000_000
_FIGURE = "history.png"


@dataclass(frozen=True, slots=True, eq=False)
class Walks:
    """Feet that walk, scan by scan.

    Attributes:
        force_n: Forces [N], shape (walks, scans, 3).
        elastic_um: Closures of a foot that does not creep [um], shape (walks, scans, 9).
    """

    force_n: Vector
    elastic_um: Vector

    def seen_rel(self, design: CapacitorDesign, chain: tuple[Kelvin, ...], seed: int) -> Vector:
        """Return measured closures over the gap of feet that creep by a chain, shape (walks, scans, 9)."""
        crept = np.stack([crept_closure(walk, PERIOD_S, chain) for walk in self.elastic_um])
        return measured_closure_rel(design, crept, np.random.default_rng(seed))


def _made_up(rng: np.random.Generator) -> Walk:
    """Return a walk with rounded flanks, of random pace, weight, friction and lean."""
    duty = rng.uniform(0.5, 0.75)
    reaction = smooth_step(duty, rng.uniform(*LARGEST_N), rng.uniform(-0.3, 0.3))
    return Walk({"lf": reaction}, int(rng.uniform(0.7, 1.6) * _NS), duty, rng.uniform(-15.0, 15.0), 0)


def _measured(rng: np.random.Generator) -> Walk:
    """Return the measured walk of a person, scaled to a random weight, with a random lean."""
    return measured_walk(rng.uniform(*LARGEST_N), rng.uniform(-15.0, 15.0), 0)


def _walked(foot: Foot, draw: Callable[[np.random.Generator], Walk], n: int, seed: int) -> Walks:
    """Return n walks of one leg, each in a random heading and with ground tilted by up to 10 deg, in step at random."""
    rng = np.random.default_rng(seed)
    normals, forces = [], []
    for _ in range(n):
        walk, begin_s = draw(rng), rng.uniform(0.0, 1.0)
        contacts = [walk.contact("lf", round((begin_s + PERIOD_S * k) * _NS)) for k in range(SCANS)]
        # Foot at rest before the first scan: a walk begins in the air, whatever its phase.
        landed = np.cumsum([float(c.force_n[2]) == 0.0 for c in contacts]) > 0
        turn, tilt = rng.uniform(0.0, 2.0 * np.pi), np.radians(rng.uniform(0.0, 10.0))
        lean = np.array(
            [[np.cos(tilt), 0.0, np.sin(tilt)], [0.0, 1.0, 0.0], [-np.sin(tilt), 0.0, np.cos(tilt)]]
        )
        head = np.array(
            [[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]]
        )
        normals.append(np.array([c.normal for c in contacts]) @ (head @ lean).T)
        forces.append(landed[:, None] * np.array([c.force_n for c in contacts]) @ (head @ lean).T)
    normal, force = np.stack(normals), np.stack(forces)
    elastic = np.zeros((n, SCANS, 9))
    loaded = np.linalg.norm(force, axis=-1) > 0.0
    elastic[loaded] = sensed_closure_um(foot, normal[loaded], force[loaded])
    return Walks(force, elastic)


def last_scans(n: int) -> Callable[[Vector], Vector]:
    """Return what offers the n last scans, newest first: (walks, scans, 9) becomes (walks, scans, 9 n)."""

    def offer(seen: Vector) -> Vector:
        delayed = [
            np.concatenate([np.zeros_like(seen[:, :k]), seen[:, : SCANS - k]], axis=1) for k in range(n)
        ]
        return np.concatenate(delayed, axis=-1)

    return offer


def low_passed(seen: Vector) -> Vector:
    """Return the scan and the states of the low-pass filters, shape (walks, scans, 27)."""
    parts = [seen]
    for time_s in FILTERS_S:
        share = -np.expm1(-PERIOD_S / time_s)
        state, states = np.zeros_like(seen[:, 0]), np.empty_like(seen)
        for k in range(seen.shape[1]):
            state = state + share * (seen[:, k] - state)
            states[:, k] = state
        parts.append(states)
    return np.concatenate(parts, axis=-1)


def _undone(chain: tuple[Kelvin, ...]) -> Callable[[Vector], Vector]:
    """Return what takes the creep of a chain out of the scans."""
    return lambda seen: np.stack([uncrept_closure(walk, PERIOD_S, chain) for walk in seen])


def _features(offered: Any) -> tuple[Any, Any]:
    """Return pattern and size, shape (n, m + 1), and what scales the answer, shape (n, 1), of offered closures."""
    square = (offered**2).mean(axis=-1, keepdims=True)
    size = (square + SOFT_REL**2) ** 0.5
    module = jnp if isinstance(offered, jax.Array) else np
    return module.concatenate([offered / size, size], axis=-1), square / size


def taught(offered: Vector, force_n: Vector, steps: int) -> Callable[[Vector], Vector]:
    """Return a network like the shipped one, a linear path beside two hidden layers, for any number of inputs.

    Args:
        offered: Closures over the gap, shape (n, m).
        force_n: Forces [N], shape (n, 3).
        steps: Steps of Muon.
    """
    pattern, _ = _features(offered)
    variance, axes = np.linalg.eigh(np.cov(pattern.T))
    whiten = jnp.asarray(axes / np.sqrt(np.maximum(variance, 1e-7)), jnp.float32)
    mean = jnp.asarray(pattern.mean(axis=0), jnp.float32)
    weight = 1.0 / np.sqrt((force_n**2).sum(axis=1, keepdims=True) + FLOOR_N**2)
    line = np.linalg.lstsq(offered * weight, force_n * weight, rcond=None)[0]
    x, f = jnp.asarray(offered, jnp.float32), jnp.asarray(force_n, jnp.float32)
    keys = jax.random.split(jax.random.PRNGKey(20090304), 4)
    widths = (pattern.shape[1], HIDDEN, HIDDEN, 3)
    free = {
        "linear": jnp.asarray(line, jnp.float32),
        "weights": [
            jax.random.normal(key, pair) / np.sqrt(pair[0])
            for key, pair in zip(keys[:3], pairwise(widths), strict=True)
        ],
        "offsets": [jnp.zeros(width) for width in widths[1:]],
    }

    def answer(net: Any, closures: jax.Array) -> jax.Array:
        layer, scale = _features(closures)
        layer = (layer - mean) @ whiten
        for k in range(2):
            layer = jnp.tanh(layer @ net["weights"][k] + net["offsets"][k])
        return closures @ net["linear"] + scale * (layer @ net["weights"][2] + net["offsets"][2])

    def loss(net: Any, closures: jax.Array, force: jax.Array) -> jax.Array:
        square = ((answer(net, closures) - force) ** 2).sum(axis=-1)
        return (square / ((force**2).sum(axis=-1) + FLOOR_N**2)).mean()

    optimiser = optax.contrib.muon(optax.cosine_onecycle_schedule(steps, RATE, pct_start=0.1))

    def step(carry: tuple[Any, Any], key: jax.Array) -> tuple[tuple[Any, Any], None]:
        chosen = jax.random.randint(key, (BATCH,), 0, len(x))
        change, state = optimiser.update(jax.grad(loss)(carry[0], x[chosen], f[chosen]), carry[1], carry[0])
        return (optax.apply_updates(carry[0], change), state), None

    (net, _), _ = jax.jit(lambda carry, all_keys: jax.lax.scan(step, carry, all_keys))(
        (free, optimiser.init(free)), jax.random.split(keys[3], steps)
    )
    return lambda closures: np.asarray(answer(net, jnp.asarray(closures, jnp.float32)), dtype=np.float64)


class _Way(NamedTuple):
    """A way to read forces from scans: its name, the creep of the feet it learns from, and what it is offered."""

    name: str
    learnt: tuple[Kelvin, ...]
    offer: Callable[[Vector], Vector]
    before: Callable[[Vector], Vector]


def _as_seen(seen: Vector) -> Vector:
    """Return the scans as they are."""
    return seen


_WAYS = (
    _Way("this scan, learnt without creep", (), last_scans(1), _as_seen),
    _Way("this scan, learnt with creep", ASSUMED, last_scans(1), _as_seen),
    _Way("last 2 scans", ASSUMED, last_scans(2), _as_seen),
    _Way("last 4 scans", ASSUMED, last_scans(4), _as_seen),
    _Way("this scan and 2 low-pass states", ASSUMED, low_passed, _as_seen),
    _Way("this scan, creep undone by its chain", (), last_scans(1), _undone(ASSUMED)),
)
#: Each network takes seconds to compile.
_LEFT_OUT_QUICK = ("last 2 scans", "last 4 scans")
_CEILING = "this scan, no foot creeps"


class _Score(NamedTuple):
    """How wrong forces are: rms at load [N], mean angle at load [deg], rms in the air [N]."""

    loaded_n: float
    direction_deg: float
    air_n: float


def _score(truth: Vector, estimate: Vector) -> _Score:
    """Return the errors of forces [N], both of shape (walks, scans, 3)."""
    size = np.linalg.norm(truth, axis=-1)
    loaded, square = size > LOADED_N, ((estimate - truth) ** 2).sum(axis=-1)
    return _Score(
        float(np.sqrt(square[loaded].mean())),
        errors(truth[loaded], estimate[loaded]).direction_deg,
        float(np.sqrt(square[size == 0.0].mean())),
    )


def _read(net: Callable[[Vector], Vector], offered: Vector) -> Vector:
    """Return forces [N], shape (walks, scans, 3), of offered closures, shape (walks, scans, m)."""
    return net(offered.reshape(-1, offered.shape[-1])).reshape(*offered.shape[:2], 3)


def _figure(walk: Vector, estimates: dict[str, Vector]) -> Figure:
    """Return one walk's force and the error of each way over time."""
    figure = Figure(figsize=(8.4, 5.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(1, 2))
    time_s = PERIOD_S * np.arange(SCANS)
    upper.plot(time_s, np.linalg.norm(walk, axis=-1), "k-")
    upper.set_ylabel("|force| [N]")
    for name, estimate in estimates.items():
        off_mn = 1e3 * np.linalg.norm(estimate - walk, axis=-1)
        lower.semilogy(time_s, np.maximum(off_mn, 0.1), lw=1.2, label=name)
    lower.set(xlabel="time [s]", ylabel="error of the force [mN]")
    lower.legend(fontsize=8, ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.16))
    for axes in (upper, lower):
        axes.grid(alpha=0.3)
    return figure


def page(bench: Workbench) -> Page:
    """Return the page."""
    quick, design = bench.quick, bench.response.design
    steps, foot = QUICK_STEPS if quick else STEPS, Foot(bench.response)
    learnt = _walked(foot, _made_up, QUICK_WALKS if quick else WALKS, 1)
    asked = _walked(foot, _measured, QUICK_ASKED if quick else ASKED, 2)
    bench.say(f"history: {len(learnt.force_n)} walks to learn from, {len(asked.force_n)} to be asked")
    nets: dict[tuple[Any, ...], Callable[[Vector], Vector]] = {}
    scores: dict[str, tuple[_Score, _Score]] = {}
    drawn, n_inputs = {}, {}
    ways = [way for way in _WAYS if not (quick and way.name in _LEFT_OUT_QUICK)]
    for way in ways:
        key = (way.learnt, way.offer)
        if key not in nets:
            offered = way.offer(learnt.seen_rel(design, way.learnt, 3))
            nets[key] = taught(offered.reshape(-1, offered.shape[-1]), learnt.force_n.reshape(-1, 3), steps)
            bench.say(f"history: {way.name} has learnt")
        offers = [way.offer(way.before(asked.seen_rel(design, chain, 4))) for chain in (ASSUMED, OTHER)]
        same, other = (_read(nets[key], offered) for offered in offers)
        scores[way.name] = _score(asked.force_n, same), _score(asked.force_n, other)
        drawn[way.name], n_inputs[way.name] = same[0], offers[0].shape[-1]
    still = _read(nets[_WAYS[0].learnt, _WAYS[0].offer], asked.seen_rel(design, (), 4))
    ceiling = _score(asked.force_n, still)
    rows = [[_CEILING, "9", *_cells(ceiling), "-", "-"]]
    rows += [[name, f"{n_inputs[name]}", *_cells(a), *_cells(b)[:2]] for name, (a, b) in scores.items()]
    header = ["read from", "inputs", "at load [mN rms]", "direction [deg]", "in the air [mN rms]"]
    alone, best = scores[_WAYS[1].name][0], scores[_WAYS[4].name][0]  # rows of the table, in its order
    undone = scores[_WAYS[5].name]
    filters = " and ".join(f"{time_s:g}" for time_s in FILTERS_S)
    chain = " and ".join(f"{100 * part.share_rel:g} % with {part.time_s:g} s" for part in ASSUMED)
    body = f"""
{"**Quick run: few walks and steps. The figures are not those of the study.**" if quick else ""}

Rubber creeps: a closure grows for a while under a load that stands still, and lingers after lift-off. Then one scan no
longer tells the force. Does a short history? The chain is *assumed*, {chain} on top of every elastic closure;
no foot was measured. A scan of nine conversions takes {1e3 * PERIOD_S:g} ms; the skew within it is left out, no gap
shuts, the converter's noise is in. Each network has two hidden layers of {HIDDEN} units beside a linear path and learnt
in {steps} steps from {len(learnt.force_n)} made-up walks with rounded stances up to {LARGEST_N[1]:g} N. Asked are
{len(asked.force_n)} *measured* walks in random headings, whose stances none of them has seen. The low-pass filters have
{filters} s, not the times of the chain. The last two columns are feet that creep 30 % more and 30 % more slowly than
those learnt from.

{table([*header, "other feet: at load [mN rms]", "direction [deg]"], rows)}

![]({_FIGURE})

Low-pass states bring the error at load from {1e3 * alone.loaded_n:.1f} mN (this scan alone, knowing of creep) to
{1e3 * best.loaded_n:.1f} mN, by a factor of {alone.loaded_n / best.loaded_n:.1f}; in the air from
{1e3 * alone.air_n:.1f} to {1e3 * best.air_n:.1f} mN. Taking the creep out by its chain (two states per element, no
training) leaves {1e3 * undone[0].loaded_n:.1f} mN when the chain is the foot's own, and
{1e3 * undone[1].loaded_n:.1f} mN when it is not; without creep {1e3 * ceiling.loaded_n:.1f} mN are left. The last scans
alone span at most a tenth of a second.
"""
    values = {
        "quick": quick,
        "steps": steps,
        "without_creep": ceiling._asdict(),
        "ways": {name: {"same": a._asdict(), "other": b._asdict()} for name, (a, b) in scores.items()},
    }
    figures = {_FIGURE: _figure(asked.force_n[0], drawn)}
    return Page(name="history", title="Does a history pay", body=body, figures=figures, values=values)


def _cells(score: _Score) -> list[str]:
    """Return a score as cells of the table."""
    return [f"{1e3 * score.loaded_n:.2f}", f"{score.direction_deg:.3f}", f"{1e3 * score.air_n:.2f}"]
