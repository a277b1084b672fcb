"""Feet of other arrays than the paper's, read through the simulated chips of a leg."""

import numpy as np
import pytest

from footsense.acquisition.bus_scanner import BusScanner
from footsense.acquisition.scan_plan import conversion_order, scan_plan
from footsense.acquisition.transports import UpstreamBus
from footsense.foot.response_table import FootResponse, n_products
from footsense.frames import Reading
from footsense.sim.robot import SimulatedRobot, Wiring
from footsense.sim.scene_files import load_scene
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


def response(rows: int) -> FootResponse:
    """Return a made-up table: each cell of a quarter yields by an amount of its own."""
    half, side, rng = 3 * rows, 6 * rows, np.random.default_rng(rows)
    own = np.zeros((half, half, side, side))
    row, column = np.indices((half, half))
    own[row, column, row, column] = 10.0
    return FootResponse(
        foot_type=f"test-{rows}",
        design=DESIGN,
        ball_radius_mm=10.0,
        hertz_modulus_mpa=6.8,
        min_elevation_deg=25.0,
        fit_elevation_deg=12.0,
        degree=2,
        quarter_series=rng.uniform(1.0, 3.0, (2, n_products(2), half, half, 3)),
        quarter_compliance=own,
        provenance={},
    )


@pytest.mark.parametrize("board", ["fdc1004", "ad7746"])
@pytest.mark.parametrize("rows", [2, 3, 4])
def test_every_element_of_an_array_is_read_at_its_place(rows: int, board: str) -> None:
    """Six standing legs over one simulated bus: all readings are OK, each of its own element."""
    wiring = Wiring(400_000, 0x71, LEGS, kernel_mux=False, board=board)
    robot = SimulatedRobot(load_scene("hanging"), response(rows), [wiring])
    made_pf = np.linspace(4.2, 8.5, rows**2)
    for leg in robot.legs.values():
        leg.wired._whole_pf = lambda _: made_pf.tolist()
    [bus] = robot.buses
    rate_sps = 400 if board == "fdc1004" else 91
    scanner = BusScanner(UpstreamBus(bus, 0x71), bus.clock, LEGS, scan_plan("lo_shu", rate_sps, board, rows))
    scanner.start()
    for _ in range(rows**2):
        readings = scanner.read()
    assert (readings.reading == Reading.OK).all()
    stray_pf = readings.capacitance_pf - made_pf
    assert np.ptp(stray_pf) < 0.05
