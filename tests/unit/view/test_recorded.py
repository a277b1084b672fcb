"""A recording on the page: its closures are those that the estimation computed, and its time may have gaps."""

import os
import struct
from contextlib import closing
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from footsense.daemon.estimation import pipeline_for
from footsense.daemon.models import load_models
from footsense.daemon.recording_header import closure_conversion, recorded_config, recorded_flags
from footsense.recording.replay import Replay
from footsense.view.recorded import ReconstructedBaselines, RecordingSource
from footsense.view.signals import SignalTables
from tests.support.cycles import write

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


def test_hours_without_a_cycle_take_no_room(tmp_path: Path) -> None:
    """Each second of a gap is empty when it is asked for, and the cycles behind it come at their time."""
    golden = Replay(GOLDEN)
    cycles = list(islice(golden, 10))
    gap_ns = 80_000 * 10**9
    for number in range(5, 10):
        forces = cycles[number].forces
        cycles[number] = cycles[number]._replace(forces=forces._replace(t_sent_ns=forces.t_sent_ns + gap_ns))
    recorded = RecordingSource(write(tmp_path / "gap.mcap", cycles, header=golden.header))
    with closing(recorded):
        recorded.read()
        assert recorded.status()["end"] == pytest.approx(80_000, abs=0.1)
        counts = [
            struct.unpack("<4I", *[one[:16] for one in recorded.encoded_second(n)])[1] for n in (0, 7, 80_000)
        ]
        assert counts == [5, 0, 5]
        assert recorded.encoded_second(80_001) == []
        assert os.fstat(recorded._file.fileno()).st_size < 30_000
