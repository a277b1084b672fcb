"""The experiment of the paper on feet that were never made: many of them poked, calibrated and judged, side by side.

Every way of reading a foot is judged by the same loads, those of a session that none of them learnt from, and by the
same truth: the reference of the test_stand, as in the paper. What the foot really felt, which only a simulation knows, is
kept too. A load that one of the ways gives no force for is left out for all, and counted.
"""

import logging
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import lru_cache, partial
from multiprocessing import get_context
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from footsense.calibration.evaluation import Read, read_loads
from footsense.calibration.fit.calibrate import Design, calibrate
from footsense.calibration.loads.load_set import LoadSet
from footsense.calibration.session.recorded_session import RecordedSession, read_session
from footsense.clock import stopwatch_ns
from footsense.config import Bus, Can, Config
from footsense.daemon.foot_types import artefact
from footsense.errors import CalibrationError
from footsense.estimation.network import Network
from footsense.foot.force_errors import errors
from footsense.foot.response_table import FootResponse
from footsense.validation.test_stand_trial import Trial, Workshop, name_of, run_test_stand

Vector = NDArray[np.float64]

#: CalibrationLoads of which a calibration is made; the last is all there are.
FEW = (5, 10, 20, 50, 100)
ALL = 362

#: Learns forces [N], shape (n, 3), of changes of capacitance [pF], shape (n, 9), and answers others.
Scratch = Callable[[Vector, Vector, Vector], Vector]


class Wrong(msgspec.Struct, frozen=True):
    """Mean errors of one way of reading one foot.

    Attributes:
        direction_deg: Against the reference [deg].
        magnitude_gf: The same [gf].
        felt_direction_deg: Against what the foot felt [deg].
        felt_magnitude_gf: The same [gf].
    """

    direction_deg: float
    magnitude_gf: float
    felt_direction_deg: float
    felt_magnitude_gf: float


class FootJudged(msgspec.Struct, frozen=True, kw_only=True):
    """One foot.

    Attributes:
        foot: Its identity.
        n_learnt: CalibrationLoads that count of those to learn from.
        n_judged: CalibrationLoads by which all ways are judged.
        n_unread: CalibrationLoads of the judging session that some way gives no force for.
        wrong: Errors by way: `design_only`, `calibrated_<n>`, `linear_per_foot`, `scratch_per_foot`.
        refused: Why a calibration was refused, by way.
        calibrate_s: From the recording to the parameters, all loads [s].
    """

    foot: str
    n_learnt: int
    n_judged: int
    n_unread: int
    wrong: dict[str, Wrong]
    refused: dict[str, str]
    calibrate_s: float


def run_experiment(
    workshop: Workshop, numbers: Sequence[int], scratch: Scratch | None, *, jobs: int, every: int = 1
) -> Iterator[FootJudged]:
    """Make, load, calibrate and judge feet, in processes of their own.

    Args:
        workshop: Where they are made.
        numbers: Which.
        scratch: What learns a foot without any physics; picklable; None to leave that out.
        jobs: Processes at a time.
        every: Take one of so many presses.

    Yields:
        Each foot as it is done.
    """
    work = partial(judge_foot, workshop, scratch=scratch, every=every)
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=_quiet) as processes:
        for done in as_completed([processes.submit(work, number) for number in numbers]):
            yield done.result()


def judge_foot(workshop: Workshop, number: int, *, scratch: Scratch | None, every: int = 1) -> FootJudged:
    """Make, load, calibrate and judge one foot."""
    with tempfile.TemporaryDirectory(prefix="footsense-bench-") as folder:
        trial = run_test_stand(workshop, number, Path(folder), every=every)
        began_ns = stopwatch_ns()
        learning = read_session(trial.learning.path, name_of(number))
        return _judged(design_of(workshop.foot_type), trial, learning, began_ns, scratch)


def models_of(foot_type: str) -> Path:
    """Return the folder of a type of feet.

    Raises:
        ModelError: There is no such type.
    """
    config = Config(
        buses=(Bus(device="sim", legs={"lf": 0}),), can=Can(interface="virtual"), foot_type=foot_type
    )
    return artefact(config, "network.onnx").parent


def design_of(foot_type: str) -> Design:
    """Return what is known of a type of feet.

    Raises:
        ModelError: There is no such type.
    """
    folder = models_of(foot_type)
    network = lru_cache(maxsize=8)(partial(Network, folder / "network.onnx"))
    response = FootResponse.load(folder / "response.npz")
    return Design(response, network, network(1).card.trained_inputs)


def _judged(
    design: Design, trial: Trial, learning: RecordedSession, began_ns: int, scratch: Scratch | None
) -> FootJudged:
    loads = LoadSet.of(learning.loads)
    refused: dict[str, str] = {}
    network = design.network(len(trial.judging.loads))
    reads: dict[str, Read] = {"design_only": read_loads(trial.judging.loads, network, design.card, None)}
    calibrate_s = 0.0
    order = loads.spread()
    for wanted in (ALL, *FEW):
        way = f"calibrated_{wanted}"
        if wanted != ALL and wanted >= len(loads):
            continue
        try:
            found = calibrate(design, loads if wanted == ALL else loads.some(order[:wanted]))
        except CalibrationError as error:
            refused[way] = str(error)
            continue
        finally:
            calibrate_s = calibrate_s or (stopwatch_ns() - began_ns) * 1e-9
        reads[way] = read_loads(trial.judging.loads, network, design.card, found.parameters)
    both = np.logical_and.reduce([read.usable for read in reads.values()])
    forces_n = {way: read.force_n for way, read in reads.items()} | _without_physics(loads, trial, scratch)
    truth_n = np.array([load.force_n for load in trial.judging.loads])
    return FootJudged(
        foot=learning.foot,
        n_learnt=len(loads),
        n_judged=int(both.sum()),
        n_unread=int((~both).sum()) + trial.judging.refused.total(),
        wrong={
            way: _wrong(truth_n[both], trial.felt_n[both], force_n[both]) for way, force_n in forces_n.items()
        },
        refused=refused,
        calibrate_s=calibrate_s,
    )


def _without_physics(loads: LoadSet, trial: Trial, scratch: Scratch | None) -> dict[str, Vector]:
    """Return what is made of the judging loads by what learnt this foot alone [N], shape (n, 3) each."""
    asked = LoadSet.of(trial.judging.loads)
    learnt_pf, asked_pf = loads.capacitance_pf - loads.rest_pf, asked.capacitance_pf - asked.rest_pf
    linear = np.linalg.lstsq(learnt_pf, loads.force_n, rcond=None)[0]
    found = {"linear_per_foot": asked_pf @ linear}
    if scratch is not None:
        found["scratch_per_foot"] = scratch(learnt_pf, loads.force_n, asked_pf)
    return found


def _wrong(truth_n: Vector, felt_n: Vector, force_n: Vector) -> Wrong:
    seen, felt = errors(truth_n, force_n), errors(felt_n, force_n)
    return Wrong(seen.direction_deg, seen.magnitude_gf, felt.direction_deg, felt.magnitude_gf)


def _quiet() -> None:
    """Say nothing of what an uncalibrated foot looks like to the daemon."""
    logging.disable(logging.WARNING)
