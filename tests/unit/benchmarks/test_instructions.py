"""Instructions are given to the part that executes them, and compared with those of the same Python alone."""

from pathlib import Path

import pytest

from footsense.benchmarks.counted_cycles import Marks
from footsense.benchmarks.instructions import costs_of_cycles, dumped_counts
from footsense.errors import FootsenseError
from tests.golden import instructions as golden

#: A cycle, then an empty function and what stands for the kernel, with the instructions up to each mark: a mark costs
#: 10 inside and 20 outside, an answer 7.
TRACE = (
    *(("+loop", 0), ("+acquisition", 120), ("-acquisition", 650), ("+network", 720), ("-network", 1530)),
    *(("-loop", 1600), ("+empty", 1700), ("+nothing", 1720), ("-nothing", 1730), ("-empty", 1750)),
    *(("+empty", 1800), ("+answer", 1820), ("-answer", 1837), ("-empty", 1857)),
)


def test_marks_and_the_recorded_kernel_are_left_out() -> None:
    names, counts = zip(*TRACE, strict=True)
    (cycle,) = costs_of_cycles(Marks(list(names), list(counts)), n_transactions=[3])
    spent = {part: n for part, n in cycle.items() if n}
    assert spent == {
        "loop": 110 + 50 + 50,
        "acquisition": 520 - 3 * 7,
        "network": 800,
    }


def test_a_mark_without_a_count_is_an_error(tmp_path: Path) -> None:
    """Counts would go to other parts than their own."""
    counts = tmp_path / "counts"
    counts.with_name("counts.1").write_text("events: Ir\nsummary: 12\n\ntotals: 12\n")
    assert dumped_counts(counts, 1) == [12]
    with pytest.raises(FootsenseError, match="mark 2 of 2"):
        dumped_counts(counts, 2)


def test_only_what_has_grown_by_more_than_a_twentieth_is_told() -> None:
    committed = {"healthy": {"median": 1_000_000, "network": 1_000_000, "ring": 1_000_000}}
    now = {"healthy": {"median": 1_050_000, "network": 1_080_000, "ring": 500_000}}
    (line,) = golden.grown(now, committed)
    assert line.startswith("healthy network: 1.080 M instructions, 1.000 M in instructions.json: 8 % more")


def test_figures_of_another_python_are_not_compared() -> None:
    same = {"counter": "valgrind", "python": "3.11.7"}
    assert golden.differences(same, same) == ""
    assert golden.differences(same | {"python": "3.12.1"}, same) == "python is 3.12.1, not 3.11.7"
