"""The C floor and the naive program of the benchmark do the same work as the service."""

import pytest

from footsense.benchmarks.c_program import has_c_program
from footsense.benchmarks.cycle import compare_cycle_durations
from footsense.benchmarks.our_cycle import N_WARM_UP_CYCLES, simulated_walk_frames
from footsense.benchmarks.viewed_latency import measure_viewed_latency
from footsense.benchmarks.wakeup_latency import measure_wakeup_latency
from footsense.frames import CapFrame

needs_c = pytest.mark.skipif(not has_c_program(), reason="no C compiler or no onnx here")


@pytest.fixture(scope="module")
def scans() -> list[CapFrame]:
    """Scans of walking legs, those of the tare and a few more."""
    return simulated_walk_frames(N_WARM_UP_CYCLES + 12)


@needs_c
def test_floor_and_naive_give_our_forces(scans: list[CapFrame]) -> None:
    """Every cycle is compared while it is timed; with something to compare there is a ratio."""
    figures = compare_cycle_durations(scans)
    assert all(figures[name] is not None for name in ("p50", "p99", "c_program_p50", "naive_p50"))


@needs_c
def test_both_loops_answer_for_every_deadline(scans: list[CapFrame]) -> None:
    """The loops run in processes of their own, under the scheduling that they were granted."""
    figures = measure_wakeup_latency(scans, seconds=0.05)
    for case in ("quiet", "loaded"):
        assert set(figures[case]["tails"]) == {"ours", "c"}
        assert all(tail > 0 for tails in figures[case]["tails"].values() for tail in tails.values())
    assert figures["fifo"] == (not figures["not_granted"])


def test_the_loop_is_timed_alone_and_while_somebody_looks(scans: list[CapFrame]) -> None:
    """In one run, beside a viewer and clients that do not read."""
    figures = measure_viewed_latency(scans, seconds=0.05)
    assert set(figures["tails"]) == {"alone", "viewed"}
    assert all(tail > 0 for tails in figures["tails"].values() for tail in tails.values())
