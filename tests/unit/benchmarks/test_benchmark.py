"""The benchmark times what the service and the naive program really do."""

import pytest

from footsense.benchmarks.cycle import N_WARM_UP_CYCLES, compare_cycle_durations, simulated_walk_frames
from footsense.benchmarks.scan import FREE_CONFIGURATIONS, measure_free_scan
from footsense.benchmarks.trace import calls_per_conversion, functions_called_steadily
from footsense.benchmarks.virtual_feet import cost_of_a_foot, measure_virtual_feet
from footsense.benchmarks.wakeup_latency import measure_threads, measure_wakeup_latency
from footsense.config import DEFAULT, SMALL_BOARD, Config
from footsense.frames import CapFrame


@pytest.fixture(scope="module")
def scans() -> list[CapFrame]:
    """Scans of walking legs, those of the tare and a few more."""
    return simulated_walk_frames(N_WARM_UP_CYCLES + 12)


@pytest.mark.slow
def test_both_programs_are_timed(scans: list[CapFrame]) -> None:
    figures = compare_cycle_durations(scans)
    assert all(value is not None and value > 0 for value in figures.values())


@pytest.mark.slow
def test_the_loop_answers_for_every_deadline(scans: list[CapFrame]) -> None:
    """It runs in a process of its own, under the scheduling that it was granted."""
    figures = measure_wakeup_latency(scans, seconds=0.05)
    assert all(tail > 0 for case in ("quiet", "loaded") for tail in figures[case].values())


@pytest.mark.slow
def test_a_batch_is_far_faster_than_feet_one_by_one() -> None:
    """A step of one foot takes four milliseconds; the libraries' forces are the same within 1e-5 of the range."""
    figures = measure_virtual_feet("ad7147", n_feet=512, n_steps=1)
    assert figures["numpy"]["step_ms"] < 512 * 0.5
    assert figures["jax"]["off_n"] < 1e-5 * 28.8


def test_what_a_gpu_computes_for_a_foot_is_counted() -> None:
    """The table's half and the network's half of a million floating point operations; a state of some hundred bytes."""
    counted = cost_of_a_foot("ad7147")
    assert counted == {"table": 176_904, "cells": 5_832, "network": 219_520, "bytes": counted["bytes"]}
    assert 500 < counted["bytes"] < 1000


def test_three_legs_of_a_bus_are_read_twice_a_scan_whatever_a_host_costs() -> None:
    """At 150 us a transaction; four legs are read once."""
    six, four = (measure_free_scan(config, 150) for config in FREE_CONFIGURATIONS.values())
    assert six["frames_hz"] == pytest.approx(148, abs=1)
    assert six["transactions_hz"] == pytest.approx((2 * 3 * 2 + 1) * 148, rel=0.01)
    assert four["frames_hz"] == pytest.approx(176, abs=1)
    assert 0.5 < four["bus_load_rel"] < six["bus_load_rel"] < 1.0
    assert max(six["age_p99_ms"], four["age_p99_ms"]) < 7.0


def test_threads_take_time() -> None:
    figures = measure_threads(20)
    assert figures["in_turn"] > 0.0 < figures["in_threads"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "n_modules", "n_calls"), [(SMALL_BOARD, 28, 174), (DEFAULT, 33, 410)], ids=["small", "default"]
)
def test_a_frame_of_six_legs_stays_within_its_modules_and_calls(
    robot: Config, n_modules: int, n_calls: int
) -> None:
    """Registers, ring and run statistics included; the simulator is left out."""
    calls = calls_per_conversion(config=robot)
    modules = {module for module, _ in functions_called_steadily(calls)}
    for part in ("estimation/network.py", "can/sink.py", "ring/cycle_ring.py"):
        assert f"footsense/{part}" in modules
    assert not any(module.startswith("footsense/sim/") for module in modules)
    assert len(modules) <= n_modules, sorted(modules)
    assert sum(calls.values()) <= n_calls
