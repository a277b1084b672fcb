"""Service, replay, `footsense.Estimator` and the lab's judging are one pipeline."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray

import footsense
from footsense.config import DEFAULT, SMALL_BOARD, Config
from footsense.config.sections import Bus
from footsense.daemon.estimation import pipeline_for
from footsense.daemon.models import load_models
from footsense.daemon.recording_header import recorded_config, recorded_flags
from footsense.daemon.service import open_service
from footsense.estimation.network import Network
from footsense.estimation.pipeline import Pipeline, pipeline_of
from footsense.estimation.settings import EstimationLimits, MountedFeet
from footsense.foot.network_card import NETWORK_FILE
from footsense.foot.response_table import FootResponse
from footsense.foot.type_folders import foot_type_folder
from footsense.frames import ContactFrame, Cycle
from footsense.lab.evaluation.evaluate_models import RESPONSE_FILE
from footsense.lab.evaluation.walker_runs import SCAN_TIMES, judging_pipeline
from footsense.recording.replay import Replay
from footsense.sim.scene import Effects, Scene
from footsense.sim.scene_loads import Standstill, Tripod
from footsense.sim.uncalibrated import uncertainty_of_uncalibrated

pytestmark = pytest.mark.lab

#: Two feet with each board, the first of a type whose load in swing may rise faster than the least limit.
QUADRUPED = replace(
    DEFAULT, buses=(Bus(device="sim0", addresses={"lf": 0x2C, "rf": 0x2D}),), foot_type="quadruped-12kg"
)
SMALL = replace(SMALL_BOARD, buses=(replace(SMALL_BOARD.buses[0], legs={"lf": 0, "rf": 3}),))
DURATION_S = 1.6

Published = dict[str, NDArray[Any]]


def walk(peak_force_n: float) -> Scene:
    """Return feet that are tared, step, and stand."""
    load = Tripod(
        period_s=0.5,
        duty_rel=0.55,
        peak_force_n=peak_force_n,
        friction_rel=0.2,
        stands=(Standstill(from_s=0.5, until_s=60.0),),
    )
    effects = Effects(converter_noise=True)
    return Scene(description="A step and a standstill.", load=load, lead_in_s=0.3, effects=effects)


def published(frames: Sequence[ContactFrame]) -> Published:
    """Return the forces, sigma and states of frames."""
    return {
        name: np.array([getattr(frame, name) for frame in frames]) for name in ("force_n", "sigma_n", "state")
    }


def run(pipeline: Pipeline, cycles: Sequence[Cycle]) -> Published:
    return published([pipeline.process(cycle.scan, cycle.forces.t_sent_ns)[0] for cycle in cycles])


def estimated(foot_type: str, cycles: Sequence[Cycle]) -> Published:
    read_ns = np.array([cycle.scan.t_ns for cycle in cycles])
    forces = footsense.Estimator(foot_type).run(
        [cycle.scan.capacitance_pf for cycle in cycles],
        [1e-9 * cycle.forces.t_sent_ns for cycle in cycles],
        np.where(read_ns > 0, 1e-9 * read_ns, np.nan),
    )
    return {name: getattr(forces, name) for name in ("force_n", "sigma_n", "state")}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("config", "peak_force_n"), [(QUADRUPED, 40.0), (SMALL, 0.8)], ids=["ad7147", "fdc1004"]
)
def test_all_publish_the_same_of_a_recording(config: Config, peak_force_n: float, tmp_path: Path) -> None:
    """Forces bit for bit, in steps and at rest, where the network alone would give others."""
    file = tmp_path / "walk.mcap"
    with open_service(config, walk(peak_force_n), real_time=False, record=file) as service:
        service.run(until_ns=service.clock.now_ns() + DURATION_S * 1e9)
    recording = Replay(file)
    cycles = list(recording)
    models = load_models(recorded_config(recording))
    folder, scan = foot_type_folder(config.foot_type), SCAN_TIMES[config.board]
    network, response = Network(folder / NETWORK_FILE, 2), FootResponse.load(folder / RESPONSE_FILE)
    unknown = uncertainty_of_uncalibrated(network, response, 2)
    of_service = published([cycle.forces for cycle in cycles])
    others = {
        "replay": run(pipeline_for(models, recorded_flags(recording)), cycles),
        "Estimator": estimated(config.foot_type, cycles),
        "judging": run(
            judging_pipeline(network, response, scan, [None, None], uncertainty=[unknown, unknown]), cycles
        ),
    }
    for who, other in others.items():
        for name, values in of_service.items():
            # `Estimator` measures the time of a scan, on which what a swing shows of the foot's pull depends.
            rtol = 0.01 if (who, name) == ("Estimator", "sigma_n") else 0.0
            np.testing.assert_allclose(other[name], values, rtol=rtol, atol=0.0, err_msg=f"{name} of {who}")
    limits = EstimationLimits(scan_ns=scan.scan_ns, range_end_pf=scan.range_end_pf)
    unrefined = pipeline_of(network, MountedFeet.of(response.design, [None, None]), limits, None)
    last_n = of_service["force_n"][-1]
    assert np.isfinite(last_n).all()
    assert (run(unrefined, cycles)["force_n"][-1] != last_n).any(axis=1).all()
