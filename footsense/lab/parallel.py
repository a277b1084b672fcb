"""Independent parts of a study, computed side by side by processes of this machine."""

from collections.abc import Callable, Iterable
from typing import TypeVar

from joblib import Parallel, delayed, parallel_config
from joblib.externals.loky import get_reusable_executor

Part = TypeVar("Part")
Result = TypeVar("Result")

#: Processes on this machine.
N_PROCESSES = 2


def compute_each(
    work: Callable[[Part], Result], parts: Iterable[Part], *, n_processes: int = N_PROCESSES
) -> list[Result]:
    """Return `work(part)` of every part, in their order; the processes end with the call.

    Args:
        work: Works on one part; picklable, as the parts.
        parts: The parts.
        n_processes: Processes on this machine; 1 for this process.
    """
    try:
        with parallel_config("loky", n_jobs=n_processes, inner_max_num_threads=1):
            return list(Parallel()(delayed(work)(part) for part in parts))
    finally:
        if n_processes > 1:
            get_reusable_executor().shutdown(wait=True, kill_workers=True)
