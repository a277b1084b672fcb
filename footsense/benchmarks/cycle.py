"""Part of `footsense benchmark`: duration of a cycle of the daemon, of a C program and of a naive program."""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

import numpy as np

from footsense.benchmarks.c_program import CProgram, converter_codes, has_c_program
from footsense.benchmarks.naive import NaiveCycle, has_cantools
from footsense.benchmarks.our_cycle import (
    N_WARM_UP_CYCLES,
    REALTIME_PRIORITY,
    ServiceCycle,
    open_service_cycle,
    send_time_ns,
    tared_c_program,
)
from footsense.clock import fifo_priority, low_latency_interpreter, stopwatch_ns
from footsense.config import DEFAULT
from footsense.errors import FootsenseError
from footsense.frames import CapFrame, Mask, State, Vector

T = TypeVar("T")

#: The programs that are timed.
_PROGRAM_NAMES = ("ours", "c_program", "naive")
#: Cycles in a row of one program before the turn of the next.
_CYCLES_BEFORE_NEXT_PROGRAM = 25
#: Largest difference between the floor's forces and ours [N]: half a step of the wire.
_MAX_FORCE_DIFFERENCE_N = 1e-3


def compare_cycle_durations(scans: list[CapFrame]) -> dict[str, Any]:
    """Return quantiles of the cycle durations of daemon, C program and naive program [us], and their ratios.

    Values are None without the C floor or the naive program.

    Hot: cycles of one program in a row. Cold: each after a cycle of the naive program, which evicts the caches as the
    rest of a robot's software does.

    Args:
        scans: Scans to process; the first `N_WARM_UP_CYCLES` do not count.

    Raises:
        FootsenseError: The forces of the C floor are not ours.
    """
    return {**_duration_quantiles(scans, _CYCLES_BEFORE_NEXT_PROGRAM), "cold": _duration_quantiles(scans, 1)}


def _duration_quantiles(scans: list[CapFrame], cycles_per_turn: int) -> dict[str, float | None]:
    """Return quantiles of the cycle durations of each program [us], and their ratios."""
    naive = NaiveCycle(DEFAULT) if has_cantools() else None
    with TemporaryDirectory() as folder, open_service_cycle() as ours:
        floor = tared_c_program(Path(folder), scans) if has_c_program() else None
        with low_latency_interpreter(), fifo_priority(REALTIME_PRIORITY):
            times_ns = _time_programs(scans, cycles_per_turn, ours, floor, naive)
    ours_us, floor_us, naive_us = (
        np.array(times_ns[name][N_WARM_UP_CYCLES:]) * 1e-3 for name in _PROGRAM_NAMES
    )
    p50 = float(np.median(ours_us))
    c_program_p50, naive_p50 = (float(np.median(us)) if len(us) else None for us in (floor_us, naive_us))
    return {
        "p50": p50,
        "p99": float(np.quantile(ours_us, 0.99)),
        "c_program_p50": c_program_p50,
        "naive_p50": naive_p50,
        "cycle_over_c_program": p50 / c_program_p50 if c_program_p50 else None,
        "naive_over_cycle": naive_p50 / p50 if naive_p50 else None,
    }


def _time_programs(
    scans: list[CapFrame],
    cycles_per_turn: int,
    ours: ServiceCycle,
    floor: CProgram | None,
    naive: NaiveCycle | None,
) -> dict[str, list[int]]:
    """Return the cycle durations of three programs [ns], run in turns so that background load affects all equally."""
    times_ns: dict[str, list[int]] = {name: [] for name in _PROGRAM_NAMES}
    loopback = ours.loopback

    def run_timed(name: str, program: Callable[..., T], *arguments: object) -> T:
        start_ns = stopwatch_ns()
        result = program(*arguments)
        times_ns[name].append(stopwatch_ns() - start_ns)
        loopback.drain()
        return result

    for first in range(0, len(scans), cycles_per_turn):
        done = []
        for scan in scans[first : first + cycles_per_turn]:
            now_ns, baseline_pf = send_time_ns(scan), ours.baseline_pf()
            forces = run_timed("ours", ours.run, scan, now_ns).forces
            # Keep nothing else of the cycle: the service keeps none, and new memory is cold.
            valid = forces.state == State.VALID
            done.append((scan, now_ns, baseline_pf, forces.force_n[valid], valid))
            del forces
        for number, (scan, now_ns, baseline_pf, ours_n, valid) in enumerate(done, first):
            if floor is None:
                break
            codes = converter_codes(scan)
            floor.tare(baseline_pf)
            sinks = loopback.socket.fileno(), loopback.pipe
            force_n = run_timed("c_program", floor.run, scan, codes, now_ns, *sinks)
            if number >= N_WARM_UP_CYCLES:
                _check_equal_forces(scan, ours_n, force_n, valid)
        for scan, now_ns, *_ in done:
            if naive is None:
                break
            run_timed("naive", naive.run, scan, now_ns, loopback.socket, loopback.pipe)
    return times_ns


def _check_equal_forces(
    scan: CapFrame,
    ours_n: Vector,
    c_program_n: Vector,
    valid: Mask,
) -> None:
    """Raise an error if the forces of the C program differ from those of the daemon.

    Args:
        scan: The scan.
        ours_n: Our forces of the valid legs [N], shape (valid legs, 3).
        c_program_n: Forces of the C floor [N], shape (legs, 3).
        valid: Validity of each leg, shape (legs,).

    Raises:
        FootsenseError: It gives other forces.
    """
    difference_n = np.abs(ours_n - c_program_n[valid]).max(initial=0.0)
    if not difference_n < _MAX_FORCE_DIFFERENCE_N:
        raise FootsenseError(
            f"cycle {scan.sequence}: the floor in C differs by {difference_n:.2g} N from ours"
        )
