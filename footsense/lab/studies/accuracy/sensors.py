"""Study `sensors` (sections III B to E, Figs. 5, 6 and 8, Table I): how many elements, and how large."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from footsense.foot.symmetry import mirrored_series
from footsense.lab.evaluation.evaluate import errors
from footsense.lab.fem.block import BLOCK_SIZE, COARSE_BLOCK, Column, block_fields
from footsense.lab.fem.mesh import MeshSize
from footsense.lab.geometry import SoleDesign
from footsense.lab.monte_carlo.statistics import Spread
from footsense.lab.response import DEGREE, add_series, fit_class, patch_mean, transposed_series
from footsense.lab.studies.page import Page, Workbench, table
from footsense.lab.training.load_cases import GRAM_FORCE_N, directions
from footsense.lab.training.mlp import forward, learn, stack, start_layers, unstack
from footsense.lab.training.rprop import rprop_start, rprop_step

Vector = NDArray[np.float64]

#: Force of the contacts [gf]: patterns are divided by their maximum, so that it sets the size of the patch alone.
FORCE_GF = 100.0
#: Random error of each element [1], rms of its own output.
NOISE_REL = 0.05
#: Neurons of the two hidden layers, the same for all sensors.
HIDDEN = (18, 18)
#: Networks for each sensor, and epochs of learning.
SEEDS, QUICK_SEEDS = 5, 3
EPOCHS, QUICK_EPOCHS = 2000, 500
#: Seed of the random errors.
NOISE_SEED = 5
#: A difference counts from this many of its standard errors on.
SURE = 2.0
#: Saturated is what gains less than this of the step from 4 to 9 elements [1].
SATURATED_REL = 0.2

_FIGURE = "sensors.png"


@dataclass(frozen=True, slots=True)
class Sensor:
    """An array that reads the block (Fig. 6).

    Attributes:
        name: The paper's letter.
        per_side: Elements along a side.
        side_mm: Side of an element [mm].
        pitch_mm: Distance of neighbouring elements [mm].
    """

    name: str
    per_side: int
    side_mm: float
    pitch_mm: float

    def halves_mm(self) -> list[tuple[float, float]]:
        """Return the borders of the elements, or parts of them, on the positive half axis, from the edge inwards."""
        centres = [self.pitch_mm * ((self.per_side - 1) / 2.0 - k) for k in range((self.per_side + 1) // 2)]
        return [(max(0.0, c - self.side_mm / 2.0), c + self.side_mm / 2.0) for c in centres]

    def columns(self) -> list[Column]:
        """Return the columns of the quarter, those of one x after the other."""
        halves = self.halves_mm()
        return [Column(x, y) for x in halves for y in halves]


#: A to C have their elements at the centres of F to H, which have the largest that leave bars of 1 mm between them, as
#: G has; D and E reach to the edge of the block.
SENSORS = (
    Sensor("A", 2, 1.0, 7.5),
    Sensor("B", 3, 1.0, 5.0),
    Sensor("C", 5, 1.0, 3.0),
    Sensor("D", 7, 1.0, 13.0 / 6.0),
    Sensor("E", 9, 1.0, 13.0 / 8.0),
    Sensor("F", 2, 6.5, 7.5),
    Sensor("G", 3, 4.0, 5.0),
    Sensor("H", 5, 2.0, 3.0),
)
QUICK_NAMES = "ABFG"
#: Pairs with as many elements, the smaller ones first.
PAIRS = (("A", "F"), ("B", "G"), ("C", "H"))


def _whole(quarter: Vector, per_side: int) -> Vector:
    """Return the series of all elements, shape (products, n, n, 3), from those of the quarter.

    The two or four parts of an element that a mirror plane cuts are as large, so that it feels their mean.
    """
    half = np.concatenate([quarter, mirrored_series(quarter, DEGREE, 0)[:, ::-1]], axis=1)
    parts = np.concatenate([half, mirrored_series(half, DEGREE, 1)[:, :, ::-1]], axis=2)
    for axis in (1, 2) if per_side % 2 else ():
        middle = per_side // 2
        mean = parts.take([middle, middle + 1], axis).mean(axis=axis, keepdims=True)
        outer = (parts.take(range(middle), axis), parts.take(range(middle + 2, per_side + 1), axis))
        parts = np.concatenate([outer[0], mean, outer[1]], axis=axis)
    return parts


def sensor_series(sole: SoleDesign, sensors: Sequence[Sensor], size: MeshSize) -> dict[str, Vector]:
    """Return the mean stress of each sensor's elements as series [MPa/N], shapes (products, n, n, 3)."""
    fields = block_fields(sole, [column for sensor in sensors for column in sensor.columns()], size)
    fitted = {parity: fit_class(field) for parity, field in fields.items()}
    series, first = {}, 0
    for sensor in sensors:
        m = len(sensor.halves_mm())
        own = {parity: part[:, first : first + m * m].reshape(-1, m, m, 3) for parity, part in fitted.items()}
        first += m * m
        raw = add_series(own, DEGREE)
        series[sensor.name] = _whole((raw + transposed_series(raw, DEGREE)) / 2.0, sensor.per_side)
    return series


