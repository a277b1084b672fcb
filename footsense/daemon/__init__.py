"""The composition root: the only place that names the backend behind each port.

foot_types        foot type     -> files          network, response table
calibrations      configuration -> calibrations   of the feet on the legs
acquisition       buses         -> scans          real adapters, or those of a simulated robot
estimation        network card  -> pipeline
recording_header  a run         -> header         and back, for a replay
service           all of it, opened in order and closed in reverse
"""

from footsense.daemon.acquisition import ScanSource, open_scan_source
from footsense.daemon.calibrations import load_calibrations
from footsense.daemon.estimation import load_network, pipeline_for
from footsense.daemon.foot_types import FOOT_TYPE, artefact, foot_type_of, released
from footsense.daemon.recording_header import model_difference, recorded_config, recorded_flags
from footsense.daemon.service import Service, can_sink, service
from footsense.daemon.simulation import is_simulated, simulated_robot

__all__ = [
    "FOOT_TYPE",
    "ScanSource",
    "Service",
    "artefact",
    "can_sink",
    "foot_type_of",
    "is_simulated",
    "load_calibrations",
    "load_network",
    "model_difference",
    "open_scan_source",
    "pipeline_for",
    "recorded_config",
    "recorded_flags",
    "released",
    "service",
    "simulated_robot",
]
