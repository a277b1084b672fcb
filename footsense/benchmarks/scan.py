"""Part of `footsense dev benchmark` in virtual time: scans, load of the buses, and age of the forces when sent.

Bus bits, conversions and host costs are exact there: the same figures on every machine. Nobody has measured what a
transaction costs the host, so figures are given for several costs.
"""

import itertools

import numpy as np
from msgspec.structs import replace

from footsense.benchmarks.naive import sequential_scan
from footsense.benchmarks.recorded_walk import started_scanner
from footsense.config import DEFAULT, SMALL_BOARD, Config
from footsense.config.sections import Bus
from footsense.daemon.acquisition import open_scan_source
from footsense.daemon.estimation import pipeline_for
from footsense.daemon.models import load_models
from footsense.daemon.simulation import simulated_robot
from footsense.frames import IS_USABLE_STATE, Flag
from footsense.ports import I2cBus, Transaction
from footsense.sim.clock import VirtualClock
from footsense.sim.scene import Effects, Scene, load_scene

_N_SCANS = 40
_HOST_COSTS_US = (0, 40, 100)
#: Of board `ad7147`: the planning value, and those beside it.
_FREE_HOST_COSTS_US = (40, 100, 150)
_USUAL_CHIPS = Effects()
#: Forces of each leg of which the age is measured, after the tare.
_N_AGE_SAMPLES = 120

#: Robots of board `ad7147`.
FREE_CONFIGURATIONS = {
    "six_legs": DEFAULT,
    "four_legs": replace(
        DEFAULT, buses=(Bus(device="sim0", addresses={"lf": 0x2C, "lr": 0x2D, "rf": 0x2E, "rr": 0x2F}),)
    ),
}
#: Six legs with board `fdc1004`, by number of buses.
CONFIGURATIONS = {
    "one_bus": SMALL_BOARD,
    "two_buses": replace(
        SMALL_BOARD,
        buses=(
            Bus(device="sim0", legs={"lf": 0, "lm": 1, "lr": 2}),
            Bus(device="sim1", legs={"rf": 0, "rm": 1, "rr": 2}),
        ),
    ),
}


class _CountingBus:
    """Adapter that counts the transactions of another one, and the time that they take."""

    def __init__(self, bus: I2cBus, clock: VirtualClock) -> None:
        self._bus, self._clock = bus, clock
        self.n = self.busy_ns = 0

    def transfer(self, transaction: Transaction) -> bytes:
        """Do one transaction, and return the bytes read.

        Raises:
            I2cError: It failed.
        """
        start_ns = self._clock.now_ns()
        try:
            return self._bus.transfer(transaction)
        finally:
            self.n += 1
            self.busy_ns += self._clock.now_ns() - start_ns


def measure_free_scans() -> dict[str, dict[str, float]]:
    """Return what scans of board `ad7147` take of the buses, by robot and host cost."""
    return {
        f"{name}_{host_cost_us}us": measure_free_scan(config, host_cost_us)
        for (name, config), host_cost_us in itertools.product(
            FREE_CONFIGURATIONS.items(), _FREE_HOST_COSTS_US
        )
    }


def measure_free_scan(config: Config, host_cost_us: int) -> dict[str, float]:
    """Return what scans of converters that run freely take of the buses.

    Args:
        config: The robot.
        host_cost_us: Time that the host adds to each transaction [us].

    Returns:
        `frames_hz`, each with two reads of each leg, or with one where a bus does not carry two; of the bus with more
        of them, `transactions_hz`, and `bus_load_rel`, the share of the time in which it is taken, the host's included;
        `age_p50_ms` and `age_p99_ms` of a leg's newest reading when its force is sent.
    """
    robot = simulated_robot(config, replace(load_scene("tripod"), host_cost_us=float(host_cost_us)))
    buses = [_CountingBus(bus, bus.clock) for bus in robot.buses]
    scanner, clock = started_scanner(config, buses, [bus.clock for bus in robot.buses])
    pipeline = pipeline_for(load_models(config), Flag.SIMULATED)
    scanner.read()
    start_ns, before = clock.now_ns(), [(bus.n, bus.busy_ns) for bus in buses]
    ages_ns: list[int] = []
    n_frames = 0
    while len(ages_ns) < _N_AGE_SAMPLES * len(config.legs):
        forces, _ = pipeline.process(scanner.read(), clock.now_ns())
        ages_ns += forces.age_ns[IS_USABLE_STATE[forces.state]].tolist()
        n_frames += 1
    elapsed_s = 1e-9 * (clock.now_ns() - start_ns)
    taken = [(bus.n - n, bus.busy_ns - busy_ns) for bus, (n, busy_ns) in zip(buses, before, strict=True)]
    n, busy_ns = max(taken)
    return {
        "frames_hz": n_frames / elapsed_s,
        "transactions_hz": n / elapsed_s,
        "bus_load_rel": 1e-9 * busy_ns / elapsed_s,
        "age_p50_ms": float(np.median(ages_ns)) * 1e-6,
        "age_p99_ms": float(np.quantile(ages_ns, 0.99)) * 1e-6,
    }


