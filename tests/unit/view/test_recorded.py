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
from footsense.frames import BaselineDrift, CapFrame, Command, CommandKind, CommandResult, Result
from footsense.recording.replay import Replay
from footsense.view.recorded import ReconstructedBaselines, RecordingSource
from footsense.view.signals import SignalTables
from tests.support.cycles import cycle, write
from tests.support.frames import contact_frame

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
    for one in islice(recording, 900):
        pipeline.process(one.scan, one.forces.t_sent_ns)
        found = tables.closure_rel(one, baselines.baseline_pf_after(one))
        wanted = tables.closure_rel(one, pipeline.baseline_pf)
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-3)
        largest = max(largest, float(np.nan_to_num(found).max()))
    assert largest > 0.3


def test_a_baseline_that_was_tracked_moves_with_its_mean_drift() -> None:
    """Of a second tare the scans before it are the new baseline."""
    shown = cycle(1, n_legs=1)
    baselines = ReconstructedBaselines(np.full((1, 9), 0.5), window_scans=2)

    def after(number: int, reading_pf: float, drift_pf: float, *, tares: bool) -> float:
        scan = CapFrame(
            number, np.full((1, 9), number), np.full((1, 9), reading_pf), np.zeros((1, 9), np.uint8)
        )
        drift = BaselineDrift(
            np.zeros(1, np.uint8), np.array([drift_pf]), np.array([drift_pf]), np.ones(1, np.int64)
        )
        done = CommandResult(Command(CommandKind.TARE, 0), Result.DONE, "")
        forces = contact_frame(number, baseline=drift)
        found_pf = baselines.baseline_pf_after(
            shown._replace(scan=scan, forces=forces, ended_commands=(done,) if tares else ())
        )
        return float(found_pf[0, 4])

    assert np.isnan(after(1, 9.0, np.nan, tares=False))
    after(2, 5.9, 0.0, tares=False)
    assert after(3, 6.1, 0.0, tares=True) == pytest.approx(5.5)
    assert after(4, 7.0, 0.02, tares=False) == pytest.approx(5.52)
    assert after(5, 6.2, 0.0, tares=True) == pytest.approx(6.1)


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
