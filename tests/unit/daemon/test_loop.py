"""The loop runs without the collector of garbage, so it must not make any that needs one."""

import gc
from pathlib import Path

import pytest

from footsense.config import SMALL_BOARD
from footsense.daemon.service import open_service
from footsense.sim.scene import load_scene

#: One leg comes and goes, one has a converter that stops, one holds the bus: transactions fail in every scan.
FAULTS = """[{at_s: 0.5, until_s: 1.2, leg: rm, fault: absent}, {at_s: 0.6, leg: lf, fault: stuck_converter},
    {at_s: 1.0, leg: rr, fault: stuck_sda}]"""


@pytest.mark.parametrize("faults", ["[]", FAULTS])
def test_the_loop_leaves_nothing_to_collect(faults: str, tmp_path: Path) -> None:
    """Fifty cycles of a walk, failing legs among them: all that they made is gone when they are over."""
    scene = tmp_path / "scene.yaml"
    scene.write_text(
        "description: a walk\nload: {kind: tripod, period_s: 1.2, duty_rel: 0.6, peak_force_n: 1.0}\n"
        f"faults: {faults}\n"
    )
    cycles = iter(range(80))
    with open_service(SMALL_BOARD, load_scene(str(scene)), real_time=False) as service:
        service.run_until(service.source, stop=lambda: next(cycles) >= 30)
        gc.collect()
        gc.disable()
        try:
            service.run_until(service.source, stop=lambda: next(cycles, None) is None)
            assert gc.collect() == 0
        finally:
            gc.enable()
