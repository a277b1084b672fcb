"""Parts of a study side by side: the same results in their order from other processes."""

import multiprocessing

import pytest

from footsense.lab.parallel import compute_each

pytestmark = pytest.mark.lab


@pytest.mark.slow
def test_other_processes_compute_alike_and_end_with_the_call() -> None:
    assert compute_each(abs, [-3.1, 2.0, -1.0]) == [3.1, 2.0, 1.0]
    assert not multiprocessing.active_children()