def patterns(sole: SoleDesign, series: Vector, direction: Vector) -> Vector:
    """Return pressures [MPa], shape (n, elements), under centred contacts with a Hertz patch."""
    force_n = FORCE_GF * GRAM_FORCE_N
    radius_mm = float(np.cbrt(0.75 * sole.ball_radius_mm / sole.rubber.hertz_mpa * force_n))
    unit = patch_mean(series.reshape(len(series), -1), direction, radius_mm, sole)
    stress_mpa = (unit.reshape(len(direction), -1, 3) * direction[:, None, :]).sum(axis=2)
    pressure_mpa: Vector = -force_n * stress_mpa
    return pressure_mpa


def protocol() -> tuple[Vector, Vector]:
    """Return the 181 taught and the 180 asked directions of sections III A and B."""

    def ring(shift_deg: float) -> Vector:
        azimuth, elevation = np.meshgrid(
            shift_deg + 10.0 * np.arange(36), shift_deg + 40.0 + 10.0 * np.arange(5), indexing="ij"
        )
        return directions(azimuth.ravel(), elevation.ravel())

    return np.concatenate([ring(0.0), [[0.0, 0.0, 1.0]]]), ring(5.0)


def _fed(pressure: Vector, noise_rel: float, rng: np.random.Generator) -> Vector:
    """Return patterns with random errors, each divided by its maximum."""
    erring = pressure * (1.0 + noise_rel * rng.normal(size=pressure.shape))
    fed: Vector = erring / np.abs(erring).max(axis=1, keepdims=True)
    return fed


def direction_errors(taught: Vector, asked: Vector, noise_rel: float, seeds: int, epochs: int) -> Spread:
    """Return the mean direction error of networks that differ in their start weights [deg].

    Args:
        taught: Pressures of the taught directions, shape (181, elements).
        asked: Pressures of the asked directions, shape (180, elements).
        noise_rel: Random error of both [1].
        seeds: Networks.
        epochs: Of learning.
    """
    train_n, ask_n = protocol()
    rng = np.random.default_rng(NOISE_SEED)
    inputs, questions = _fed(taught, noise_rel, rng), _fed(asked, noise_rel, rng)
    widths = (taught.shape[1], *HIDDEN, 3)
    starts = stack([start_layers(np.random.default_rng(seed), widths) for seed in range(seeds)])
    learnt = learn(rprop_step, starts, rprop_start(starts), inputs, train_n, epochs)
    answers = [
        np.asarray(forward(network, questions.astype(np.float32)), float)
        for network in unstack(learnt.layers)
    ]
    return Spread.over(errors(ask_n, answer).direction_deg for answer in answers)


def _figure(results: dict[str, tuple[Spread, Spread]]) -> Figure:
    """Return the direction error over the number of elements, small and large ones, without and with errors."""
    figure = Figure(figsize=(8.2, 3.9), layout="constrained")
    titles = ("no random error", f"{NOISE_REL:.0%} random error")
    for which, (axes, title) in enumerate(zip(figure.subplots(1, 2), titles, strict=True)):
        for names, marker, label in (("ABCDE", "o-", "1 mm elements"), ("FGH", "s--", "larger elements")):
            known = [sensor for sensor in SENSORS if sensor.name in names and sensor.name in results]
            number = [sensor.per_side**2 for sensor in known]
            spreads = [results[sensor.name][which] for sensor in known]
            mean, deviation = ([getattr(s, part) for s in spreads] for part in ("mean", "deviation"))
            axes.errorbar(number, mean, deviation, fmt=marker, capsize=3, ms=5, label=label)
            for sensor, x, y in zip(known, number, mean, strict=True):
                axes.annotate(sensor.name, (x, y), xytext=(4, 5), textcoords="offset points", fontsize=8)
        axes.set(title=title, xlabel="elements", ylabel="mean direction error [deg]", xscale="log")
        axes.set_xticks([4, 9, 25, 49, 81], ["4", "9", "25", "49", "81"])
        axes.minorticks_off()
        axes.set_ylim(bottom=0.0)
        axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    return figure


def _against(first: Spread, second: Spread) -> str:
    """Say by how much the first mean is above the second, and whether that is more than chance."""
    excess, error = first.excess(second)
    sure = "more" if abs(excess) > SURE * error else "no more"
    return f"{excess:+.3f} ± {error:.3f} deg ({sure} than chance)"


def _holds(*, true: bool) -> str:
    """Say whether a statement holds."""
    return "holds" if true else "does not hold"


