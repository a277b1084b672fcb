"""Force errors against the reference sensor, for the network alone and for the network with the foot's calibration.

The loads are recorded calibration loads. Both forces are computed as on the robot: closures against the foot's own
unloaded reading, no force outside of the network's training range. Errors are compared over the loads that both can
read.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

from footsense.calibration.loads import LoadSet
from footsense.calibration.recorded_session import RecordedSession
from footsense.calibration.rubber_memory import loads_with_creep_corrected_baseline
from footsense.errors import CalibrationError
from footsense.estimation.calibrated_feet import CalibratedFeet
from footsense.estimation.network import Network, steady_windows
from footsense.foot.force_errors import GRAM_FORCE_N, ForceErrors, evaluate_force_errors
from footsense.foot.network_card import TrainedInputs
from footsense.foot.parameters import FootParameters
from footsense.foot.response_table import FootResponse
from footsense.frames import ELEMENTS, Mask, Vector
from footsense.ports import LoadEstimate, LoadEstimator

#: Sources of estimates: the network of the design alone, and with the foot's calibration.
DESIGN_ONLY, CALIBRATED = "network alone", "with calibration"

#: Fewest loads of an evaluation: with fewer, a 95th percentile is a single load.
_MIN_LOADS = 20


class Estimates(NamedTuple):
    """Forces [N] and standard deviations estimated for a set of calibration loads.

    Attributes:
        force_n: Forces [N], shape (n, 3), NaN where the robot would give none.
        sigma_n: Their standard deviations [N], same shape.
    """

    force_n: Vector
    sigma_n: Vector

    @property
    def has_force(self) -> Mask:
        """Mask of the loads for which a force was estimated, shape (n,)."""
        has_force: Mask = np.asarray(np.isfinite(self.force_n).all(axis=1))
        return has_force


class DesignModels(NamedTuple):
    """Models of a foot type (uncalibrated design): response table and trained network.

    Attributes:
        response: Response table of the type.
        network_for_rows: Returns the type's network, or that of a foot's calibration, for a number of rows.
    """

    response: FootResponse
    network_for_rows: Callable[[int], Network]

    @classmethod
    def load(cls, folder: Path) -> Self:
        """Load the models of a folder with `network.onnx` and `response.npz`.

        Raises:
            ModelError: A file is missing, damaged, or of another format.
        """
        network = lru_cache(maxsize=8)(partial(Network, folder / "network.onnx"))
        return cls(FootResponse.load(folder / "response.npz"), network)

    def estimate(self, loads: LoadSet, foot: FootParameters | None) -> Estimates:
        """Return the forces that a robot would estimate from the readings of loads; see `estimate_loads`."""
        network = self.network_for_rows(len(loads))
        return estimate_loads(loads, network, network.card.trained_inputs, foot)

    def estimate_in_foot_frame(
        self, capacitance_pf: Vector, unloaded_pf: Vector, stray_pf: Vector, gain_rel: Vector
    ) -> LoadEstimate:
        """Return what the network says of readings of any loads, before stiffness and mount.

        Args:
            capacitance_pf: Readings [pF], shape (n, elements).
            unloaded_pf: Those of the free foot [pF], to be broadcast to the same shape.
            stray_pf: Stray of each element [pF], likewise.
            gain_rel: Gain of each element's closure [1], likewise.
        """
        design = self.response.design
        closure_um = design.closure_um(capacitance_pf - stray_pf, unloaded_pf - stray_pf)
        network = self.network_for_rows(len(capacitance_pf))
        return network.estimate(steady_windows(closure_um / design.gap_um / gain_rel))


#: Ranges of force magnitudes [gf], lower limit included, whose loads are evaluated together: all, and one magnitude of
#: the paper in each of the others.
MAGNITUDE_BANDS_GF = {
    "all": (0.0, np.inf),
    "below 0.74 N": (0.0, 75.0),
    "0.74 to 1.23 N": (75.0, 125.0),
    "from 1.23 N": (125.0, np.inf),
}


class Evaluation(NamedTuple):
    """Reference forces and estimated forces of the same loads.

    Attributes:
        reference_n: Forces of the reference [N], shape (n, 3), leg frame.
        estimates: Estimates by source: `DESIGN_ONLY`, and with a calibration `CALIBRATED`.
    """

    reference_n: Vector
    estimates: Mapping[str, Estimates]

    @property
    def is_compared(self) -> Mask:
        """Mask of the loads for which both estimators gave a force, shape (n,)."""
        is_compared: Mask = np.all([one.has_force for one in self.estimates.values()], axis=0)
        return is_compared

    def errors_of(self, estimates: Estimates, least_gf: float, below_gf: float) -> ForceErrors | None:
        """Return the force errors of estimates over the compared loads of a range [gf]; None if there are none."""
        magnitude_gf = np.linalg.norm(self.reference_n, axis=1) / GRAM_FORCE_N
        chosen = self.is_compared & (magnitude_gf >= least_gf) & (magnitude_gf < below_gf)
        if not chosen.any():
            return None
        return evaluate_force_errors(self.reference_n[chosen], estimates.force_n[chosen])


def estimate_loads(
    loads: LoadSet, network: LoadEstimator, trained_inputs: TrainedInputs, foot: FootParameters | None
) -> Estimates:
    """Return the forces that a robot would estimate from the readings of calibration loads.

    Args:
        loads: At least one.
        network: For as many rows.
        trained_inputs: Its training range.
        foot: Parameters of the foot; None to read it as designed.
    """
    design = trained_inputs.design
    stray_pf = np.zeros(ELEMENTS) if foot is None else foot.stray_pf
    gain_rel = np.ones(ELEMENTS) if foot is None else foot.gain_rel
    gap_um = np.full(ELEMENTS, design.gap_um) if foot is None else foot.gap_um
    closure_um = design.closure_um(loads.capacitance_pf - stray_pf, loads.baseline_pf - stray_pf)
    closure_rel = closure_um / design.gap_um / gain_rel
    # A NaN fails every comparison.
    inside = (closure_rel >= trained_inputs.closure_rel_min) & (
        closure_rel <= trained_inputs.max_usable_closure_rel(gap_um)
    )
    trained = inside.all(axis=1, keepdims=True)
    load = CalibratedFeet(network, [foot] * len(loads)).estimate(
        steady_windows(np.where(trained, closure_rel, 0.0))
    )
    return Estimates(*(np.where(trained, part, np.nan) for part in load[:2]))


def evaluate(
    sessions: Sequence[RecordedSession],
    models: DesignModels,
    foot: FootParameters | None,
) -> Evaluation:
    """Return the forces of sessions as estimated by the network alone and with calibration, and the reference forces.

    Args:
        sessions: The recordings.
        models: Models of the foot's type, with the network of the calibration if there is one.
        foot: Parameters of the calibration; None without one.

    Raises:
        CalibrationError: Too few loads are there, or have a force.
    """
    loads = loads_with_creep_corrected_baseline(models.response, sessions)
    if len(loads) < _MIN_LOADS:
        raise CalibrationError(
            f"{len(loads)} accepted loads in {len(sessions)} recordings; "
            f"at least {_MIN_LOADS} are needed for an evaluation"
        )
    estimates = {DESIGN_ONLY: models.estimate(loads, None)}
    if foot is not None:
        estimates[CALIBRATED] = models.estimate(loads, foot)
    evaluation = Evaluation(loads.force_n, estimates)
    n_compared = int(evaluation.is_compared.sum())
    if n_compared < _MIN_LOADS:
        raise CalibrationError(
            f"{n_compared} of {len(loads)} loads lie in the network's training range, at least {_MIN_LOADS} are "
            "needed; press less hard, and check that the recordings are of this foot type"
        )
    return evaluation
