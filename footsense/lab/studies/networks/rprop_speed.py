"""Study `rprop-speed`: epochs and time of RPROP compared with gradient-descent back-propagation.

Source:
    Aoyagi et al., section III D. Back-propagation: D. E. Rumelhart, G. E. Hinton and R. J. Williams, "Learning
    representations by back-propagating errors", Nature 323, 1986, equations 8 and 9.
"""

from dataclasses import dataclass

import jax
import numpy as np
import optax
from matplotlib.figure import Figure

from footsense.frames import Vector
from footsense.lab.former_page import Plots, Study, StudyContext
from footsense.lab.plots import subplot_row
from footsense.lab.training.load_cases import paper_training
from footsense.lab.training.paper.mlp import Layers, TrainedNetworks, stack, train
from footsense.lab.training.paper.procedure import HIDDEN_NEURONS, PaperTraining, start_weights_by_seed
from footsense.lab.training.paper.rprop import RPROP

#: Learning rates to choose from, for networks whose loss is the mean square over the cases.
LEARNING_RATES = (0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.7)
#: The usual momentum.
MOMENTUM = 0.9
#: Epochs of each rule.
EPOCHS, QUICK_EPOCHS = 10_000, 1000
#: Networks, which differ in their start weights; the same for each rule.
SEEDS, QUICK_SEEDS = 5, 2

_RPROP = "RPROP"


@dataclass(frozen=True, slots=True, kw_only=True)
class RpropComparison:
    """Epochs and time until RPROP reaches gradient descent's final loss, medians over seeds.

    Attributes:
        learning_rate: Learning rate of back-propagation.
        goal_loss: That loss [1].
        descent_epochs_to_goal: Epochs of back-propagation.
        rprop_epochs_to_goal: Epochs of RPROP; a seed that never reaches the loss counts with all of them.
        n_reached_goal: Seeds that reach it by RPROP.
        descent_over_rprop_epochs: Ratio of the epochs [1].
        descent_over_rprop_epochs_min: The lowest ratio of a seed.
        descent_over_rprop_epochs_max: The highest ratio of a seed.
        descent_time_to_goal_s: Processor time of back-propagation [s].
        rprop_time_to_goal_s: Processor time of RPROP [s].
    """

    learning_rate: float
    goal_loss: float
    descent_epochs_to_goal: float
    rprop_epochs_to_goal: float
    n_reached_goal: int
    descent_over_rprop_epochs: float
    descent_over_rprop_epochs_min: float
    descent_over_rprop_epochs_max: float
    descent_time_to_goal_s: float
    rprop_time_to_goal_s: float


@dataclass(frozen=True, kw_only=True)
class Results:
    """Results of the study `rprop-speed`: one comparison per variant of gradient descent.

    Attributes:
        epochs: Epochs of each rule.
        seeds: Networks.
        epoch_us: Processor time of an epoch of one network [us], by rule.
        comparisons: By rule.
    """

    epochs: int
    seeds: int
    epoch_us: dict[str, float]
    comparisons: dict[str, RpropComparison]


def _train_gradient_descent(
    training: PaperTraining, starts: list[Layers], momentum: float, epochs: int
) -> tuple[float, TrainedNetworks]:
    """Return the learning rate with the lowest median final loss, and the networks trained with it."""
    rule = optax.inject_hyperparams(optax.sgd)(learning_rate=0.0, momentum=momentum)
    layers, rates = (
        stack([one for _ in LEARNING_RATES for one in starts]),
        np.repeat(LEARNING_RATES, len(starts)),
    )
    state = jax.vmap(rule.init)(layers)
    state.hyperparams["learning_rate"] = rates.astype(np.float32)
    trained = train(rule, layers, training.inputs, training.targets, epochs, state)
    losses = trained.losses.reshape(len(LEARNING_RATES), len(starts), epochs)
    # A rate at which the loss of one seed overflows is of no use.
    final = np.median(np.nan_to_num(losses[:, :, -1], nan=np.inf), axis=1)
    best = int(np.where(np.isfinite(losses[:, :, -1]).all(axis=1), final, np.inf).argmin())
    return LEARNING_RATES[best], trained._replace(
        losses=losses[best], processor_s=trained.processor_s / len(LEARNING_RATES)
    )


