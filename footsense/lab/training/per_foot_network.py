"""One foot learnt without any physics: the paper's kind of network, taught what that foot's own bench measured."""

import numpy as np
from numpy.typing import NDArray

from footsense.foot.capacitor import CapacitorDesign
from footsense.lab.monte_carlo.specimens import as_designed_um
from footsense.lab.training.load_cases import Cases
from footsense.lab.training.mlp import start_layers
from footsense.lab.training.paper_procedure import EPOCHS, HIDDEN, Lesson

Vector = NDArray[np.float64]

_SEED = 1


def from_scratch(
    design: CapacitorDesign, learnt_pf: Vector, force_n: Vector, asked_pf: Vector, epochs: int = EPOCHS
) -> Vector:
    """Return the forces [N], shape (m, 3), that a network taught with a foot's pokes makes of others.

    Args:
        design: Of the capacitors, of which the network learns nothing: it is fed with changes of capacitance.
        learnt_pf: Changes of capacitance in the pokes that it learns [pF], shape (n, 9).
        force_n: What the reference felt [N], shape (n, 3).
        asked_pf: Changes of capacitance that it is asked for [pF], shape (m, 9).
        epochs: That it learns.
    """
    lesson = Lesson(design, Cases(force_n, as_designed_um(design, learnt_pf)))
    start = start_layers(np.random.default_rng(_SEED), (9, *HIDDEN, 3))
    return lesson.teach([start], epochs)[0](as_designed_um(design, asked_pf))
