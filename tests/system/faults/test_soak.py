"""The soak test: a short one passes, and what a broken service would do is found."""

from collections.abc import Callable

import msgspec
import numpy as np
import pytest

from footsense.daemon.service import open_service
from footsense.frames import Cycle, Flag, Vector
from footsense.validation.invariants import InvariantChecker
from footsense.validation.soak import soak_stretches, walk_stretch
from footsense.validation.tolerances import WalkLimits
from tests.support.seen import Seen

pytestmark = pytest.mark.slow

#: The first of a soak whose feet are made, with boards `ad7147`, and so much of it [s].
STRETCH = soak_stretches(1.0, 3)[0]
UNTIL_S = 5.0


def test_a_short_soak_finds_nothing() -> None:
    """Three lives of four seconds each, with commands, motions, restarts and clock steps; faults need more time."""
    result = walk_stretch(msgspec.structs.replace(STRETCH, hours=12.0 / 3600.0))
    assert result.first_violations == []
    assert result.n_answers > 0
    assert result.usable_share > 0.5


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> tuple[WalkLimits, list[Cycle], Callable[[int], Vector]]:
    """Return the cycles of a walk on made feet, its limits and its true forces."""
    scene = STRETCH.scene
    config = STRETCH.with_feet(scene, tmp_path_factory.mktemp("feet"))
    with open_service(config, scene, real_time=False) as service:
        seen = Seen()
        service.observers.append(seen)
        service.run(until_ns=UNTIL_S * 1e9)
        assert service.true_force_n_at is not None
        rules = WalkLimits.of(config, service.true_force_n_at, UNTIL_S)
        return rules, seen.cycles, service.true_force_n_at


def _changed(cycle: Cycle, **by: object) -> Cycle:
    return cycle._replace(forces=cycle.forces._replace(**by))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("break_it", "rule"),
    [
        (lambda cycle: cycle, None),
        (lambda cycle: _changed(cycle, sigma_n=0.05 * cycle.forces.sigma_n), "sigma covers the errors"),
        (lambda cycle: _changed(cycle, force_n=2.0 * cycle.forces.force_n), "no force is wrong for long"),
        (
            lambda cycle: _changed(cycle, t_ns=np.full_like(cycle.forces.t_ns, 2_000_000_000)),
            "no force above its age limit",
        ),
        (
            lambda cycle: _changed(cycle, flags=cycle.forces.flags ^ np.uint8(Flag.CONTACT)),
            "a foot that carries is in contact",
        ),
        (
            lambda cycle: _changed(cycle, sequence=cycle.forces.sequence // 2),
            "no frame is left out",
        ),
    ],
    ids=["nothing", "sigma too small", "force doubled", "stamp stands still", "contact reversed", "sequence"],
)
def test_a_broken_service_is_found(
    walk: tuple[WalkLimits, list[Cycle], Callable[[int], Vector]],
    break_it: Callable[[Cycle], Cycle],
    rule: str | None,
) -> None:
    """Whatever it does wrong in every cycle; the sound one passes."""
    rules, cycles, true_force_n_at = walk
    seen = InvariantChecker(rules, (), true_force_n_at)
    for cycle in cycles:
        seen.observe(break_it(cycle))
    seen.end(UNTIL_S, unanswered=[], ring_problem="", grown_mib=0.0)
    assert set(seen.n_violations) == set() if rule is None else rule in seen.n_violations
