"""Monte Carlo over fabricated feet: nothing is judged twice, nothing finished is lost, nothing foreign is mixed in."""

import multiprocessing
from collections.abc import Generator, Sequence
from pathlib import Path

import numpy as np
import pytest
from distributed import LocalCluster

from footsense.errors import FootsenseError
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Foot
from footsense.lab.evaluation.evaluate_models import open_models
from footsense.lab.monte_carlo.resumable_run import Job, JobFunction, JobMetrics, Tolerances, run_resumable
from footsense.lab.monte_carlo.specimens import estimator_errors, measure_foot
from footsense.lab.monte_carlo.statistics import MeanStd
from footsense.lab.monte_carlo.sweeps import (
    FOOT_SWEEPS,
    FULL_PLAN,
    QUICK_PLAN,
    TEST_STAND_SWEEPS,
    SweepResults,
)
from footsense.lab.monte_carlo.workers import job_runner
from footsense.lab.training.load_cases import paper_verification
from footsense.sim.fabrication import MIN_DRAWN_OVER_DESIGN, draw_deviations

pytestmark = pytest.mark.lab

RELEASED = Path(__file__).parents[2] / "models" / "aoyagi-3x3"
ABOUT: dict[str, str | int] = {"study": "test", "seed": 1}
JOBS = [Job(Tolerances(gap_um=0.1 * foot), foot) for foot in range(5)]


def double(job: Job) -> JobMetrics:
    """Evaluate by the number alone; a float that JSON has to bring back to the last bit."""
    return {"twice": 2.0 * job.foot + 0.1}


def abs_gap(job: Job) -> JobMetrics:
    """Return what a worker process gets of a job."""
    return {"gap_um": abs(job.tolerances.gap_um), "foot": float(job.foot)}


def refuses(job: Job) -> JobMetrics:
    """Fail if anything is left to do."""
    raise AssertionError(job)


def in_turn(work: JobFunction, jobs: Sequence[Job]) -> Generator[tuple[Job, JobMetrics], None, None]:
    """Evaluate the feet one after the other."""
    for job in jobs:
        yield job, work(job)


