"""Limits of a scan on a bus."""

from footsense.acquisition.scan_plan import AD7147_PLAN, bus_overload


def test_eight_legs_behind_a_mux_are_too_many_for_a_host_that_costs_100_us() -> None:
    limits = {
        mux: AD7147_PLAN.on_bus(mux).lower_bounds(8, bus_hz=400e3, host_cost_ns=100e3) for mux in (None, 0x70)
    }
    assert bus_overload(AD7147_PLAN, limits[None]) is None
    text = bus_overload(AD7147_PLAN, limits[0x70])
    assert text == "carries 1078 of 1302 conversions/s of each converter; share its legs between more buses"
