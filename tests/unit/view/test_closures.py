"""The heat maps are true: closures of a recording are those that the estimation computed."""

from itertools import islice
from pathlib import Path

import numpy as np

from footsense.daemon.estimation import pipeline_for
from footsense.daemon.models import load_models
from footsense.daemon.recording_header import closure_conversion, recorded_config, recorded_flags
from footsense.recording.replay import Replay
from footsense.view.recorded import ReconstructedBaselines
from footsense.view.signals import SignalTables

GOLDEN = Path(__file__).parents[2] / "golden/measured_walk.mcap"


def test_the_baselines_of_a_recording_are_found_again() -> None:
    """From the tare and the mean drift, within a thousandth of the gap of those that the estimation had."""
    recording = Replay(GOLDEN)
    config = recorded_config(recording)
    models = load_models(config)
    pipeline = pipeline_for(models, recorded_flags(recording))
    tables = SignalTables(closure_conversion(models))
    baselines = ReconstructedBaselines(tables.stray_pf, config.tare.window_scans)
    largest = 0.0
    for cycle in islice(recording, 900):
        pipeline.process(cycle.scan, cycle.forces.t_sent_ns)
        found = tables.closure_rel(cycle, baselines.baseline_pf_after(cycle))
        wanted = tables.closure_rel(cycle, pipeline.baseline_pf)
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-3)
        largest = max(largest, float(np.nan_to_num(found).max()))
    assert largest > 0.3