def min_scan_period_by_conversions_ms() -> float:
    """Return the lower bound of the scan period of board `fdc1004` by conversion time [ms]: nine conversions."""
    return SMALL_BOARD.shortest_scan_ms


def measure_all_scan_periods() -> dict[str, dict[str, float]]:
    """Return scan periods of board `fdc1004` and their ratios to the bounds, by buses and host cost."""
    return {
        f"{name}_{host_cost_us}us": _measure_scan_periods(config, host_cost_us)
        for (name, config), host_cost_us in itertools.product(CONFIGURATIONS.items(), _HOST_COSTS_US)
    }


def measure_converter_kinds() -> dict[str, dict[str, float]]:
    """Return the scan periods with each kind of FDC1004 [ms], by bus configuration and host cost.

    A chip may clear its DONE bit when the upper register of a result is read, or both, or by the next trigger as well.
    """
    kinds = {
        "upper_read_ms": Effects(),
        "upper_read_asked_first_ms": Effects(trigger_clears_done=True),
        "both_read_ms": Effects(done_needs_both_reads=True),
        "both_read_asked_first_ms": Effects(done_needs_both_reads=True, trigger_clears_done=True),
    }
    return {
        f"{name}_{host_cost_us}us": {
            kind: scan_period_ms(config, host_cost_us, effects) for kind, effects in kinds.items()
        }
        for (name, config), host_cost_us in itertools.product(CONFIGURATIONS.items(), _HOST_COSTS_US)
    }


def _hanging(host_cost_us: int, effects: Effects) -> Scene:
    return replace(load_scene("hanging"), host_cost_us=float(host_cost_us), effects=effects)


def scan_period_ms(config: Config, host_cost_us: int, effects: Effects = _USUAL_CHIPS) -> float:
    """Return the mean scan period of the daemon [ms].

    Args:
        config: The robot.
        host_cost_us: Time that the host adds to each transaction [us].
        effects: What the simulated chips are.
    """
    with open_scan_source(config, _hanging(host_cost_us, effects)) as scan_source:
        scan_source.read_whole_scans(1)
        start_ns = scan_source.clock.now_ns()
        scan_source.read_whole_scans(_N_SCANS)
        return 1e-6 * (scan_source.clock.now_ns() - start_ns) / _N_SCANS


def _measure_scan_periods(config: Config, host_cost_us: int) -> dict[str, float]:
    """Return the scan periods of six legs at 400 kHz, of the daemon and of a naive loop, and their ratios."""
    period_ms = scan_period_ms(config, host_cost_us)
    # Two buses are scanned side by side also by a naive program with two threads.
    naive_ms = 1e-6 * _naive_scan_period_ns(config, _hanging(host_cost_us, _USUAL_CHIPS))
    return {
        "period_ms": period_ms,
        "rate_hz": 1e3 / period_ms,
        "over_limit": period_ms / config.shortest_scan_ms,
        "over_best": 1e6
        * period_ms
        / max(_scan_period_lower_bound_ns(config, bus, host_cost_us) for bus in config.buses),
        "naive_period_ms": naive_ms,
        "naive_over_ours": naive_ms / period_ms,
    }


def _naive_scan_period_ns(config: Config, scene: Scene) -> int:
    """Return the scan period of the naive loop [ns]."""
    bus = simulated_robot(config, scene).buses[0]
    sequential_scan(bus, bus.clock, config)
    return bus.clock.now_ns()


def _scan_period_lower_bound_ns(config: Config, bus: Bus, host_cost_us: int) -> int:
    """Return the lower bound of the scan period on a bus for any program [ns]."""
    plan = config.scan_plan.on_bus(bus.mux_address)
    bounds = plan.lower_bounds(len(bus.channels), bus.rate_hz, host_cost_us * 1e3)
    return bounds.scan_period_bound_ns


def newest_reading_age_ms(config: Config = SMALL_BOARD) -> dict[str, float]:
    """Return the age of the newest reading at sending [ms], p50 and p99, at 40 us per transaction."""
    scene = replace(load_scene("tripod"), host_cost_us=40.0)
    ages_ns: list[int] = []
    with open_scan_source(config, scene) as scan_source:
        pipeline = pipeline_for(load_models(config), Flag.SIMULATED)
        while len(ages_ns) < _N_AGE_SAMPLES * len(config.legs):
            forces, _ = pipeline.process(scan_source.source.read(), scan_source.clock.now_ns())
            ages_ns += forces.age_ns[IS_USABLE_STATE[forces.state]].tolist()
    return {"p50": float(np.median(ages_ns)) * 1e-6, "p99": float(np.quantile(ages_ns, 0.99)) * 1e-6}
