"""A service that walks for a day takes no more memory than one that walks for a minute.

The loop runs without garbage collection, so whatever refers to itself is never given back. A day in virtual time
takes most of one (CONTRIBUTING.md has its command); these are enough cycles to see what grows with every one of them.
"""

import gc
import sys
from pathlib import Path

import pytest

from footsense.config import load_config
from footsense.daemon.scheduling import resident_mib
from footsense.daemon.service import open_service
from footsense.sim.scene import load_scene
from footsense.telemetry.run_statistics import RunStatistics
from tests.system.command import robot

pytestmark = pytest.mark.slow

#: Until then pools fill up, such as those of the interpreter and of the allocator.
WARM_CYCLES = 800
CYCLES = 1000


def test_nothing_grows_with_the_cycles(tmp_path: Path) -> None:
    """Recorded, counted, logged and sent, a cycle leaves no object, no memory and no garbage behind."""
    config = load_config(robot(tmp_path, more=f"ring: {tmp_path / 'ring'}\n"))
    record = tmp_path / "walk.mcap"
    with open_service(config, load_scene("hanging"), real_time=False, record=record) as service:
        service.observers.append(RunStatistics(service.legs, service.true_force_n_at))

        def run(n_cycles: int) -> None:
            left = iter(range(n_cycles))
            service.run(lambda: next(left, None) is None)

        run(WARM_CYCLES)
        gc.collect()
        gc.disable()
        try:
            blocks, mib = sys.getallocatedblocks(), resident_mib()
            run(CYCLES)
            assert gc.collect() < CYCLES / 20
            assert (sys.getallocatedblocks() - blocks) / CYCLES < 0.5
            assert resident_mib() - mib < 1.5
        finally:
            gc.enable()
