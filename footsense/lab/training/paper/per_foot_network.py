"""Network for one individual foot, trained by the paper's procedure on its measured loads alone."""

from footsense.foot.capacitor import Capacitor
from footsense.frames import Vector
from footsense.lab.training.load_cases import Cases, closure_of_designed_foot_um
from footsense.lab.training.paper.procedure import EPOCHS, PaperTraining, start_weights_by_seed


def per_foot_force_n(
    design: Capacitor, training_pf: Vector, force_n: Vector, test_pf: Vector, epochs: int = EPOCHS
) -> Vector:
    """Return forces [N], (m, 3), estimated by a network trained on one foot's calibration loads.

    Args:
        design: Electrical design of the capacitors, without effect: the inputs are changes of capacitance.
        training_pf: Changes of capacitance under the training loads [pF], shape (n, 9).
        force_n: Reference forces of the training loads [N], shape (n, 3).
        test_pf: Changes of capacitance under the other loads [pF], shape (m, 9).
        epochs: Training epochs.
    """
    training = PaperTraining(design, Cases(force_n, closure_of_designed_foot_um(design, training_pf)))
    _, start = start_weights_by_seed(2)
    return training.train([start], epochs)[0](closure_of_designed_foot_um(design, test_pf))
