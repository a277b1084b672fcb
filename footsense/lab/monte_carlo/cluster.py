"""Workers of a dask cluster for a campaign: one of its own on this machine, or one that is there already."""

import importlib.util
import logging
import signal
import socket
import threading
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

from footsense.errors import FootsenseError
from footsense.lab.monte_carlo.campaign import Figures, Job, Work, Workers

#: How long a scheduler, and the first of its workers, may take to answer [s].
_ANSWER_S = 5.0
#: Worker processes of a local cluster, one thread each.
LOCAL_WORKERS = 2


def on_cluster(scheduler: str | None = None, n_workers: int = LOCAL_WORKERS) -> Workers:
    """Return workers of a dask cluster.

    Args:
        scheduler: Address of a scheduler, such as `tcp://bench:8786`; None for a cluster of this campaign's own on
            this machine, which ends with it.
        n_workers: Processes of the own cluster.

    Returns:
        The workers; they raise FootsenseError within seconds where there are none.
    """

    def run(work: Work, jobs: Sequence[Job]) -> Generator[tuple[Job, Figures], None, None]:
        with _client(scheduler, n_workers) as client:
            from distributed import as_completed

            job_of = dict(zip(client.map(work, jobs, pure=False), jobs, strict=True))
            try:
                for future, figures in as_completed(job_of, with_results=True):
                    yield job_of[future], figures
            except CancelledError as error:
                raise FootsenseError(
                    f"lost the scheduler {scheduler}; feet that a campaign file holds are kept"
                ) from error

    return run


def has_dask() -> bool:
    """Return whether clusters can be used: the extra `distributed`."""
    return importlib.util.find_spec("distributed") is not None


@contextmanager
def _client(scheduler: str | None, n_workers: int) -> Iterator[Any]:
    """Provide a dask client, and end with it whatever was started for it.

    Yields:
        The client.

    Raises:
        FootsenseError: dask is not installed, there is no such scheduler, or it has no workers.
    """
    if not has_dask():
        raise FootsenseError("a cluster needs dask: pip install 'footsense[distributed]'")
    from distributed import Client, LocalCluster

    if scheduler is None:
        with _deaf_to_interrupts():
            cluster = LocalCluster(
                n_workers=n_workers,
                threads_per_worker=1,
                processes=True,
                dashboard_address="127.0.0.1:0",  # any free port: another cluster may have the usual one
                silence_logs=logging.CRITICAL,
            )
        with cluster, Client(cluster) as client:
            yield client
        return
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
        yield client


def _require_listener(scheduler: str) -> None:
    """Check that a scheduler answers: a dask client that finds none leaves a thread behind, or waits without end.

    Raises:
        FootsenseError: The address is none, or nobody listens there, or it is somebody else.
    """
    try:
        parts = urlsplit(scheduler if "://" in scheduler else f"tcp://{scheduler}")
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if host is None or port is None:
        raise FootsenseError(f"{scheduler!r} is no address of a scheduler; one looks like tcp://bench:8786")
    try:
        with socket.create_connection((host, port), timeout=_ANSWER_S) as line:
            if parts.scheme == "tcp":
                line.recv(1)  # a dask server speaks first
    except OSError as error:
        raise FootsenseError(
            f"no scheduler at {scheduler}: {error}; start one with `dask scheduler`, "
            "or name none to work on this machine"
        ) from error


@contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """Let processes that start in here ignore Ctrl-C: a terminal sends it to all, but this one ends the others.

    Yields:
        Nothing.
    """
    if threading.current_thread() is not threading.main_thread():  # only there can it be set
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
