"""An observer that keeps every cycle of a service, and the walk that it sees."""

from collections.abc import Callable
from pathlib import Path

from footsense.config import Config
from footsense.daemon.service import open_service
from footsense.frames import Cycle, Vector
from footsense.sim.scene import Scene


class Seen:
    """Keeps cycles.

    Attributes:
        cycles: All so far.
    """

    def __init__(self) -> None:
        self.cycles: list[Cycle] = []

    def observe(self, cycle: Cycle) -> None:
        self.cycles.append(cycle)

    def close(self) -> None: ...


def walked(
    scene: Scene,
    until_s: float,
    felt: Callable[[Cycle, Vector], None] = lambda cycle, true_n: None,
    *,
    robot: Config,
    record: Path | None = None,
) -> list[Cycle]:
    """Return the cycles of a scene; `felt` is shown each with what the feet felt when it was sent [N]."""
    with open_service(robot, scene, real_time=False, record=record) as running:
        seen = Seen()
        running.observers.append(seen)
        running.run(until_ns=until_s * 1e9)
        assert running.true_force_n_at is not None
        for cycle in seen.cycles:
            felt(cycle, running.true_force_n_at(cycle.forces.t_sent_ns))
    return seen.cycles