def stopped_after_two(
    work: JobFunction, jobs: Sequence[Job]
) -> Generator[tuple[Job, JobMetrics], None, None]:
    """Work in turn, until Ctrl-C."""
    yield from in_turn(work, jobs[:2])
    raise KeyboardInterrupt


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Return the file of a run, in a folder that does not exist yet."""
    return tmp_path / "kept" / "run.jsonl"


@pytest.fixture(scope="module")
def released() -> FootResponse:
    """Return the released foot."""
    return open_models(RELEASED)[0]


def test_an_interrupted_run_continues_with_the_missing_feet(file: Path) -> None:
    """What was finished before Ctrl-C is neither lost nor done again, and a finished run needs no worker."""
    with pytest.raises(KeyboardInterrupt):
        run_resumable(ABOUT, JOBS, double, workers=stopped_after_two, file=file)
    asked: list[Job] = []

    def noted(job: Job) -> JobMetrics:
        asked.append(job)
        return double(job)

    whole = {job: double(job) for job in JOBS}
    assert run_resumable(ABOUT, JOBS + JOBS, noted, workers=in_turn, file=file) == whole
    assert asked == JOBS[2:]
    assert run_resumable(ABOUT, JOBS, refuses, workers=in_turn, file=file) == whole


@pytest.mark.parametrize("cut", [1, 30, 10_000])
def test_a_torn_end_is_done_again(file: Path, cut: int) -> None:
    """However much of the file a killed writer got out: a byte less, half a line, half a header."""
    whole = run_resumable(ABOUT, JOBS, double, workers=in_turn, file=file)
    written = file.read_bytes()
    file.write_bytes(written[: max(10, len(written) - cut)])
    assert run_resumable(ABOUT, JOBS, double, workers=in_turn, file=file) == whole
    assert file.read_bytes() == written


@pytest.mark.parametrize(
    "content",
    [b"notes, not a run", b"notes\nof mine\n", b'{"run": {"seed": 2, "study": "test"}}\n'],
)
def test_a_file_of_something_else_is_refused_and_left_alone(file: Path, content: bytes) -> None:
    """One line says what it is; not a byte of it changes."""
    file.parent.mkdir()
    file.write_bytes(content)
    with pytest.raises(FootsenseError, match=r"^[^\n]*run\.jsonl is of another run[^\n]*$"):
        run_resumable(ABOUT, JOBS, double, workers=in_turn, file=file)
    assert file.read_bytes() == content


def test_a_damaged_line_is_named(file: Path) -> None:
    """A whole line that is no result is no torn end: somebody has been at the file."""
    run_resumable(ABOUT, JOBS, double, workers=in_turn, file=file)
    lines = file.read_bytes().splitlines(keepends=True)
    file.write_bytes(b"".join([*lines[:2], b"{}\n", *lines[2:]]))
    with pytest.raises(FootsenseError, match="line 3"):
        run_resumable(ABOUT, JOBS, double, workers=in_turn, file=file)


@pytest.mark.parametrize(
    ("address", "why"),
    [
        ("tcp://127.0.0.1:9", "no scheduler at"),
        ("bench", "no address of a scheduler"),
        ("bench:many", "no address of a scheduler"),
    ],
)
def test_a_scheduler_that_is_not_there_is_one_clear_line(address: str, why: str) -> None:
    """Within seconds, and with what to do."""
    with pytest.raises(FootsenseError, match=rf"^[^\n]*{why}[^\n]*$"):
        run_resumable(ABOUT, JOBS, double, workers=job_runner(address))


@pytest.mark.slow
def test_other_processes_judge_alike_and_end_with_the_run(file: Path) -> None:
    """Same figures as in this process, whatever comes back first; no process stays behind."""
    found = run_resumable(ABOUT, JOBS, abs_gap, workers=job_runner(), file=file)
    assert list(found.items()) == [(job, abs_gap(job)) for job in JOBS]
    assert not multiprocessing.active_children()


@pytest.mark.slow
def test_a_dask_cluster_judges_alike(file: Path) -> None:
    """The workers of a scheduler get the jobs by its address."""
    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address="127.0.0.1:0") as cluster:
        workers = job_runner(cluster.scheduler_address)
        assert run_resumable(ABOUT, JOBS, double, workers=workers, file=file) == {
            job: double(job) for job in JOBS
        }


def test_each_foot_is_reproducible_by_itself(released: FootResponse) -> None:
    """By number and seed; at twice the tolerance twice the deviation, whatever else is inexact."""
    once = draw_deviations(released, Tolerances(gap_um=0.5), 7, 3)
    mixed = draw_deviations(released, Tolerances(gap_um=1.0, mount_deg=3.0, film_um=1.0), 7, 3)
    np.testing.assert_allclose(mixed.gap_um, 2.0 * once.gap_um, rtol=1e-12)
    np.testing.assert_allclose(mixed.mount @ mixed.mount.T, np.eye(3), atol=1e-12)
    assert not np.allclose(once.gap_um, draw_deviations(released, Tolerances(gap_um=0.5), 7, 4).gap_um)
    assert not np.allclose(once.gap_um, draw_deviations(released, Tolerances(gap_um=0.5), 8, 3).gap_um)


def test_feet_have_the_stated_distribution(released: FootResponse) -> None:
    """The rms values over many feet; what cannot be made is drawn again."""
    tolerances = Tolerances(gap_um=2.0, stray_pf=0.1, stiffness_rel=0.1, mount_deg=2.0)
    feet = [draw_deviations(released, tolerances, 1, foot) for foot in range(400)]
    rms = [float(np.sqrt(np.mean(np.square([getattr(f, k) for f in feet])))) for k in ("gap_um", "stray_pf")]
    np.testing.assert_allclose(rms, [2.0, 0.1], rtol=0.05)
    turned_deg = np.degrees(np.arccos([(np.trace(f.mount) - 1.0) / 2.0 for f in feet]))
    np.testing.assert_allclose(np.sqrt(np.mean(turned_deg**2)), 2.0, rtol=0.05)
    wild = [draw_deviations(released, Tolerances(gap_um=20.0, mount_deg=20.0), 1, foot) for foot in range(20)]
    assert min(f.gap_um.min() for f in wild) >= (MIN_DRAWN_OVER_DESIGN - 1.0) * released.design.gap_um
    assert min(f.mount[2, 2] for f in wild) >= np.cos(np.radians(15.0))


def test_an_exact_bench_measures_what_the_daemon_senses(released: FootResponse) -> None:
    """Of a foot with any deviations: the closures of the project's own verification cases, to rounding."""
    own = draw_deviations(released, Tolerances(gap_um=2.0, stray_pf=0.1, mount_deg=2.0), 1, 0)
    cases = paper_verification(released, own)
    measured = measure_foot(
        Foot(released, own), own.mount, cases.force_n, Tolerances(), np.random.default_rng(0)
    )
    np.testing.assert_allclose(measured.closure_um, cases.closure_um, atol=1e-9)
    np.testing.assert_array_equal(measured.reference_force_n, cases.force_n)


@pytest.mark.slow
def test_a_foot_is_judged_the_same_each_time() -> None:
    """A turned mount turns the answer by its angle; a foot's film alone is nothing to a read-out of closures."""
    exact, filmy, turned, again = (
        estimator_errors(Job(tolerances, 5), models=RELEASED, seed=1, epochs=1)
        for tolerances in (
            Tolerances(),
            Tolerances(film_um=0.5),
            Tolerances(mount_deg=10.0),
            Tolerances(mount_deg=10.0),
        )
    )
    assert turned == again
    assert turned["network_deg"] > exact["network_deg"] + 1.0
    assert turned["own_closure_deg"] < 1.5 * exact["own_closure_deg"]
    assert filmy["network_deg"] == pytest.approx(exact["network_deg"], abs=0.05)
    assert filmy["change_deg"] > exact["change_deg"]


def test_levels_are_interpolated_linearly() -> None:
    """The crossing of a target, or none; quick plans keep the exact foot and the largest level."""
    sweep = FOOT_SWEEPS[0]
    assert QUICK_PLAN.evaluated_levels(sweep)[0] == 0.0
    assert QUICK_PLAN.evaluated_levels(sweep)[-1] == FULL_PLAN.evaluated_levels(sweep)[-1]
    levels = {
        f"{gap_um:g}": {"network_deg": MeanStd.of_values([2.0 * gap_um] * 2)}
        for gap_um in FULL_PLAN.evaluated_levels(sweep)
    }
    results = SweepResults(
        plan=FULL_PLAN, designed_gap_um=20.0, statistics_by_sweep_and_level={sweep.varied_quantity: levels}
    )
    assert results.level_reaching(sweep, "network_deg", 9.0) == pytest.approx(4.5)
    assert results.level_reaching(sweep, "network_deg", 0.0) == 0.0
    assert results.level_reaching(sweep, "network_deg", 99.0) is None
    assert all(job.with_network for job in FULL_PLAN.jobs(TEST_STAND_SWEEPS[0], 1.0))
