"""Study `rprop-speed` (section III D): how much sooner RPROP is there than back-propagation."""

from dataclasses import asdict, dataclass
from typing import Self

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from footsense.lab.studies.page import Page, Workbench, table
from footsense.lab.training.gradient_descent import descent_start, descent_step
from footsense.lab.training.load_cases import paper_training
from footsense.lab.training.mlp import Layers, learn, stack, start_layers
from footsense.lab.training.paper_procedure import HIDDEN, Lesson
from footsense.lab.training.rprop import rprop_start, rprop_step

#: Learning rates to choose from, for networks whose loss is the mean square over the cases.
RATES = (0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.7)
#: The usual momentum.
MOMENTUM = 0.9
#: Epochs that each rule has.
EPOCHS, QUICK_EPOCHS = 10_000, 1000
#: Networks, which differ in their start weights; the same for each rule.
SEEDS, QUICK_SEEDS = 5, 2

_FIGURE = "rprop-speed.png"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Run:
    """What one rule made of the networks.

    Attributes:
        losses: Loss before each epoch, shape (seeds, epochs).
        epoch_s: Processor time of an epoch of one network [s].
        rate: Learning rate; None for RPROP, which needs none.
    """

    losses: NDArray[np.float64]
    epoch_s: float
    rate: float | None = None

    def epochs_to(self, goal: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return after how many epochs each seed is first at its goal, shape (seeds,); all epochs where it never is."""
        there = self.losses <= goal[:, None]
        epochs = np.where(there.any(axis=1), there.argmax(axis=1), self.losses.shape[1])
        return np.asarray(epochs, dtype=np.float64)


def _descent(lesson: Lesson, starts: list[Layers], momentum: float, epochs: int) -> Run:
    """Return the run with the rate whose loss at the end, median over the seeds, is the lowest."""
    layers = stack([one for _ in RATES for one in starts])
    rates = np.repeat(RATES, len(starts))
    memory = descent_start(layers, rates, np.full(len(rates), momentum))
    learnt = learn(descent_step, layers, memory, lesson.inputs, lesson.targets, epochs)
    losses = learnt.losses.reshape(len(RATES), len(starts), epochs)
    # A rate at which one seed's loss overflows is no rate to work with.
    final = np.median(np.nan_to_num(losses[:, :, -1], nan=np.inf), axis=1)
    best = int(np.where(np.isfinite(losses[:, :, -1]).all(axis=1), final, np.inf).argmin())
    return Run(losses=losses[best], epoch_s=learnt.processor_s / learnt.losses.size, rate=RATES[best])


def _rprop(lesson: Lesson, starts: list[Layers], epochs: int) -> Run:
    """Return the run of RPROP."""
    layers = stack(starts)
    learnt = learn(rprop_step, layers, rprop_start(layers), lesson.inputs, lesson.targets, epochs)
    return Run(losses=learnt.losses, epoch_s=learnt.processor_s / learnt.losses.size)


def _figure(runs: dict[str, Run]) -> Figure:
    """Return the loss over the epochs: median, and from the lowest to the highest seed as a band."""
    figure = Figure(figsize=(7.6, 4.4), layout="constrained")
    axes = figure.subplots()
    for name, run in runs.items():
        epoch = np.arange(1, run.losses.shape[1] + 1)
        (line,) = axes.plot(epoch, np.median(run.losses, axis=0), label=name)
        axes.fill_between(
            epoch, run.losses.min(axis=0), run.losses.max(axis=0), color=line.get_color(), alpha=0.2, lw=0
        )
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="epochs",
        ylabel="loss: squared error over squared largest force [1]",
    )
    axes.grid(alpha=0.3, which="major")
    axes.legend()
    return figure


@dataclass(frozen=True, slots=True, kw_only=True)
class Race:
    """Back-propagation against RPROP to the loss that back-propagation has at its end; medians over the seeds.

    Attributes:
        goal: That loss [1].
        descent_epochs: Epochs of back-propagation until there.
        rprop_epochs: Epochs of RPROP until there; a seed that never is counts with all of them.
        n_there: Seeds that get there by RPROP.
        times_fewer: Ratio of the epochs [1].
        least_fewer: The same, the seed with the lowest ratio.
        most_fewer: The same, the seed with the highest ratio.
        descent_s: Processor time of back-propagation [s].
        rprop_s: Processor time of RPROP [s].
    """

    goal: float
    descent_epochs: float
    rprop_epochs: float
    n_there: int
    times_fewer: float
    least_fewer: float
    most_fewer: float
    descent_s: float
    rprop_s: float

    @classmethod
    def between(cls, descent: Run, rprop: Run) -> Self:
        """Return the race of two runs with the same start weights."""
        goal = descent.losses[:, -1]
        slow, fast = descent.epochs_to(goal), rprop.epochs_to(goal)
        fewer = slow / fast
        return cls(
            goal=float(np.median(goal)),
            descent_epochs=float(np.median(slow)),
            rprop_epochs=float(np.median(fast)),
            n_there=int((rprop.losses.min(axis=1) <= goal).sum()),
            times_fewer=float(np.median(fewer)),
            least_fewer=float(fewer.min()),
            most_fewer=float(fewer.max()),
            descent_s=float(np.median(slow)) * descent.epoch_s,
            rprop_s=float(np.median(fast)) * rprop.epoch_s,
        )


def _verdict(races: dict[str, Race]) -> str:
    """Hold the ratios of the epochs against the paper's words, taken as 20 to 99."""
    lines = []
    for name, race in races.items():
        right = "right" if round(race.times_fewer) in range(20, 100) else "not so"
        lines.append(
            f"- *Several tens of times* against {name}: {right}, {race.times_fewer:.1f} times fewer epochs."
        )
    return "\n".join(lines)


def page(bench: Workbench) -> Page:
    """Return the page."""
    quick = bench.quick
    seeds, epochs = (QUICK_SEEDS, QUICK_EPOCHS) if quick else (SEEDS, EPOCHS)
    lesson = Lesson(bench.response.design, paper_training(bench.response))
    starts = [start_layers(np.random.default_rng(seed), (9, *HIDDEN, 3)) for seed in range(seeds)]
    runs = {}
    for name, momentum in (("back-propagation", 0.0), (f"the same with momentum {MOMENTUM:g}", MOMENTUM)):
        runs[name] = _descent(lesson, starts, momentum, epochs)
        bench.say(f"rprop-speed: {name}, best of {len(RATES)} rates: {runs[name].rate:g}")
    rprop = _rprop(lesson, starts, epochs)
    bench.say("rprop-speed: RPROP has learnt")
    races = {name: Race.between(run, rprop) for name, run in runs.items()}
    rows = [
        [
            name,
            f"{runs[name].rate:g}",
            f"{race.goal:.1e}",
            f"{race.descent_epochs:.0f}",
            f"{race.rprop_epochs:.0f} ({race.n_there} of {seeds} there)",
            f"{race.times_fewer:.1f} ({race.least_fewer:.1f} to {race.most_fewer:.1f})",
            f"{race.descent_s:.3f}",
            f"{race.rprop_s:.3f}",
            f"{race.descent_s / race.rprop_s:.1f}",
        ]
        for name, race in races.items()
    ]
    header = [
        "against",
        "best rate",
        "loss",
        "its epochs",
        "RPROP's",
        "times fewer",
        "its time [s]",
        "RPROP's [s]",
    ]
    per_epoch = ", ".join(
        f"{run.epoch_s * 1e6:.0f} us ({name})" for name, run in [*runs.items(), ("RPROP", rprop)]
    )
    body = f"""
{"**Quick run: few seeds, few epochs. The figures are not those of the study.**" if quick else ""}

The paper (section III D) takes RPROP because it converges several tens of times faster than back-propagation. Here:
networks 9-{HIDDEN[0]}-{HIDDEN[1]}-3 on the 362 cases, {seeds} seeds, {epochs} epochs for each rule, the same start
weights. Back-propagation gets the best of {len(RATES)} fixed learning rates from {RATES[0]:g} to {RATES[-1]:g}, found
on these very cases; the search is not counted, and RPROP needs none. Both then race to the loss at which
back-propagation ends; a seed that RPROP does not take there counts with all {epochs} epochs. Medians over the seeds, in
brackets the lowest and the highest ratio; time is processor time.

{table([*header, "times less"], rows)}

![]({_FIGURE})

{_verdict(races)}

One epoch of one network takes {per_epoch} of processor time.
"""
    all_runs = {**runs, "RPROP": rprop}
    return Page(
        name="rprop-speed",
        title="RPROP against back-propagation",
        body=body,
        figures={_FIGURE: _figure(all_runs)},
        values={
            "quick": quick,
            "epochs": epochs,
            "seeds": seeds,
            "rates": {name: run.rate for name, run in runs.items()},
            "epoch_us": {name: run.epoch_s * 1e6 for name, run in all_runs.items()},
            "races": {name: asdict(race) for name, race in races.items()},
        },
    )
