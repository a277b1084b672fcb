"""Independent parts of a study, computed side by side: by processes of this machine, or by a dask cluster."""

from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager, ExitStack
from typing import Any, TypeVar

from joblib import Parallel, delayed, parallel_config
from joblib.externals.loky import get_reusable_executor

from footsense.errors import FootsenseError, require

Part = TypeVar("Part")
Result = TypeVar("Result")

#: Processes on this machine.
N_PROCESSES = 2
#: Time within which a scheduler, and the first of its workers, have to answer [s].
_ANSWER_TIMEOUT_S = 5.0


def compute_each(
    work: Callable[[Part], Result],
    parts: Iterable[Part],
    *,
    scheduler: str | None = None,
    n_processes: int = N_PROCESSES,
) -> list[Result]:
    """Return `work(part)` of every part, in their order.

    Args:
        work: Works on one part; picklable, as the parts.
        parts: The parts.
        scheduler: Address of a dask scheduler, such as `tcp://host:8786`, whose workers have the same files; None for
            processes of this machine, which end with the call.
        n_processes: Processes on this machine; 1 for this process.

    Raises:
        FootsenseError: There is no such scheduler, or it has no workers.
    """
    with ExitStack() as stack:
        if scheduler is not None:
            stack.enter_context(_dask_client(scheduler))
            stack.enter_context(parallel_config("dask"))
        else:
            stack.enter_context(parallel_config("loky", n_jobs=n_processes, inner_max_num_threads=1))
            if n_processes > 1:
                stack.callback(lambda: get_reusable_executor().shutdown(wait=True, kill_workers=True))
        return list(Parallel()(delayed(work)(part) for part in parts))


def _dask_client(scheduler: str) -> AbstractContextManager[Any]:
    """Return a client of a scheduler that has workers.

    Raises:
        FootsenseError: dask is not installed, there is no such scheduler, or it has no workers.
    """
    require("a cluster", "distributed", "distributed")
    from distributed import Client

    try:
        client = Client(scheduler, timeout=_ANSWER_TIMEOUT_S)
    except (OSError, ValueError, AssertionError) as error:  # the last for a port that is no number
        raise FootsenseError(
            f"no dask scheduler at {scheduler}: {error}; start one with `dask scheduler`"
        ) from error
    try:
        client.wait_for_workers(1, timeout=_ANSWER_TIMEOUT_S)
    except TimeoutError as error:
        client.close()
        raise FootsenseError(
            f"the scheduler {scheduler} has no workers; start one with `dask worker {scheduler}`"
        ) from error
    return client  # type: ignore[no-any-return]
