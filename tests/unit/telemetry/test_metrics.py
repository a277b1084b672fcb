"""What Prometheus sees of the services that one exporter follows."""

import json
import math
from contextlib import closing
from enum import IntEnum
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from prometheus_client import CollectorRegistry

from footsense.frames import (
    BaselineDrift,
    BaselineStatus,
    CanStatistics,
    Cause,
    Command,
    CommandKind,
    CommandResult,
    Cycle,
    Flag,
    GaitEvent,
    GaitEventKind,
    Result,
    Slip,
    State,
)
from footsense.leg_words import LegPhase
from footsense.ports import WAKEUP_LATENCY_BUCKET_BOUNDS_S
from footsense.ring.cycle_ring import CycleRing
from footsense.ring.records import ServiceStatus
from footsense.telemetry.exporter import ServiceCollector
from footsense.telemetry.metrics import ServiceMetrics
from tests.support.cycles import plain_cycle
from tests.support.frames import gait_frame

MS = 1_000_000
LEGS = ("lf", "rr")
LF, RR = ({"leg": leg} for leg in LEGS)
BOTH = (State.VALID, State.VALID)
STATUS = ServiceStatus(CanStatistics(11, 120, 3, 4, 1, 8, 10, 9, 2, 5, 6), np.zeros(18).tobytes())


def cycle(t_ms: float, states: tuple[State, State] = BOTH, age_ms: float = 12, **forces: Any) -> Cycle:
    """Return a cycle of two legs; a leg in the state ABSENT was not measured."""
    read_ns = round((t_ms - age_ms) * MS)
    t_ns = np.array([0 if state is State.ABSENT else read_ns for state in states])
    return plain_cycle(round(t_ms * MS), states, **{"t_ns": t_ns, **forces})


class Scraped:
    """Metrics of two legs as Prometheus scrapes them."""

    def __init__(self) -> None:
        self.metrics = ServiceMetrics(LEGS)
        self._registry = CollectorRegistry()
        self._registry.register(self.metrics)

    def get(self, name: str, labels: dict[str, str] | None = None) -> float | None:
        return self._registry.get_sample_value(f"footsense_{name}", labels)

    def code(self, name: str, leg: str, codes: type[IntEnum]) -> IntEnum:
        """Return the code of a leg whose series is 1, of a state set in which all others are 0."""
        label = name.rpartition("_")[2]
        values = {code: self.get(name, {"leg": leg, label: code.name.lower()}) for code in codes}
        assert sorted(values.values(), key=float) == [0] * (len(codes) - 1) + [1]  # type: ignore[arg-type]
        return next(code for code, value in values.items() if value)


@pytest.fixture
def scraped() -> Scraped:
    return Scraped()


def test_cycle_period_and_age_are_histograms_in_seconds(scraped: Scraped) -> None:
    """The first cycle has no period; a leg that was not measured has no age; a bound belongs to its bucket."""
    one = (State.VALID, State.ABSENT)
    for t_ms, states, age_ms in ((1000, BOTH, 12), (1011, one, 13), (1500, one, 900)):
        scraped.metrics.add(cycle(t_ms, states, age_ms))
    get = scraped.get
    assert get("cycles_total") == 3
    assert get("cycle_period_seconds_bucket", {"le": "0.011"}) == 1
    assert get("cycle_period_seconds_bucket", {"le": "0.0105"}) == 0
    assert get("cycle_period_seconds_count") == 2
    assert get("cycle_period_seconds_sum") == pytest.approx(0.5)
    assert get("frame_age_seconds_count", LF) == 3
    assert get("frame_age_seconds_bucket", {"leg": "lf", "le": "0.012"}) == 1
    assert get("frame_age_seconds_bucket", {"leg": "lf", "le": "0.5"}) == 2
    assert get("frame_age_seconds_sum", LF) == pytest.approx(0.925)
    assert get("frame_age_seconds_count", {"leg": "rr"}) == 1


def test_a_fault_counts_once_per_fall_and_the_state_is_shown(scraped: Scraped) -> None:
    """A wire that breaks twice is two faults, each of several cycles; a tare is none; the other leg has none."""
    fault = State.ELEMENT_FAULT
    for state in (State.TARING, State.VALID, fault, fault, State.VALID, fault):
        scraped.metrics.add(cycle(0, (State.VALID, state)))
    get = scraped.get
    assert get("faults_total", {"leg": "rr", "kind": "element_fault"}) == 2
    assert get("leg_cycles_total", {"leg": "rr", "state": "element_fault"}) == 3
    assert get("leg_cycles_total", {"leg": "lf", "state": "valid"}) == 6
    assert get("faults_total", {"leg": "lf", "kind": "element_fault"}) == 0
    assert get("faults_total", {"leg": "rr", "kind": "taring"}) is None
    assert scraped.code("leg_state", "rr", State) is State.ELEMENT_FAULT
    assert scraped.code("leg_state", "lf", State) is State.VALID