def _epochs_to_loss(losses: Vector, goal: Vector) -> Vector:
    """Return the epochs until each network reaches its goal loss, shape (seeds,); all epochs if never."""
    there = losses <= goal[:, None]
    epochs = np.where(there.any(axis=1), there.argmax(axis=1), losses.shape[1])
    return np.asarray(epochs, dtype=np.float64)


def _compare_with_rprop(rate: float, descent: TrainedNetworks, rprop: TrainedNetworks) -> RpropComparison:
    """Return epochs and time of gradient descent and RPROP to the same loss, from equal start weights."""
    goal = descent.losses[:, -1]
    slow, fast = _epochs_to_loss(descent.losses, goal), _epochs_to_loss(rprop.losses, goal)
    return RpropComparison(
        learning_rate=rate,
        goal_loss=float(np.median(goal)),
        descent_epochs_to_goal=float(np.median(slow)),
        rprop_epochs_to_goal=float(np.median(fast)),
        n_reached_goal=int((rprop.losses.min(axis=1) <= goal).sum()),
        descent_over_rprop_epochs=float(np.median(slow / fast)),
        descent_over_rprop_epochs_min=float((slow / fast).min()),
        descent_over_rprop_epochs_max=float((slow / fast).max()),
        descent_time_to_goal_s=float(np.median(slow)) * _epoch_s(descent),
        rprop_time_to_goal_s=float(np.median(fast)) * _epoch_s(rprop),
    )


def _epoch_s(trained: TrainedNetworks) -> float:
    """Return the processor time per epoch of one network [s]."""
    return trained.processor_s / trained.losses.size


def compute(context: StudyContext) -> tuple[Results, Plots]:
    """Return the comparison of gradient descent, with and without momentum, with RPROP, and a figure."""
    seeds, epochs = (QUICK_SEEDS, QUICK_EPOCHS) if context.quick else (SEEDS, EPOCHS)
    training = PaperTraining(context.response.design, paper_training(context.response))
    starts = start_weights_by_seed(seeds)
    rprop = train(RPROP, stack(starts), training.inputs, training.targets, epochs)
    context.report_progress("rprop-speed: RPROP trained")
    runs, races = {}, {}
    for name, momentum in (("back-propagation", 0.0), (f"the same with momentum {MOMENTUM:g}", MOMENTUM)):
        rate, runs[name] = _train_gradient_descent(training, starts, momentum, epochs)
        races[name] = _compare_with_rprop(rate, runs[name], rprop)
        context.report_progress(f"rprop-speed: {name}, best of {len(LEARNING_RATES)} rates: {rate:g}")
    runs[_RPROP] = rprop
    epoch_us = {name: 1e6 * _epoch_s(run) for name, run in runs.items()}
    return Results(epochs=epochs, seeds=seeds, epoch_us=epoch_us, comparisons=races), {
        "rprop-speed.png": _figure(runs)
    }


def _figure(runs: dict[str, TrainedNetworks]) -> Figure:
    """Plot the training loss over the epochs, one curve per rule: median over the seeds, and their range."""
    figure, (axes,) = subplot_row(1, 7.6, 4.4)
    for name, run in runs.items():
        epoch = np.arange(1, run.losses.shape[1] + 1)
        (line,) = axes.plot(epoch, np.median(run.losses, axis=0), label=name)
        low, high = run.losses.min(axis=0), run.losses.max(axis=0)
        axes.fill_between(epoch, low, high, color=line.get_color(), alpha=0.2, lw=0)
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="epochs",
        ylabel="loss: squared error over squared largest force [1]",
    )
    axes.legend()
    return figure


STUDY = Study(
    name="rprop-speed",
    title="RPROP against back-propagation",
    compute=compute,
    template_names={"HIDDEN_NEURONS": HIDDEN_NEURONS},
    uses_network=False,
)
