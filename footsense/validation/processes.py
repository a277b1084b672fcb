"""Run the parts of a long simulation in parallel child processes."""

import logging
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from typing import TypeVar

Part = TypeVar("Part")
PartResult = TypeVar("PartResult")


def run_in_processes(
    work: Callable[[Part], PartResult],
    parts: Iterable[Part],
    n_processes: int,
    max_parts_per_process: int | None = None,
) -> Iterator[PartResult]:
    """Yield `work(part)` for every part, computed in child processes, in order of completion; warnings are suppressed.

    Args:
        work: Works on one part; picklable.
        parts: The parts.
        n_processes: Processes at a time.
        max_parts_per_process: Parts that a process works on before a new one replaces it; None for no limit.

    Yields:
        Each result as it is complete, not in the order of the parts.
    """
    with ProcessPoolExecutor(
        n_processes,
        get_context("spawn"),
        logging.disable,
        (logging.WARNING,),
        max_tasks_per_child=max_parts_per_process,
    ) as processes:
        for done in as_completed([processes.submit(work, part) for part in parts]):
            yield done.result()
