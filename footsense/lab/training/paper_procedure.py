"""The paper's training procedure: a plain network from capacitances to forces, RPROP, 362 training cases.

It uses nothing of what the other networks know about the foot: ΔC unless closures are chosen, no symmetry, no linear
path. Inputs and forces are divided by the largest of the training cases.

Source:
    Aoyagi et al., sections III D to III G.
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from footsense.foot.capacitor import Capacitor
from footsense.frames import Vector
from footsense.lab.evaluation.evaluate_models import ForceEstimator
from footsense.lab.training.load_cases import Cases, closure_of_designed_foot_um
from footsense.lab.training.paper_network import (
    RPROP,
    Layers,
    network_outputs,
    random_layers,
    stack,
    train,
    unstack,
)

#: Inputs of a network: capacitance changes, as in the paper, or the gap closures that elastance measures.
NetworkInput = Literal["capacitance", "closure"]

#: Neurons of the two hidden layers, twice the inputs; the paper found its own by trial and error (Table I).
HIDDEN_NEURONS = (18, 18)
#: Epochs of training; the paper states none. Four times as many change the errors by less than the seeds do.
EPOCHS = 5000


class PaperTraining:
    """Training set for plain networks: scaled inputs (capacitance changes or closures) and forces.

    Args:
        design: Electrical design of the capacitors.
        training: The cases.
        network_input: Inputs of the networks.

    Attributes:
        inputs: Shape (n, 9), the largest 1.
        targets: Shape (n, 3), the largest force component 1.
    """

    def __init__(
        self, design: Capacitor, training: Cases, network_input: NetworkInput = "capacitance"
    ) -> None:
        self._design, self._input_kind = design, network_input
        fed = self._network_inputs(training.closure_um)
        self._input_scale = float(np.abs(fed).max())
        self._force_scale_n = float(np.abs(training.force_n).max())
        self.inputs = fed / self._input_scale
        self.targets = training.force_n / self._force_scale_n

    def _network_inputs(self, closure_um: Vector) -> Vector:
        """Return the network's inputs from closures [um]: capacitance changes [pF] or closures, (n, 9)."""
        if self._input_kind == "closure":
            return closure_um
        return self._design.capacitance_pf(closure_um) - self._design.unloaded_pf

    def _force_estimator(self, network: Layers) -> ForceEstimator:
        """Return a network as a function from closures [um] to forces [N]."""

        def read(closure_um: Vector) -> Vector:
            """Return forces [N] from closures [um]."""
            inputs = (self._network_inputs(closure_um) / self._input_scale).astype(np.float32)
            return np.asarray(network_outputs(network, inputs), dtype=np.float64) * self._force_scale_n

        return read

    def train(self, starts: Sequence[Layers], epochs: int) -> list[ForceEstimator]:
        """Return force estimators trained by RPROP, one per set of start weights."""
        trained = train(RPROP, stack(starts), self.inputs, self.targets, epochs)
        return [self._force_estimator(network) for network in unstack(trained.layers)]


def start_weights_by_seed(seeds: int, widths: Sequence[int] = (9, *HIDDEN_NEURONS, 3)) -> list[Layers]:
    """Return random start weights of one network per seed, from seed 0."""
    return [random_layers(np.random.default_rng(seed), widths) for seed in range(seeds)]


def per_foot_force_n(
    design: Capacitor, seed: int, epochs: int, training_pf: Vector, force_n: Vector, test_pf: Vector
) -> Vector:
    """Return forces [N], (m, 3), estimated by a network trained on one foot's calibration loads.

    Args:
        design: Electrical design of the capacitors, without effect: the inputs are changes of capacitance.
        seed: Seed of the network's start; each foot has its own.
        epochs: Training epochs.
        training_pf: Changes of capacitance under the training loads [pF], shape (n, 9).
        force_n: Reference forces of the training loads [N], shape (n, 3).
        test_pf: Changes of capacitance under the other loads [pF], shape (m, 9).
    """
    training = PaperTraining(design, Cases(force_n, closure_of_designed_foot_um(design, training_pf)))
    start = random_layers(np.random.default_rng(seed), (9, *HIDDEN_NEURONS, 3))
    return training.train([start], epochs)[0](closure_of_designed_foot_um(design, test_pf))
