"""What a foot's pack is worth: forces of its pokes by the network alone, and by its pack, beside the reference.

Both are made as the robot makes them: closures against the foot's own rest, what lies outside of what the network was
taught is no force. Errors are compared on the pokes that both can read, and the others are counted.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.calibration.loads.detection import Poke
from footsense.calibration.session.recorded_session import BenchSession
from footsense.errors import CalibrationError
from footsense.estimation.calibrated_feet import CalibratedFeet
from footsense.foot.force_errors import GRAM_FORCE_N, Errors, errors
from footsense.foot.network_card import TrainedInputs
from footsense.foot.parameters import FootParameters
from footsense.frames import ELEMENTS
from footsense.ports import Estimator

__all__ = ["BANDS", "LEAST_POKES", "Band", "Evaluation", "Read", "evaluate", "read_pokes"]

Vector = NDArray[np.float64]

#: Below so many, a 95th percentile is one poke.
LEAST_POKES = 20


class Band(NamedTuple):
    """Loads that are judged together: those of at least `least_gf` and less than `most_gf`."""

    name: str
    least_gf: float
    most_gf: float


#: The first holds all; the others have one magnitude of the paper in each.
BANDS = (
    Band("all", 0.0, np.inf),
    Band("below 75 gf", 0.0, 75.0),
    Band("75 to 125 gf", 75.0, 125.0),
    Band("from 125 gf", 125.0, np.inf),
)


class Read(NamedTuple):
    """What one way of reading makes of the pokes.

    Attributes:
        closure_rel: Closures that the network was given [1], shape (n, 9).
        force_n: Forces [N], shape (n, 3), NaN where the robot would give none.
        sigma_n: Their standard deviations [N], same shape.
    """

    closure_rel: Vector
    force_n: Vector
    sigma_n: Vector

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Which pokes have a force, shape (n,)."""
        usable: NDArray[np.bool_] = np.asarray(np.isfinite(self.force_n).all(axis=1))
        return usable


class Evaluation(NamedTuple):
    """All that was found.

    Attributes:
        truth_n: What the reference said [N], shape (n, 3), leg's frame.
        design_only: What the network alone makes of it.
        calibrated: What the pack makes of it; None without one.
    """

    truth_n: Vector
    design_only: Read
    calibrated: Read | None

    @property
    def compared(self) -> NDArray[np.bool_]:
        """Which pokes can be read either way, shape (n,)."""
        ways = [self.design_only, *([self.calibrated] if self.calibrated else [])]
        both: NDArray[np.bool_] = np.all([way.usable for way in ways], axis=0)
        return both

    def errors_of(self, read: Read, band: Band) -> Errors | None:
        """Return the errors of one way on the loads of a band, None if there are none."""
        size_gf = np.linalg.norm(self.truth_n, axis=1) / GRAM_FORCE_N
        chosen = self.compared & (size_gf >= band.least_gf) & (size_gf < band.most_gf)
        return errors(self.truth_n[chosen], read.force_n[chosen]) if chosen.any() else None


def read_pokes(
    pokes: Sequence[Poke], network: Estimator, calibration: TrainedInputs, foot: FootParameters | None
) -> Read:
    """Return what a robot would make of pokes.

    Args:
        pokes: Those that count, at least one.
        network: For as many rows.
        calibration: What its card says.
        foot: How the foot differs from its design; None to take it as designed.
    """
    stray_pf = np.zeros(ELEMENTS) if foot is None else foot.stray_pf
    pressed_pf = np.array([poke.capacitance_pf for poke in pokes]) - stray_pf
    rest_pf = np.array([poke.rest_pf for poke in pokes]) - stray_pf
    design = calibration.design
    gain_rel = np.ones(ELEMENTS) if foot is None else foot.gain_rel
    closure_rel = design.closure_um(pressed_pf, rest_pf) / design.gap_um / gain_rel
    gap_um = np.full(ELEMENTS, design.gap_um) if foot is None else foot.gap_um
    # A NaN fails every comparison.
    inside = (closure_rel >= calibration.closure_rel_min) & (
        closure_rel <= calibration.usable_max_rel(gap_um)
    )
    taught: NDArray[np.bool_] = np.asarray(inside.all(axis=1))
    estimator = CalibratedFeet(network, [foot], len(pokes))
    force_n, sigma_n = estimator.estimate(
        np.where(taught[:, None], closure_rel, 0.0), np.zeros(closure_rel.shape, bool)
    )
    force_n[~taught] = sigma_n[~taught] = np.nan
    return Read(closure_rel, force_n, sigma_n)


def evaluate(
    sessions: Sequence[BenchSession],
    network: Callable[[int], Estimator],
    calibration: TrainedInputs,
    foot: FootParameters | None,
) -> Evaluation:
    """Return what the network alone and a foot's pack make of its pokes.

    Args:
        sessions: The recordings.
        network: Makes the network for a number of rows.
        calibration: What its card says.
        foot: What the pack says of the foot; None without one.

    Raises:
        CalibrationError: There are too few pokes, or hardly any that can be read.
    """
    pokes = [poke for session in sessions for poke in session.pokes]
    if len(pokes) < LEAST_POKES:
        raise CalibrationError(
            f"{len(pokes)} pokes that count in {len(sessions)} recordings; "
            f"at least {LEAST_POKES} are needed to say how wrong a foot is"
        )
    estimator = network(len(pokes))
    found = Evaluation(
        truth_n=np.array([poke.force_n for poke in pokes]),
        design_only=read_pokes(pokes, estimator, calibration, None),
        calibrated=read_pokes(pokes, estimator, calibration, foot) if foot is not None else None,
    )
    n_compared = int(found.compared.sum())
    if n_compared < LEAST_POKES:
        raise CalibrationError(
            f"{n_compared} of {len(pokes)} pokes lie within what the network was taught, at least {LEAST_POKES} are "
            "needed; press less hard, and check that the recordings are of this foot type"
        )
    return found
