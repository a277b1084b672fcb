"""Network for one individual foot, trained by the paper's procedure on its measured loads alone."""

import numpy as np

from footsense.foot.capacitor import Capacitor
from footsense.frames import Vector
from footsense.lab.training.load_cases import Cases, closure_of_designed_foot_um
from footsense.lab.training.paper.mlp import random_layers
from footsense.lab.training.paper.procedure import HIDDEN_NEURONS, PaperTraining


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
