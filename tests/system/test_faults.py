"""What breaks on one leg shows as the right state, on CAN and in the metrics, and touches no other leg.

The host costs nothing in these scenes, so no transaction more or less moves a conversion, and "untouched" can be taken
at its word: the other legs' forces are the same bits at the same times as in a run in which nothing breaks.
"""

from collections import Counter
from pathlib import Path

import can
import cantools
import numpy as np
import pytest
from numpy.typing import NDArray
from prometheus_client import CollectorRegistry

import firmware_interface
from footsense import app
from footsense.config import DEFAULT
from footsense.frames import USABLE, Cycle, State
from footsense.publish.exporter import SharedCollector
from footsense.publish.metrics import Metrics
from footsense.publish.shared_counters import read_counters
from footsense.sim.scene import load_scene

DBC = Path(firmware_interface.__file__).parent / "footsense.dbc"
DURATION_NS = 4_000_000_000
BROKEN_AT_NS = 2_000_000_000
#: After a line has broken, readings from before and after it are mixed for so long: two scans that it may lie across,
#: and a second whole one to tell motion.
SETTLED_NS = 100_000_000

NOTHING = ""
FAULTS = {
    "{at_s: 2.0, leg: rm, fault: absent}": State.ABSENT,
    "{at_s: 2.0, leg: rm, fault: stuck_converter}": State.CONVERTER_FAULT,
    "{at_s: 2.0, leg: rm, fault: deaf_switch}": State.CONVERTER_FAULT,
    "{at_s: 2.0, leg: rm, fault: broken_row, row: 0}, {at_s: 2.0, leg: rm, fault: broken_row, row: 2}": (
        State.ELEMENT_FAULT
    ),
}
#: One row is estimated from the two that remain.
BROKEN_ROW = "{at_s: 2.0, leg: rm, fault: broken_row, row: 1}"
#: What CAN and the metrics have to show, and the elements that a report names.
SHOWN = {**FAULTS, BROKEN_ROW: State.DEGRADED}
FAULT_MASKS = {State.ELEMENT_FAULT: 0b111000111, State.DEGRADED: 0b000111000}


