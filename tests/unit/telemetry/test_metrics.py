import errno
import fcntl
import math
import subprocess
import sys
from bisect import bisect_left
from collections.abc import Iterator
from enum import IntEnum
from pathlib import Path

import numpy as np
import pytest
from prometheus_client import CollectorRegistry

from footsense.errors import FootsenseError
from footsense.frames import (
    BaselineDrift,
    BaselineStatus,
    CanStatistics,
    CapFrame,
    Cause,
    Command,
    CommandKind,
    CommandResult,
    ContactFrame,
    Cycle,
    Flag,
    GaitEvent,
    GaitEventKind,
    Result,
    Slip,
    State,
)
from footsense.leg_words import LegPhase
from footsense.ports import WakeupLatency
from footsense.telemetry.exporter import CountersCollector
from footsense.telemetry.metric_families import STATE_SETS
from footsense.telemetry.metrics import MetricsObserver
from footsense.telemetry.shared_counters import MetricFamily, SharedCountersWriter, read_counters
from tests.support.gaits import gait_frame

MS = 1_000_000
LEGS = ("lf", "rr")


def cycle(
    t_ms: float, states: tuple[State, State], age_ms: float = 12, outcomes: tuple[CommandResult, ...] = ()
) -> Cycle:
    """Return a turn of the loop with two legs; a leg in the state ABSENT was not measured."""
    t_ns = round(t_ms * MS)
    state = np.array(states, np.uint8)
    force_n = np.full((2, 3), math.nan)
    return Cycle(
        scan=CapFrame(0, np.zeros((2, 9), np.int64), np.full((2, 9), math.nan), np.zeros((2, 9), np.uint8)),
        started_commands=(),
        forces=ContactFrame(
            sequence=0,
            t_sent_ns=t_ns,
            t_ns=np.where(state == State.ABSENT, 0, t_ns - round(age_ms * MS)),
            force_n=force_n,
            sigma_n=force_n,
            state=state,
            fault_mask=np.zeros(2, np.uint16),
            flags=np.zeros(2, np.uint8),
            cause=np.zeros(2, np.uint8),
            baseline=BaselineDrift.none(2),
        ),
        ended_commands=outcomes,
    )


@pytest.fixture
def metrics(tmp_path: Path) -> Iterator[MetricsObserver]:
    """MetricsObserver of two legs with a file of their own."""
    metrics = MetricsObserver(LEGS, CanStatistics(), tmp_path / "counters")
    yield metrics
    metrics.close()


@pytest.fixture
def scraped(tmp_path: Path) -> CollectorRegistry:
    """The metrics as the exporter reads them, at each call anew."""
    registry = CollectorRegistry()
    registry.register(CountersCollector(tmp_path / "counters"))
    return registry


def codes_set(scraped: CollectorRegistry, name: str, leg: str, codes: type[IntEnum]) -> list[IntEnum]:
    """Return the codes of a leg whose series is 1, of a state set in which all others are 0."""
    label = STATE_SETS[name][0]
    values = {code: scraped.get_sample_value(name, {"leg": leg, label: code.name.lower()}) for code in codes}
    assert set(values.values()) == {0, 1}
    return [code for code, value in values.items() if value]


def test_cycle_period_and_age_are_histograms_in_seconds(
    metrics: MetricsObserver, scraped: CollectorRegistry
) -> None:
    """The first cycle has no period; a leg that was not measured has no age; a bound belongs to its bucket."""
    both, one = (State.VALID, State.VALID), (State.VALID, State.ABSENT)
    for t_ms, states, age_ms in ((1000, both, 12), (1011, one, 13), (1500, one, 900)):
        metrics.observe(cycle(t_ms, states, age_ms))
    get = scraped.get_sample_value
    assert get("footsense_cycles_total") == 3
    assert get("footsense_cycle_period_seconds_bucket", {"le": "0.011"}) == 1
    assert get("footsense_cycle_period_seconds_bucket", {"le": "0.0105"}) == 0
    assert get("footsense_cycle_period_seconds_count") == 2
    assert get("footsense_cycle_period_seconds_sum") == pytest.approx(0.5)
    assert get("footsense_frame_age_seconds_count", {"leg": "lf"}) == 3
    assert get("footsense_frame_age_seconds_bucket", {"leg": "lf", "le": "0.012"}) == 1
    assert get("footsense_frame_age_seconds_bucket", {"leg": "lf", "le": "0.5"}) == 2
    assert get("footsense_frame_age_seconds_sum", {"leg": "lf"}) == pytest.approx(0.925)
    assert get("footsense_frame_age_seconds_count", {"leg": "rr"}) == 1