def test_tares_are_counted(scraped: Scraped) -> None:
    """By their result; another command is none."""
    refused = CommandResult(Command(CommandKind.TARE, 1), Result.NOT_QUIET, "")
    stopped = CommandResult(Command(CommandKind.STOP, 1), Result.DONE, "")
    scraped.metrics.add(cycle(0)._replace(ended_commands=(refused, stopped)))
    assert scraped.get("tares_total", {"leg": "rr", "result": "not_quiet"}) == 1
    assert scraped.get("tares_total", {"leg": "rr", "result": "done"}) == 0


def test_what_the_service_counts_is_shown_as_it_is(scraped: Scraped) -> None:
    """CAN, recorder, log and the clocks of all threads; in virtual time nobody is late."""
    histogram = [0.0] * (len(WAKEUP_LATENCY_BUCKET_BOUNDS_S) + 2)
    histogram[7], histogram[-1] = 2.0, 1.7e-4
    scraped.metrics.status = ServiceStatus(STATUS.can, b"", histogram, 4, 3, 5, 7)
    names = (
        *("published_forces", "can_sent_frames", "can_dropped_frames", "can_received_frames"),
        *("can_rejected_frames", "can_received_motions", "can_rejected_motions"),
        *("can_bus_errors", "can_bus_off", "can_error_passive", "can_reopened"),
        *("recorder_lost_cycles", "log_lost_lines", "overruns", "missed_deadlines"),
    )
    values = [11, 120, 3, 4, 1, 8, 10, 9, 2, 5, 6, 7, 5, 4, 3]
    assert [scraped.get(f"{name}_total") for name in names] == values
    latency = "wakeup_latency_seconds"
    assert scraped.get(f"{latency}_bucket", {"le": "0.00015"}) == 2
    assert scraped.get(f"{latency}_bucket", {"le": "0.0001"}) == 0
    assert scraped.get(f"{latency}_sum") == pytest.approx(1.7e-4)
    scraped.metrics.status = msgspec.structs.replace(scraped.metrics.status, wakeup_histogram=None)
    assert scraped.get(f"{latency}_count") is None
    assert scraped.get("overruns_total") is None


def test_a_leg_is_shown_with_phase_cause_contact_and_baseline(scraped: Scraped) -> None:
    """Each changes by itself; a baseline that does not exist is NaN, not 0."""
    baseline = BaselineDrift(
        np.array([BaselineStatus.HELD, BaselineStatus.NONE], np.uint8),
        np.array([0.002, np.nan]),
        np.array([-0.003, np.nan]),
        np.array([500 * MS, 0]),
    )
    cause = np.array([Cause.NONE, Cause.ELEMENT_SHORTED], np.uint8)
    flags = np.array([Flag.CONTACT | Flag.DEGRADED_TIMING, 0], np.uint8)
    states = (State.VALID, State.ELEMENT_FAULT)
    scraped.metrics.add(cycle(2000, states, cause=cause, flags=flags, baseline=baseline))
    get = scraped.get
    assert scraped.code("leg_phase", "lf", LegPhase) is LegPhase.VALID
    assert scraped.code("leg_phase", "rr", LegPhase) is LegPhase.FAULTED
    assert scraped.code("leg_cause", "rr", Cause) is Cause.ELEMENT_SHORTED
    assert (get("leg_contact", LF), get("leg_contact", RR)) == (1, 0)
    assert get("degraded_timing") == 1
    assert scraped.code("baseline_status", "lf", BaselineStatus) is BaselineStatus.HELD
    assert get("baseline_mean_offset_farads", LF) == pytest.approx(2e-15)
    assert get("baseline_worst_offset_farads", LF) == pytest.approx(-3e-15)
    assert get("baseline_age_seconds", LF) == pytest.approx(1.5)
    assert math.isnan(get("baseline_age_seconds", RR) or 0)
    scraped.metrics.add(cycle(2001, states))
    assert get("leg_contact", LF) == 0
    assert scraped.code("leg_cause", "rr", Cause) is Cause.NONE
    assert get("degraded_timing") == 0


