"""Distribution of a long simulation over child processes."""

import logging
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from typing import TypeVar

Part = TypeVar("Part")
PartResult = TypeVar("PartResult")


def in_processes(
    work: Callable[[Part], PartResult],
    parts: Iterable[Part],
    n_processes: int,
    parts_per_process: int | None = None,
) -> Iterator[PartResult]:
    """Work on parts side by side, without the daemon's warnings: simulated faults are on purpose.

    Args:
        work: Works on one part; picklable.
        parts: The parts.
        n_processes: Processes at a time.
        parts_per_process: Parts after which a new process replaces one; None for no limit.

    Yields:
        Each result as it is complete.
    """
    with ProcessPoolExecutor(
        n_processes,
        get_context("spawn"),
        logging.disable,
        (logging.WARNING,),
        max_tasks_per_child=parts_per_process,
    ) as processes:
        for done in as_completed([processes.submit(work, part) for part in parts]):
            yield done.result()