def test_a_fault_counts_once_per_fall_and_the_state_is_shown(
    metrics: MetricsObserver, scraped: CollectorRegistry
) -> None:
    """A wire that breaks twice is two faults, each of several cycles; a tare is none; the other leg has none."""
    for state in (
        State.TARING,
        State.VALID,
        State.ELEMENT_FAULT,
        State.ELEMENT_FAULT,
        State.VALID,
        State.ELEMENT_FAULT,
    ):
        metrics.observe(cycle(0, (State.VALID, state)))
    get = scraped.get_sample_value
    assert get("footsense_faults_total", {"leg": "rr", "kind": "element_fault"}) == 2
    assert get("footsense_leg_cycles_total", {"leg": "rr", "state": "element_fault"}) == 3
    assert get("footsense_leg_cycles_total", {"leg": "lf", "state": "valid"}) == 6
    assert get("footsense_faults_total", {"leg": "lf", "kind": "element_fault"}) == 0
    assert get("footsense_faults_total", {"leg": "rr", "kind": "taring"}) is None
    assert codes_set(scraped, "footsense_leg_state", "rr", State) == [State.ELEMENT_FAULT]
    assert codes_set(scraped, "footsense_leg_state", "lf", State) == [State.VALID]


def test_can_recorder_and_tares_are_counted(tmp_path: Path, scraped: CollectorRegistry) -> None:
    """What the CAN channel, the recorder and the tares report is shown as it is."""
    can = CanStatistics(
        sent=120,
        dropped=3,
        received_commands=4,
        rejected_commands=1,
        bus_errors=9,
        bus_off=2,
        error_passive=5,
        reopened=6,
        unlogged=8,
    )
    metrics = MetricsObserver(
        LEGS, can, tmp_path / "counters", n_lost_cycles=lambda: 7, n_lost_log_lines=lambda: 5
    )
    refused = CommandResult(Command(CommandKind.TARE, 1), Result.NOT_QUIET, "")
    stopped = CommandResult(Command(CommandKind.STOP, 1), Result.DONE, "")
    metrics.observe(cycle(0, (State.VALID, State.VALID), outcomes=(refused, stopped)))
    get = scraped.get_sample_value
    assert [
        get(f"footsense_can_{name}_total")
        for name in (
            *("sent_frames", "dropped_frames", "received_frames", "rejected_frames", "bus_errors"),
            *("bus_off", "error_passive", "reopened", "unlogged_frames"),
        )
    ] == [120, 3, 4, 1, 9, 2, 5, 6, 8]
    assert get("footsense_recorder_lost_cycles_total") == 7
    assert get("footsense_log_lost_lines_total") == 5
    assert get("footsense_tares_total", {"leg": "rr", "result": "not_quiet"}) == 1
    assert get("footsense_tares_total", {"leg": "rr", "result": "done"}) == 0
    metrics.close()


def test_what_the_clocks_count_is_one_histogram_of_all_threads(
    tmp_path: Path, scraped: CollectorRegistry
) -> None:
    """Two buses add up; what happens between two copies is shown by the next, a tenth of a second later."""
    wakeups = (WakeupLatency(), WakeupLatency())
    metrics = MetricsObserver(
        LEGS, CanStatistics(), tmp_path / "counters", wakeups=wakeups, n_late_discards=lambda: 3
    )
    both = (State.VALID, State.VALID)
    metrics.observe(cycle(1000, both))
    for thread, late_s in zip(wakeups, (8e-5, 9e-5), strict=True):
        thread.histogram[bisect_left(thread.bounds_s, late_s)] += 1
        thread.histogram[-1] += late_s
        thread.overruns += 2
    metrics.observe(cycle(1099, both))
    get = scraped.get_sample_value
    assert get("footsense_wakeup_latency_seconds_count") == 0
    metrics.observe(cycle(1100, both))
    assert get("footsense_wakeup_latency_seconds_bucket", {"le": "0.0001"}) == 2
    assert get("footsense_wakeup_latency_seconds_bucket", {"le": "7e-05"}) == 0
    assert get("footsense_wakeup_latency_seconds_sum") == pytest.approx(1.7e-4)
    assert get("footsense_overruns_total") == 4
    assert get("footsense_missed_deadlines_total") == 3
    metrics.close()