def _findings(results: dict[str, tuple[Spread, Spread]]) -> str:
    """Put the paper's statements about Fig. 8 to the test."""
    lines = []
    for which, title in enumerate(("Without random error", f"With {NOISE_REL:.0%}")):
        of = {name: spreads[which] for name, spreads in results.items()}
        most = max(name for name in of if name in "ABCDE")
        first, rest = of["A"].mean - of["B"].mean, of["B"].mean - of[most].mean
        if most > "B":
            lines.append(
                f"- **{title}, number.** From 4 to 9 elements (A to B) the error falls by {first:.2f} deg, from B to "
                f"{most} by another {rest:.2f} deg. That it saturates beyond about 10 "
                f"{_holds(true=rest < SATURATED_REL * first)}, if saturated is what gains less than "
                f"{SATURATED_REL:.0%} of the first step."
            )
        pairs = [(small, large) for small, large in PAIRS if small in of and large in of]
        gains = [of[small].mean - of[large].mean for small, large in pairs]
        not_worse = all(
            gain > -SURE * of[s].excess(of[b])[1] for gain, (s, b) in zip(gains, pairs, strict=True)
        )
        said = "; ".join(f"{small} minus {large} {_against(of[small], of[large])}" for small, large in pairs)
        lines.append(
            f"- **{title}, area.** {said}. That a larger area is better, or no worse than chance, "
            f"{_holds(true=not_worse)} for all of these; that it is conspicuous for 4 elements alone, at least "
            f"{SURE:g} times what the others gain, {_holds(true=gains[0] > SURE * max(0.0, *gains[1:]))}."
        )
    return "\n".join(lines)


def page(bench: Workbench) -> Page:
    """Return the page."""
    sole, quick = bench.sole, bench.quick
    sensors = [sensor for sensor in SENSORS if not quick or sensor.name in QUICK_NAMES]
    seeds, epochs = (QUICK_SEEDS, QUICK_EPOCHS) if quick else (SEEDS, EPOCHS)
    series = sensor_series(sole, sensors, COARSE_BLOCK if quick else BLOCK_SIZE)
    bench.say(f"sensors: stresses of {len(sensors)} sensors solved")
    taught, asked = protocol()
    results = {}
    for sensor in sensors:
        cases = [patterns(sole, series[sensor.name], direction) for direction in (taught, asked)]
        results[sensor.name] = (
            direction_errors(cases[0], cases[1], 0.0, seeds, epochs),
            direction_errors(cases[0], cases[1], NOISE_REL, seeds, epochs),
        )
        bench.say(f"sensors: {sensor.name} has learnt")
    rows = [
        [
            sensor.name,
            str(sensor.per_side**2),
            f"{sensor.side_mm:g}",
            f"{sensor.pitch_mm:.3g}",
            *(f"{spread.mean:.3f} ± {spread.deviation:.3f}" for spread in results[sensor.name]),
        ]
        for sensor in sensors
    ]
    thick_mm = 2.0 * sole.plate_mm + sole.spacer_mm
    factors = ", ".join(f"{name} {noisy.mean / clean.mean:.1f}" for name, (clean, noisy) in results.items())
    largest = max(noisy.mean / clean.mean for clean, noisy in results.values())
    header = ["sensor", "elements", "side [mm]", "pitch [mm]", "clean [deg]", f"{NOISE_REL:.0%} error [deg]"]
    body = f"""
{"**Quick run: four sensors, a coarse mesh, few seeds and epochs.**" if quick else ""}

Before the paper settles on 3 x 3 elements of 4 mm, it reads a plain block of PDMS between the hemispheres with eight
assumed sensors (sections III B to E). Ours: a block of {sole.sheet_mm:g} mm, {thick_mm:g} mm thick; the mean of sigma_z
over each element and through the thickness, from adjoint solves; centred contacts with the Hertz patch of
{FORCE_GF:g} gf; {len(taught)} directions taught and {len(asked)} asked; each pattern divided by its largest value.
Networks n-{HIDDEN[0]}-{HIDDEN[1]}-3, RPROP, {epochs} epochs, {seeds} start weights; mean ± deviation between them. The
random error is normal, {NOISE_REL:.0%} rms of each element's own output, in taught and asked patterns alike.

The paper's drawing gives no sizes for F to H nor pitches. Chosen here: A to C at the centres of F to H, and these the
largest that leave bars of 1 mm between them, as 4 mm do for G; D and E reach to the edge.

{table(header, rows)}

![]({_FIGURE})

The paper says that the error falls with the number of elements and saturates beyond about 10, that a larger area is
better, conspicuously so only with 4 elements, and that 5 % random error changes next to nothing.

{_findings(results)}
- **Random error.** With it the error is larger by these factors: {factors}.
  That it changes next to nothing {_holds(true=largest < SURE)} for our block, if that means by less than {SURE:g}.
"""
    values = {
        name: {"clean_deg": clean.json(), "noisy_deg": noisy.json()}
        for name, (clean, noisy) in results.items()
    }
    return Page(
        name="sensors",
        title="How many elements, and how large",
        body=body,
        figures={_FIGURE: _figure(results)},
        values={"quick": quick, "epochs": epochs, "seeds": seeds, "noise_rel": NOISE_REL, "sensors": values},
    )
