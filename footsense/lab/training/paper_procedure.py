"""The paper's own way from capacitances to forces: a plain network, RPROP, and the 362 cases of section III F.

Nothing of what `network` and `train` know about the foot is used here: no gap closure instead of dC unless asked
for, no symmetry, no linear path. Inputs and forces are divided by the largest of the training cases.
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from footsense.foot.capacitor import CapacitorDesign
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Foot
from footsense.lab.evaluation.evaluate import Errors, Readout, errors
from footsense.lab.training.load_cases import (
    GRAM_FORCE_N,
    Cases,
    paper_training,
    paper_verification,
    sensed_closure_um,
)
from footsense.lab.training.mlp import Layers, forward, learn, stack, start_layers, unstack
from footsense.lab.training.rprop import rprop_start, rprop_step

#: What a network is fed with: capacitance changes, as the paper's, or the gap closures that elastance measures.
Feed = Literal["capacitance", "closure"]

#: Neurons of the two hidden layers, twice the inputs; the paper found its own by trial and error (Table I).
HIDDEN = (18, 18)
#: Epochs of learning; the paper states none. Four times as many change the errors by less than the seeds do.
EPOCHS, QUICK_EPOCHS = 5000, 1000
#: Networks, which differ in their start weights.
SEEDS, QUICK_SEEDS = 20, 3


class Lesson:
    """Cases for a network to learn, scaled as it wants them.

    Attributes:
        inputs: What it is fed with [1], shape (n, 9), the largest 1.
        targets: What it is to answer [1], shape (n, 3), the largest force component 1.

    Args:
        design: Of the capacitors.
        training: The cases.
        feed: What the networks are fed with.
    """

    def __init__(self, design: CapacitorDesign, training: Cases, feed: Feed = "capacitance") -> None:
        self._design, self._feed = design, feed
        fed = self._fed(training.closure_um)
        self._input_scale = float(np.abs(fed).max())
        self._force_scale_n = float(np.abs(training.force_n).max())
        self.inputs = fed / self._input_scale
        self.targets = training.force_n / self._force_scale_n

    def _fed(self, closure_um: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return capacitance changes [pF] or closures [um], shape (n, 9), of closures [um]."""
        if self._feed == "closure":
            return closure_um
        return self._design.capacitance_pf(closure_um) - self._design.rest_pf

    def _readout(self, network: Layers) -> Readout:
        """Return a network as a read-out in newtons."""

        def read(closure_um: NDArray[np.float64]) -> NDArray[np.float64]:
            inputs = (self._fed(closure_um) / self._input_scale).astype(np.float32)
            return np.asarray(forward(network, inputs), dtype=np.float64) * self._force_scale_n

        return read

    def teach(self, starts: Sequence[Layers], epochs: int) -> list[Readout]:
        """Return what becomes of start weights by that many epochs of RPROP, each network as a read-out."""
        layers = stack(starts)
        learnt = learn(rprop_step, layers, rprop_start(layers), self.inputs, self.targets, epochs)
        return [self._readout(network) for network in unstack(learnt.layers)]


def verification_at(response: FootResponse, magnitude_gf: float) -> Cases:
    """Return the 180 directions of the verification cases at a magnitude [gf] other than the paper's 100."""
    direction = paper_verification(response).force_n
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    force_n = direction * magnitude_gf * GRAM_FORCE_N
    return Cases(force_n, sensed_closure_um(Foot(response), direction, force_n))


def paper_way(response: FootResponse, *, quick: bool, feed: Feed = "capacitance") -> list[Readout]:
    """Return networks taught the paper's way, one for each seed of the start weights; few and less if quick."""
    seeds, epochs = (QUICK_SEEDS, QUICK_EPOCHS) if quick else (SEEDS, EPOCHS)
    starts = [start_layers(np.random.default_rng(seed), (9, *HIDDEN, 3)) for seed in range(seeds)]
    return Lesson(response.design, paper_training(response), feed).teach(starts, epochs)


def paper_way_errors(response: FootResponse, *, quick: bool, feed: Feed = "capacitance") -> list[Errors]:
    """Return the errors of the paper's way on its 180 verification cases, one entry for each seed."""
    asked = paper_verification(response)
    readouts = paper_way(response, quick=quick, feed=feed)
    return [errors(asked.force_n, read(asked.closure_um)) for read in readouts]