def test_in_virtual_time_nobody_is_late(metrics: MetricsObserver, scraped: CollectorRegistry) -> None:
    """What is not measured is not shown, rather than as zero."""
    metrics.observe(cycle(1000, (State.VALID, State.VALID)))
    get = scraped.get_sample_value
    assert get("footsense_wakeup_latency_seconds_count") is None
    assert get("footsense_overruns_total") is None


def test_a_leg_is_shown_with_phase_cause_contact_and_baseline(
    metrics: MetricsObserver, scraped: CollectorRegistry
) -> None:
    """Each changes by itself; a baseline that does not exist is NaN, not 0."""
    plain = cycle(2000, (State.VALID, State.ELEMENT_FAULT))
    baseline = BaselineDrift(
        np.array([BaselineStatus.HELD, BaselineStatus.NONE], np.uint8),
        np.array([0.002, np.nan]),
        np.array([-0.003, np.nan]),
        np.array([500 * MS, 0]),
    )
    told = plain.forces._replace(
        cause=np.array([Cause.NONE, Cause.ELEMENT_SHORTED], np.uint8),
        flags=np.array([Flag.CONTACT | Flag.DEGRADED_TIMING, 0], np.uint8),
        baseline=baseline,
    )
    metrics.observe(plain._replace(forces=told))
    get = scraped.get_sample_value
    lf, rr = {"leg": "lf"}, {"leg": "rr"}
    assert codes_set(scraped, "footsense_leg_phase", "lf", LegPhase) == [LegPhase.VALID]
    assert codes_set(scraped, "footsense_leg_phase", "rr", LegPhase) == [LegPhase.FAULTED]
    assert codes_set(scraped, "footsense_leg_cause", "rr", Cause) == [Cause.ELEMENT_SHORTED]
    assert (get("footsense_leg_contact", lf), get("footsense_leg_contact", rr)) == (1, 0)
    assert get("footsense_degraded_timing") == 1
    assert codes_set(scraped, "footsense_baseline_status", "lf", BaselineStatus) == [BaselineStatus.HELD]
    assert get("footsense_baseline_mean_offset_farads", lf) == pytest.approx(2e-15)
    assert get("footsense_baseline_worst_offset_farads", lf) == pytest.approx(-3e-15)
    assert get("footsense_baseline_age_seconds", lf) == pytest.approx(1.5)
    assert math.isnan(get("footsense_baseline_age_seconds", rr) or 0)
    off = told._replace(flags=np.zeros(2, np.uint8), cause=np.zeros(2, np.uint8))
    metrics.observe(plain._replace(forces=off))
    assert get("footsense_leg_contact", lf) == 0
    assert codes_set(scraped, "footsense_leg_cause", "rr", Cause) == [Cause.NONE]
    assert get("footsense_degraded_timing") == 0


def test_the_gait_is_shown_and_its_events_are_counted(
    metrics: MetricsObserver, scraped: CollectorRegistry
) -> None:
    """Each leg's by itself; between two gaits nothing changes."""
    events = (
        GaitEvent(GaitEventKind.LIFT_OFF, 1, 0, 0.01),
        GaitEvent(GaitEventKind.SLIP_END, 0, 0, 0.01),
        GaitEvent(GaitEventKind.SLIP_END, 0, 0, 0.01),
    )
    plain = cycle(2000, (State.VALID, State.VALID))
    gait = gait_frame(2000 * MS, 2, slip=np.array([Slip.SLIPPING, Slip.UNKNOWN], np.uint8), events=events)
    metrics.observe(plain._replace(forces=plain.forces._replace(gait=gait)))
    metrics.observe(plain)
    get = scraped.get_sample_value
    lf, rr = {"leg": "lf"}, {"leg": "rr"}
    assert get("footsense_leg_contact_probability", lf) == 0.995
    assert get("footsense_leg_load_share", rr) == 0.5
    assert get("footsense_leg_tangential_over_normal", rr) == 0.2
    assert get("footsense_ground_normal", {**rr, "axis": "z"}) == 0.96
    assert get("footsense_ground_normal_sigma_radians", lf) == 0.05
    assert get("footsense_ground_friction_coefficient") == 0.6
    assert get("footsense_all_in_air") == 0
    assert codes_set(scraped, "footsense_leg_slip", "lf", Slip) == [Slip.SLIPPING]
    counts = {
        (leg, kind): get("footsense_gait_events_total", {"leg": leg, "kind": kind.name.lower()})
        for leg in LEGS
        for kind in GaitEventKind
    }
    told = {key: n for key, n in counts.items() if n}
    assert told == {("lf", GaitEventKind.SLIP_END): 2, ("rr", GaitEventKind.LIFT_OFF): 1}