def test_the_gait_is_shown_and_its_events_are_counted(scraped: Scraped) -> None:
    """Each leg's by itself; between two gaits nothing changes."""
    events = (
        GaitEvent(GaitEventKind.LIFT_OFF, 1, 0, 0.01),
        GaitEvent(GaitEventKind.SLIP_END, 0, 0, 0.01),
        GaitEvent(GaitEventKind.SLIP_END, 0, 0, 0.01),
    )
    gait = gait_frame(2000 * MS, 2, slip=np.array([Slip.SLIPPING, Slip.UNKNOWN], np.uint8), events=events)
    scraped.metrics.add(cycle(2000, gait=gait))
    scraped.metrics.add(cycle(2001))
    get = scraped.get
    assert get("leg_load_share", RR) == 0.5
    assert get("leg_tangential_over_normal", RR) == 0.2
    assert get("ground_normal", {**RR, "axis": "z"}) == 0.96
    assert get("ground_normal_sigma_radians", LF) == 0.05
    assert get("ground_friction_coefficient") == 0.6
    assert get("all_in_air") == 0
    assert scraped.code("leg_slip", "lf", Slip) is Slip.SLIPPING
    counts = {
        (leg, kind): get("gait_events_total", {"leg": leg, "kind": kind.name.lower()})
        for leg in LEGS
        for kind in GaitEventKind
    }
    told = {key: n for key, n in counts.items() if n}
    assert told == {("lf", GaitEventKind.SLIP_END): 2, ("rr", GaitEventKind.LIFT_OFF): 1}


def test_services_that_start_end_and_start_again_are_shown_as_such(tmp_path: Path) -> None:
    """`footsense_up` follows them; the exporter's counters go on, and a fault of the next service is another."""
    path, registry = tmp_path / "ring", CollectorRegistry()
    registry.register(ServiceCollector(path))
    get = registry.get_sample_value
    faulty, fault = (State.VALID, State.ELEMENT_FAULT), {"leg": "rr", "kind": "element_fault"}
    assert (get("footsense_up"), get("footsense_cycles_total")) == (0, None)
    for n in range(2):
        with closing(CycleRing(path, LEGS, {}, 400.0, lambda: STATUS)) as ring:
            assert get("footsense_up") == 1
            assert get("footsense_leg_state", {"leg": "lf", "state": "valid"}) is None
            for number in range(5):
                ring.observe(cycle(number * 10, faulty))
            assert get("footsense_cycles_total") == 8 * n + 5
            assert get("footsense_faults_total", fault) == n + 1
            assert get("footsense_cycle_period_seconds_sum") == pytest.approx(0.06 * n + 0.04)
            assert get("footsense_can_sent_frames_total") == 120
            ring.observe(cycle(50, faulty))
            ring.observe(cycle(60, faulty))
            ring.n_cycles += 3
            ring.observe(cycle(70, faulty))
            assert get("footsense_exporter_missed_cycles_total") == 3 * (n + 1)
        assert (get("footsense_up"), get("footsense_cycles_total")) == (0, None)


def test_what_walking_says_of_electrodes_is_shown(tmp_path: Path) -> None:
    """From the states of `footsense selfcal`, whether the service runs or not; a damaged one is left out."""
    state = {"of": {"leg": "lf"}, "turn_deg": 3.0, "turn_sigma_deg": 1.0, "objection": "", "kept": []}
    (tmp_path / "lf.json").write_text(json.dumps(state))
    (tmp_path / "rf.json").write_text(
        json.dumps(state | {"of": {"leg": "rf"}, "turn_deg": None, "objection": "no"})
    )
    (tmp_path / "rr.json").write_text("{")
    registry = CollectorRegistry()
    registry.register(ServiceCollector(tmp_path / "ring", tmp_path))
    get = registry.get_sample_value
    assert get("footsense_electrodes_turned_radians", LF) == pytest.approx(np.radians(3.0))
    assert get("footsense_electrodes_turned_sigma_radians", LF) == pytest.approx(np.radians(1.0))
    assert [get("footsense_calibration_proposed", leg) for leg in (LF, {"leg": "rf"}, RR)] == [1, 0, None]


def test_a_service_that_ran_before_the_exporter_is_counted_from_now_on(tmp_path: Path) -> None:
    """As Prometheus expects of a counter; its states are shown at once."""
    path, registry = tmp_path / "ring", CollectorRegistry()
    with closing(CycleRing(path, LEGS, {}, 400.0, lambda: STATUS)) as ring:
        for number in range(300):
            ring.observe(cycle(number * 10))
        registry.register(ServiceCollector(path))
        assert registry.get_sample_value("footsense_cycles_total") == 100
        assert registry.get_sample_value("footsense_leg_state", {"leg": "lf", "state": "valid"}) == 1
