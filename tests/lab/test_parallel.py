"""Parts of a study side by side: the same results in their order from other processes and from a cluster."""

import multiprocessing

import pytest
from distributed import LocalCluster

from footsense.errors import FootsenseError
from footsense.lab.parallel import compute_each

pytestmark = pytest.mark.lab


@pytest.mark.slow
@pytest.mark.parametrize(
    ("address", "why"),
    [("tcp://127.0.0.1:9", "no dask scheduler at"), ("bench", "no dask scheduler at")],
)
def test_a_scheduler_that_is_not_there_is_one_clear_line(address: str, why: str) -> None:
    with pytest.raises(FootsenseError, match=rf"^[^\n]*{why}[^\n]*$"):
        compute_each(abs, [-1], scheduler=address)


@pytest.mark.slow
def test_other_processes_compute_alike_and_end_with_the_call() -> None:
    assert compute_each(abs, [-3.1, 2.0, -1.0]) == [3.1, 2.0, 1.0]
    assert not multiprocessing.active_children()


@pytest.mark.slow
def test_a_dask_cluster_computes_alike() -> None:
    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address="127.0.0.1:0") as cluster:
        assert compute_each(abs, [-3.1, 2.0], scheduler=cluster.scheduler_address) == [3.1, 2.0]
