"""Feet of other arrays than the paper's, read through the simulated chips of a leg."""

import numpy as np
import pytest
from numpy.typing import NDArray

from firmware_interface.conversion_order import conversion_order
from footsense.acquisition.bus_scanner import BusScanner
from footsense.acquisition.robot_scanner import RobotScanner
from footsense.acquisition.scan_plan import scan_plan
from footsense.acquisition.transports import UpstreamBus
from footsense.estimation.baseline.contact import ContactLimits
from footsense.estimation.baseline.tare import TareLimits
from footsense.estimation.pipeline import Pipeline
from footsense.estimation.sensitivity import sensitivity
from footsense.foot.files.network_card import TrainedInputs
from footsense.foot.specimen import Foot
from footsense.frames import ContactFrame, Reading, State
from footsense.ports import LoadEstimate, Window
from footsense.sim.robot import BusWiring, SimulatedRobot
from footsense.sim.scene_files import load_scene
from tests.support.arrays import response
from tests.support.feet import DESIGN

LEGS = {leg: channel for channel, leg in enumerate(("lf", "lm", "lr", "rf", "rm", "rr"))}


@pytest.mark.parametrize("rows", [3, 4])
def test_in_the_order_of_a_square_no_growing_force_is_a_tilt(rows: int) -> None:
    """Opposite elements, rows and columns have the same mean time; neighbours in time never share a column."""
    order = np.array(conversion_order("lo_shu", rows))
    place = np.argsort(order)
    assert set(place + place[::-1]) == {rows**2 - 1}
    grid = place.reshape(rows, rows)
    assert set(grid.sum(axis=0)) == set(grid.sum(axis=1)) == {rows * (rows**2 - 1) // 2}
    assert (np.diff(np.append(order, order[0]) % rows) != 0).all()


@pytest.mark.parametrize("board", ["fdc1004", "ad7746"])
@pytest.mark.parametrize("rows", [2, 3, 4])
def test_every_element_of_an_array_is_read_at_its_place(rows: int, board: str) -> None:
    """Six standing legs over one simulated bus: all readings are OK, each of its own element."""
    wiring = BusWiring(400_000, 0x71, LEGS, kernel_mux=False, board=board)
    robot = SimulatedRobot(load_scene("hanging"), response(rows), [wiring])
    made_pf = np.linspace(4.2, 8.5, rows**2)
    for leg in robot.legs.values():
        leg.wired._undamaged_pf = lambda _: made_pf.tolist()
    [bus] = robot.buses
    rate_sps = 400 if board == "fdc1004" else 91
    scanner = BusScanner(UpstreamBus(bus, 0x71), bus.clock, LEGS, scan_plan("lo_shu", rate_sps, board, rows))
    scanner.start()
    for _ in range(rows**2):
        readings = scanner.read_next_element()
    assert (readings.reading == Reading.OK).all()
    stray_pf = readings.capacitance_pf - made_pf
    assert np.ptp(stray_pf) < 0.05


class Linear:
    """A read-out of the newest closures that is exact for the made-up foot."""

    def __init__(self, per_newton: NDArray[np.float64]) -> None:
        self._matrix = np.linalg.pinv(per_newton)

    def estimate(self, window: Window) -> LoadEstimate:
        """Return the load of every row."""
        force_n = window.closure_rel[:, 0] @ self._matrix.T
        none = np.zeros((len(force_n), 4))
        return LoadEstimate(force_n, np.full_like(force_n, 0.01), none, none + 1.0)


@pytest.mark.parametrize("rows", [2, 3, 4])
def test_an_array_gives_forces_from_chip_to_pipeline(rows: int) -> None:
    """Tared in the air, then loaded: every leg is VALID and right; with an electrode off, it is named in the mask."""
    table, force_n, n = response(rows), np.array([0.1, -0.05, 0.6]), rows**2
    up, axes = np.tile([0.0, 0.0, 1.0], (3, 1)), np.eye(3)
    per_newton = table.free_element_closures_um(up, axes).T / DESIGN.gap_um
    robot = SimulatedRobot(load_scene("hanging"), table, [BusWiring(400_000, 0x71, LEGS)])
    [bus] = robot.buses
    plan = scan_plan("lo_shu", 400, rows=rows)
    source = RobotScanner([BusScanner(UpstreamBus(bus, 0x71), bus.clock, LEGS, plan)])
    source.start()
    linear, scan_ns = Linear(per_newton), n * 2_750_000
    rng = np.random.default_rng(1)
    closures = rng.normal([0.0, 0.0, 0.8], 0.2, (2000, 3)) @ per_newton.T + 1e-3 * rng.normal(size=(2000, n))
    moments = closures.T @ closures / len(closures)
    trained = TrainedInputs(
        design=DESIGN, closure_rel_min=np.full(n, -0.1), closure_rel_max=np.full(n, 0.9), moments=moments
    )
    pipeline = Pipeline(
        linear,
        trained,
        np.full((6, n), load_scene("hanging").effects.stray_pf),
        np.full((6, n), DESIGN.unloaded_pf),
        sensitivity=sensitivity(linear, 6, moments),
        tare=TareLimits(window_frames=8, noise_limit_ff=5.0, unloaded_limit_rel=0.03),
        contact=ContactLimits(min_threshold_n=0.03),
        scan_ns=scan_ns,
        max_age_ns=500_000_000,
        settling_time_ns=4 * scan_ns,
    )

    def after(scans: int) -> ContactFrame:
        for _ in range(scans * n):
            frame = source.read()
            forces, _ = pipeline.process(frame, bus.clock.now_ns())
        return forces

    assert (after(12).state == State.VALID).all()
    loaded_pf = Foot(table).capacitance_pf(up[:1], force_n[None])[0].tolist()
    for leg in robot.legs.values():
        leg.wired._undamaged_pf = lambda _: loaded_pf
    forces = after(12)
    assert (forces.state == State.VALID).all()
    np.testing.assert_allclose(forces.force_n, np.tile(force_n, (6, 1)), atol=5e-3)
    robot.legs["rm"].wired._undamaged_pf = lambda _: [*loaded_pf[:-1], 0.1]
    forces = after(12)
    assert forces.fault_mask.tolist() == [0, 0, 0, 0, 1 << n - 1, 0]
    assert forces.state[4] == State.DEGRADED
    np.testing.assert_allclose(forces.force_n, np.tile(force_n, (6, 1)), atol=0.02)
