"""Worker processes for Monte Carlo jobs, by joblib: on this machine, or on a dask cluster."""

from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager

from joblib import Parallel, delayed, parallel_config
from joblib.externals.loky import get_reusable_executor

from footsense.errors import FootsenseError
from footsense.lab.monte_carlo.cluster import dask_workers
from footsense.lab.monte_carlo.resumable_run import Job, JobFunction, JobMetrics, JobRunner

#: Worker processes on this machine.
DEFAULT_N_LOCAL_WORKERS = 2


def job_runner(scheduler: str | None = None, n_workers: int = DEFAULT_N_LOCAL_WORKERS) -> JobRunner:
    """Return a function that runs jobs on local processes or a dask cluster.

    Args:
        scheduler: Address of a dask scheduler, such as `tcp://host:8786`; None for processes on this machine, which end
            with the run.
        n_workers: Processes on this machine; 1 for this process.

    Returns:
        The workers; they raise FootsenseError within seconds if the scheduler or its workers are missing.
    """

    def run(work: JobFunction, jobs: Sequence[Job]) -> Generator[tuple[Job, JobMetrics], None, None]:
        with _local_workers(n_workers) if scheduler is None else dask_workers(scheduler):
            try:
                yield from Parallel(return_as="generator_unordered")(
                    delayed(_run_job)(work, job) for job in jobs
                )
            except CancelledError as error:
                raise FootsenseError(
                    f"lost the scheduler {scheduler}; finished feet are kept in the file"
                ) from error

    return run


def _run_job(work: JobFunction, job: Job) -> tuple[Job, JobMetrics]:
    """Return a job together with its computed figures."""
    return job, work(job)


@contextmanager
def _local_workers(n_workers: int) -> Iterator[None]:
    """Run jobs in local worker processes inside the context, and end the processes on exit.

    Yields:
        Nothing.
    """
    with parallel_config("loky", n_jobs=n_workers, inner_max_num_threads=1):
        try:
            yield
        finally:
            if n_workers > 1:
                get_reusable_executor().shutdown(wait=True, kill_workers=True)
