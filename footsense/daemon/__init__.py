"""The composition root: the only place that knows which backend stands behind which port.

foot_types   name  -> files            of the feet that the robot has
scanning     buses -> scanner          real adapters, or a simulated robot in a scene
estimation   card  -> pipeline         the network, and what it was made for
service      all of it, opened in order and closed in the opposite one
"""

from footsense.daemon.acquisition import Scanning, scanning
from footsense.daemon.calibrations import calibrations_difference
from footsense.daemon.estimation import (
    load_calibrations,
    load_network,
    pipeline_for,
    recorded_config,
    recorded_flags,
)
from footsense.daemon.foot_types import FOOT_TYPE, artefact, foot_type_of, released
from footsense.daemon.service import Service, can_sink, service
from footsense.daemon.simulation import is_simulated, simulated_robot

__all__ = [
    "FOOT_TYPE",
    "Scanning",
    "Service",
    "artefact",
    "calibrations_difference",
    "can_sink",
    "foot_type_of",
    "is_simulated",
    "load_calibrations",
    "load_network",
    "pipeline_for",
    "recorded_config",
    "recorded_flags",
    "released",
    "scanning",
    "service",
    "simulated_robot",
]