class Walk:
    """A walk of four seconds in which something may break after two."""

    def __init__(self, fault: str, folder: Path) -> None:
        scene = folder / "scene.yaml"
        scene.write_text(
            "description: a fault\n"
            "load: {kind: tripod, period_s: 1.2, duty_rel: 0.6, peak_force_n: 1.0}\n"
            "effects: {converter_noise: true}\n"
            f"faults: [{fault}]\n"
        )
        self.log = folder / "can.log"
        self.cycles: list[Cycle] = []
        with app.service(DEFAULT, load_scene(str(scene)), real_time=False, can_log=self.log) as service:
            clock = service.scanning.clock
            metrics = Metrics(service.legs, service.sink.stats, directory=folder)
            service.observers += [self, metrics]
            assert service.scanning.felt_n is not None
            self.felt_n = service.scanning.felt_n
            service.run(lambda: clock.now_ns() > DURATION_NS)
            registry = CollectorRegistry()
            registry.register(SharedCollector(*read_counters(metrics.path)))
            self.faults = {
                (leg, state): registry.get_sample_value(
                    "footsense_faults_total", {"leg": leg, "kind": state.name.lower()}
                )
                for leg in service.legs
                for state in SHOWN.values()
            }
            self.leg_state = registry.get_sample_value("footsense_leg_state", {"leg": "rm"})
            metrics.close()
        self.legs = DEFAULT.legs

    def observe(self, cycle: Cycle) -> None:
        self.cycles.append(cycle)

    def close(self) -> None:
        pass

    def states(self, leg: str, from_ns: int) -> Counter[State]:
        row = self.legs.index(leg)
        return Counter(State(int(c.forces.state[row])) for c in self.cycles if c.forces.t_sent_ns > from_ns)

    def errors(self, leg: str, from_ns: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return error and sigma of a leg's forces [N], shape (scans, 3), against what it felt when measured."""
        row = self.legs.index(leg)
        late = [cycle.forces for cycle in self.cycles if cycle.forces.t_sent_ns > from_ns]
        felt_n = np.stack([self.felt_n(int(forces.t_ns[row]))[row] for forces in late])
        said_n = np.stack([forces.force_n[row] for forces in late])
        return said_n - felt_n, np.stack([forces.sigma_n[row] for forces in late])


@pytest.fixture(scope="module")
def walks(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Walk]:
    """The same walk with each fault and with none."""
    return {fault: Walk(fault, tmp_path_factory.mktemp("fault")) for fault in (NOTHING, *SHOWN)}


@pytest.mark.parametrize(("fault", "state"), FAULTS.items())
def test_the_leg_says_what_is_wrong_and_gives_no_force(
    walks: dict[str, Walk], fault: str, state: State
) -> None:
    """From the second scan after the fault on, nothing but this state, and never a number."""
    walk = walks[fault]
    assert walk.states("rm", BROKEN_AT_NS + 50_000_000).keys() == {state}
    row = walk.legs.index("rm")
    for cycle in walk.cycles:
        if cycle.forces.state[row] not in USABLE:
            assert np.isnan(cycle.forces.force_n[row]).all()


def test_a_broken_row_is_estimated_from_the_others(walks: dict[str, Walk]) -> None:
    """DEGRADED, each with a force, once the readings have settled; how far that is off, its sigma tells."""
    walk, healthy = walks[BROKEN_ROW], walks[NOTHING]
    assert walk.states("rm", BROKEN_AT_NS + SETTLED_NS).keys() == {State.DEGRADED}
    off_n, sigma_n = walk.errors("rm", BROKEN_AT_NS + SETTLED_NS)
    _, whole_sigma_n = healthy.errors("rm", BROKEN_AT_NS + SETTLED_NS)
    assert np.isfinite(off_n).all()
    # The rest is the moment of touching down, where a parabola through three readings says little.
    assert np.mean(np.abs(off_n) <= 3.0 * sigma_n) > 0.95
    assert (sigma_n.mean(axis=0) > whole_sigma_n.mean(axis=0)).all()
    # What is left of a foot is still worth having: the load on it is known to a tenth of the peak force.
    assert np.sqrt(np.mean(off_n[:, 2] ** 2)) < 0.1


@pytest.mark.parametrize("fault", SHOWN)
def test_the_other_legs_are_untouched(walks: dict[str, Walk], fault: str) -> None:
    """Same number of scans, same stamps, same forces to the bit."""
    healthy, broken = walks[NOTHING], walks[fault]
    others = [row for row, leg in enumerate(healthy.legs) if leg != "rm"]
    assert abs(len(healthy.cycles) - len(broken.cycles)) <= 1
    for a, b in zip(healthy.cycles, broken.cycles, strict=False):
        np.testing.assert_array_equal(a.forces.force_n[others], b.forces.force_n[others])
        np.testing.assert_array_equal(a.forces.t_ns[others], b.forces.t_ns[others])
        np.testing.assert_array_equal(a.forces.state[others], b.forces.state[others])


@pytest.mark.parametrize(("fault", "state"), SHOWN.items())
def test_can_and_metrics_show_it(walks: dict[str, Walk], fault: str, state: State) -> None:
    """The last force frame, the fault report and the counters name the state; a broken row names its elements."""
    walk = walks[fault]
    database = cantools.database.load_file(DBC)
    last: dict[str, dict[str, object]] = {}
    for message in can.LogReader(walk.log):
        name = database.get_message_by_frame_id(message.arbitration_id).name
        decoded = database.decode_message(message.arbitration_id, message.data)
        assert isinstance(decoded, dict)
        last[name] = decoded
    shown = "".join(part.capitalize() for part in state.name.split("_"))
    assert str(last["ForceRm"]["State"]) == shown
    assert str(last["FaultRm"]["State"]) == shown
    assert str(last["ForceLm"]["State"]) == "Valid"
    if state in FAULT_MASKS:
        assert last["QualityRm"]["FaultMask"] == last["FaultRm"]["FaultMask"] == FAULT_MASKS[state]
    assert (last["ForceRm"]["ForceZ"] == "NoValue") == (state not in USABLE)
    assert walk.faults["rm", state] == 1
    assert walk.faults["lm", state] == 0
    assert walk.leg_state == state


@pytest.mark.parametrize(
    ("fault", "between"),
    [
        (
            "{at_s: 2.0, until_s: 2.4, leg: rm, fault: absent}",
            {State.ABSENT, State.TARING, State.NO_BASELINE},
        ),
        ("{at_s: 2.0, leg: rm, fault: brown_out}", {State.CONVERTER_FAULT, State.STALE}),
    ],
)
def test_a_leg_recovers_by_itself(tmp_path: Path, fault: str, between: set[State]) -> None:
    """A cable that is plugged in again is tared anew, a converter that was reset is set up anew; then VALID again."""
    walk = Walk(fault, tmp_path)
    assert set(walk.states("rm", BROKEN_AT_NS + 100_000_000)) >= {State.VALID}
    last = walk.cycles[-1].forces
    assert last.state[walk.legs.index("rm")] == State.VALID
    seen = walk.states("rm", BROKEN_AT_NS + 50_000_000).keys() - {State.VALID}
    assert seen
    assert seen <= between | {State.STALE}
