"""The one composition of the estimation: of the service, a replay, `footsense.Estimator` and the lab's judging."""

from pathlib import Path

import numpy as np

from footsense.errors import ModelError
from footsense.estimation.calibrated_feet import CalibratedFeet
from footsense.estimation.network import Network, sensitivity
from footsense.estimation.pipeline import Pipeline
from footsense.estimation.rest import RefinedAtRest
from footsense.estimation.settings import EstimationLimits, MountedFeet
from footsense.foot.response_table import FootResponse
from footsense.ports import LoadEstimator


def trained_response(folder: Path, network: Network) -> FootResponse:
    """Return the response table in a foot type's folder.

    Args:
        folder: The folder.
        network: The network in use.

    Raises:
        ModelError: There is none, or it is not the one that the network was trained on.
    """
    path = folder / "response.npz"
    response = FootResponse.load(path)
    if response.sha256 != network.card.response_sha256:
        raise ModelError(f"{path}: not the response table that the network was trained on")
    return response


def pipeline_of(
    network: Network,
    feet: MountedFeet,
    limits: EstimationLimits,
    response: FootResponse | None,
    *,
    estimator: LoadEstimator | None = None,
    flags: int = 0,
) -> Pipeline:
    """Return the pipeline from capacitances to forces.

    Args:
        network: The network, for as many rows as there are feet.
        feet: The mounted feet.
        limits: How they are read, and what is configured.
        response: Response table of their type, by which loads at rest are refined; None if they are not to be.
        estimator: What gives the loads in place of the network; None for the network itself.
        flags: Flags of every frame, as in `Flag`.
    """
    trained, n_feet = network.card.trained_inputs, len(feet.names)
    force_sensitivity = sensitivity(network, n_feet, trained.moments)
    loads: LoadEstimator = network if estimator is None else estimator
    if response is not None:
        loads = RefinedAtRest(loads, response, trained, n_feet)
    if all(foot is None for foot in feet.parameters):
        return Pipeline(loads, trained, feet, limits, force_sensitivity, flags)
    calibrated = CalibratedFeet(loads, feet.parameters, feet.calibrated_at_c)
    calibrated.set_temperature(np.full(n_feet, np.nan))
    return Pipeline(calibrated, trained, feet, limits, force_sensitivity, flags, calibrated.set_temperature)
