"""Processes that run the jobs of a Monte Carlo, by joblib: on this machine, or the workers of a dask cluster."""

import importlib.util
import socket
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from urllib.parse import urlsplit

from joblib import Parallel, delayed, parallel_config
from joblib.externals.loky import get_reusable_executor

from footsense.errors import FootsenseError
from footsense.lab.monte_carlo.resumable_run import Figures, Job, Work, Workers

#: Time within which a scheduler, and the first of its workers, have to answer [s].
_ANSWER_S = 5.0
#: Worker processes on this machine.
LOCAL_WORKERS = 2


def parallel(scheduler: str | None = None, n_workers: int = LOCAL_WORKERS) -> Workers:
    """Return workers: local processes or a dask cluster.

    Args:
        scheduler: Address of a dask scheduler, such as `tcp://host:8786`; None for processes on this machine, which end
            with the run.
        n_workers: Processes on this machine; 1 for this process.

    Returns:
        The workers; they raise FootsenseError within seconds if the scheduler or its workers are missing.
    """

    def run(work: Work, jobs: Sequence[Job]) -> Generator[tuple[Job, Figures], None, None]:
        with _local(n_workers) if scheduler is None else _cluster(scheduler):
            try:
                yield from Parallel(return_as="generator_unordered")(
                    delayed(_done)(work, job) for job in jobs
                )
            except CancelledError as error:
                raise FootsenseError(
                    f"lost the scheduler {scheduler}; finished feet are kept in the file"
                ) from error

    return run


def _done(work: Work, job: Job) -> tuple[Job, Figures]:
    """Run one job, and return the job and the computed figures."""
    return job, work(job)


@contextmanager
def _local(n_workers: int) -> Iterator[None]:
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


@contextmanager
def _cluster(scheduler: str) -> Iterator[None]:
    """Use the workers of a dask scheduler.

    Yields:
        Nothing.

    Raises:
        FootsenseError: dask is not installed, there is no such scheduler, or it has no workers.
    """
    if importlib.util.find_spec("distributed") is None:
        raise FootsenseError("a cluster needs dask: pip install 'footsense[distributed]'")
    from distributed import Client

    _require_listener(scheduler)
    try:
        client = Client(scheduler, timeout=_ANSWER_S)
    except (OSError, ValueError) as error:
        raise FootsenseError(f"{scheduler} is no dask scheduler: {error}") from error
    with client:
        try:
            client.wait_for_workers(1, timeout=_ANSWER_S)
        except TimeoutError as error:
            raise FootsenseError(
                f"the scheduler {scheduler} has no workers; start one with `dask worker {scheduler}`"
            ) from error
        with parallel_config("dask"):
            yield


def _require_listener(scheduler: str) -> None:
    """Check that a scheduler answers: without one a dask client leaves a thread behind, or waits forever.

    Raises:
        FootsenseError: The address is invalid, nothing listens there, or it is not a dask server.
    """
    try:
        parts = urlsplit(scheduler if "://" in scheduler else f"tcp://{scheduler}")
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if host is None or port is None:
        raise FootsenseError(f"{scheduler!r} is no address of a scheduler; an example is tcp://host:8786")
    try:
        with socket.create_connection((host, port), timeout=_ANSWER_S) as line:
            if parts.scheme == "tcp":
                line.recv(1)  # a dask server speaks first
    except OSError as error:
        raise FootsenseError(
            f"no scheduler at {scheduler}: {error}; start one with `dask scheduler`, "
            "or name none to work on this machine"
        ) from error