def test_the_file_describes_itself_and_is_gone_at_the_end(tmp_path: Path) -> None:
    """A reader needs nothing but the file; closing twice is once."""
    families = [
        MetricFamily("a_total", "counter", "A.", {"leg": ["lf", "rr"]}),
        MetricFamily("b", "histogram", "B.", {}, [1.0]),
    ]
    counters = SharedCountersWriter(families, tmp_path / "counters")
    counters.cells[counters.first_cell["b"] + 2] = 2.5
    read, cells = read_counters(tmp_path / "counters")
    assert read == families
    assert cells == [0, 0, 0, 0, 2.5]
    counters.close()
    counters.close()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("content", [b"short", b"FSCOUNT1" + b"\xff" * 40, b"x" * 64])
def test_another_file_is_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    """Neither an empty nor a foreign file is taken for counters."""
    path = tmp_path / "file"
    path.write_bytes(content)
    with path.open("rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        with pytest.raises(FootsenseError, match=r"file does not hold footsense's counters"):
            read_counters(path)


def test_a_missing_file_is_one_line(tmp_path: Path) -> None:
    """The reason is the system's."""
    with pytest.raises(FootsenseError, match="No such file"):
        read_counters(tmp_path / "missing")


def test_a_file_that_cannot_be_created_is_one_line(tmp_path: Path) -> None:
    """The service goes on without metrics then."""
    with pytest.raises(FootsenseError, match=r"none/counters: cannot be written: No such file"):
        SharedCountersWriter([], tmp_path / "none" / "counters")


def test_a_file_that_cannot_be_replaced_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As with a file of another user in /dev/shm, whose sticky bit forbids to replace it."""

    def forbidden(path: Path, target: Path) -> None:
        raise PermissionError(errno.EPERM, "Operation not permitted", str(path), None, str(target))

    monkeypatch.setattr(Path, "rename", forbidden)
    with pytest.raises(FootsenseError, match=r"counters: cannot be written: Operation not permitted"):
        SharedCountersWriter([MetricFamily("a_total", "counter", "A.")], tmp_path / "counters")
    assert list(tmp_path.iterdir()) == []


def test_two_services_do_not_count_into_one_file(metrics: MetricsObserver, tmp_path: Path) -> None:
    """The second one is refused in one line, and the first one's counters stay."""
    metrics.observe(cycle(0, (State.VALID, State.VALID)))
    with pytest.raises(FootsenseError, match="another running service writes this file"):
        MetricsObserver(LEGS, CanStatistics(), tmp_path / "counters")
    families, cells = read_counters(tmp_path / "counters")
    assert (
        cells[sum(family.n_cells for family in families[: _place(families, "footsense_cycles_total")])] == 1
    )


def _place(families: list[MetricFamily], name: str) -> int:
    return [family.name for family in families].index(name)


def test_a_service_that_starts_ends_and_starts_again_is_shown_as_such(
    tmp_path: Path, scraped: CollectorRegistry
) -> None:
    """`footsense_up` follows it; a new service begins at 0, and one that has ended shows nothing else."""
    get = scraped.get_sample_value
    assert (get("footsense_up"), get("footsense_cycles_total")) == (0, None)
    for _ in range(2):
        metrics = MetricsObserver(LEGS, CanStatistics(), tmp_path / "counters")
        assert (get("footsense_up"), get("footsense_cycles_total")) == (1, 0)
        metrics.observe(cycle(0, (State.VALID, State.VALID)))
        assert get("footsense_cycles_total") == 1
        metrics.close()
        assert (get("footsense_up"), get("footsense_cycles_total")) == (0, None)


def test_a_killed_service_is_not_shown_as_running(tmp_path: Path, scraped: CollectorRegistry) -> None:
    """SIGKILL leaves its file behind, without its lock; the next service replaces the file."""
    service = (
        "import os, signal, sys; from pathlib import Path\n"
        "from footsense.frames import CanStatistics\n"
        "from footsense.telemetry.metrics import MetricsObserver\n"
        "metrics = MetricsObserver(('lf', 'rr'), CanStatistics(), Path(sys.argv[1]))\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    path = tmp_path / "counters"
    killed = subprocess.run([sys.executable, "-c", service, str(path)], check=False)
    assert (killed.returncode, path.exists()) == (-9, True)
    assert scraped.get_sample_value("footsense_up") == 0
    metrics = MetricsObserver(LEGS, CanStatistics(), path)
    assert scraped.get_sample_value("footsense_up") == 1
    metrics.close()
    assert list(tmp_path.iterdir()) == []
