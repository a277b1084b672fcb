"""Dask cluster as joblib backend, with an error within seconds if the scheduler does not answer."""

import importlib.util
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from urllib.parse import urlsplit

from joblib import parallel_config

from footsense.errors import FootsenseError

#: Time within which a scheduler, and the first of its workers, have to answer [s].
_CONNECT_TIMEOUT_S = 5.0


@contextmanager
def dask_workers(scheduler: str) -> Iterator[None]:
    """Run joblib calls inside the context on the workers of a dask scheduler.

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
        client = Client(scheduler, timeout=_CONNECT_TIMEOUT_S)
    except (OSError, ValueError) as error:
        raise FootsenseError(f"{scheduler} is no dask scheduler: {error}") from error
    with client:
        try:
            client.wait_for_workers(1, timeout=_CONNECT_TIMEOUT_S)
        except TimeoutError as error:
            raise FootsenseError(
                f"the scheduler {scheduler} has no workers; start one with `dask worker {scheduler}`"
            ) from error
        with parallel_config("dask"):
            yield


def _require_listener(scheduler: str) -> None:
    """Raise an error unless a scheduler accepts connections (a dask client would wait forever).

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
        with socket.create_connection((host, port), timeout=_CONNECT_TIMEOUT_S) as line:
            if parts.scheme == "tcp":
                line.recv(1)  # a dask server speaks first
    except OSError as error:
        raise FootsenseError(
            f"no scheduler at {scheduler}: {error}; start one with `dask scheduler`, "
            "or name none to work on this machine"
        ) from error
