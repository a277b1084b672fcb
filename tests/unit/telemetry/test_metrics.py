import math
import os
import select
import signal
import subprocess
import sys
import urllib.request
from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from prometheus_client import CollectorRegistry

from firmware_interface.can_codes import Phase
from footsense.clock import Wakeups
from footsense.errors import ConfigError, FootsenseError
from footsense.frames import (
    BaselineDrift,
    CanStats,
    CapFrame,
    Cause,
    Command,
    CommandKind,
    CommandResult,
    ContactFrame,
    Cycle,
    Flag,
    Result,
    State,
    ZeroStatus,
)
from footsense.telemetry.exporter import SharedCollector
from footsense.telemetry.exporter_process import start_exporter
from footsense.telemetry.metrics import Metrics
from footsense.telemetry.shared_counters import Family, SharedCounters, read_counters

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
        commands=(),
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
        outcomes=outcomes,
    )


@pytest.fixture
def metrics(tmp_path: Path) -> Iterator[Metrics]:
    """Metrics of two legs with a file of their own."""
    metrics = Metrics(LEGS, CanStats(), directory=tmp_path)
    yield metrics
    metrics.close()


def shown(metrics: Metrics) -> CollectorRegistry:
    """Return the metrics as the exporter would read them, in a process of its own or not."""
    registry = CollectorRegistry()
    registry.register(SharedCollector(*read_counters(metrics.path)))
    return registry


def test_scan_period_and_age_are_histograms_in_seconds(metrics: Metrics) -> None:
    """The first scan has no period; a leg that was not measured has no age; a bound belongs to its bucket."""
    both, one = (State.VALID, State.VALID), (State.VALID, State.ABSENT)
    for t_ms, states, age_ms in ((1000, both, 12), (1022.5, one, 13), (1500, one, 900)):
        metrics.observe(cycle(t_ms, states, age_ms))
    get = shown(metrics).get_sample_value
    assert get("footsense_scans_total") == 3
    assert get("footsense_scan_period_seconds_bucket", {"le": "0.0225"}) == 1
    assert get("footsense_scan_period_seconds_bucket", {"le": "0.02"}) == 0
    assert get("footsense_scan_period_seconds_count") == 2
    assert get("footsense_scan_period_seconds_sum") == pytest.approx(0.5)
    assert get("footsense_frame_age_seconds_count", {"leg": "lf"}) == 3
    assert get("footsense_frame_age_seconds_bucket", {"leg": "lf", "le": "0.012"}) == 1
    assert get("footsense_frame_age_seconds_bucket", {"leg": "lf", "le": "0.5"}) == 2
    assert get("footsense_frame_age_seconds_sum", {"leg": "lf"}) == pytest.approx(0.925)
    assert get("footsense_frame_age_seconds_count", {"leg": "rr"}) == 1


def test_a_fault_counts_once_per_fall_and_the_state_is_shown(metrics: Metrics) -> None:
    """A wire that breaks twice is two faults, each of several scans; a tare is none; the other leg has none."""
    for state in (
        State.TARING,
        State.VALID,
        State.ELEMENT_FAULT,
        State.ELEMENT_FAULT,
        State.VALID,
        State.ELEMENT_FAULT,
    ):
        metrics.observe(cycle(0, (State.VALID, state)))
    get = shown(metrics).get_sample_value
    assert get("footsense_faults_total", {"leg": "rr", "kind": "element_fault"}) == 2
    assert get("footsense_leg_scans_total", {"leg": "rr", "state": "element_fault"}) == 3
    assert get("footsense_leg_scans_total", {"leg": "lf", "state": "valid"}) == 6
    assert get("footsense_faults_total", {"leg": "lf", "kind": "element_fault"}) == 0
    assert get("footsense_faults_total", {"leg": "rr", "kind": "taring"}) is None
    assert get("footsense_leg_state", {"leg": "rr"}) == State.ELEMENT_FAULT
    assert get("footsense_leg_state", {"leg": "lf"}) == State.VALID


def test_can_recorder_and_tares_are_counted(tmp_path: Path) -> None:
    """What the CAN channel, the recorder and the tares report is shown as it is."""
    can = CanStats(
        sent=120,
        dropped=3,
        received=4,
        rejected=1,
        bus_errors=9,
        bus_off=2,
        error_passive=5,
        reopened=6,
        unlogged=8,
    )
    metrics = Metrics(LEGS, can, recorder_lost=lambda: 7, log_lost=lambda: 5, directory=tmp_path)
    refused = CommandResult(Command(CommandKind.TARE, 1), Result.NOT_QUIET, "")
    stopped = CommandResult(Command(CommandKind.STOP, 1), Result.DONE, "")
    metrics.observe(cycle(0, (State.VALID, State.VALID), outcomes=(refused, stopped)))
    get = shown(metrics).get_sample_value
    assert [
        get(f"footsense_can_{name}_total")
        for name in (
            *("sent_frames", "dropped_frames", "received_frames", "rejected_frames", "bus_errors"),
            *("bus_off", "error_passive", "reopened", "unlogged_frames"),
        )
    ] == [120, 3, 4, 1, 9, 2, 5, 6, 8]
    assert get("footsense_recorder_lost_frames_total") == 7
    assert get("footsense_log_lost_lines_total") == 5
    assert get("footsense_tares_total", {"leg": "rr", "result": "not_quiet"}) == 1
    assert get("footsense_tares_total", {"leg": "rr", "result": "done"}) == 0
    metrics.close()


def test_what_the_clocks_count_is_one_histogram_of_all_threads(tmp_path: Path) -> None:
    """Two buses add up; what happens between two copies is shown by the next, a tenth of a second later."""
    wakeups = (Wakeups(), Wakeups())
    metrics = Metrics(LEGS, CanStats(), wakeups=wakeups, late_ticks=lambda: 3, directory=tmp_path)
    both = (State.VALID, State.VALID)
    metrics.observe(cycle(1000, both))
    for thread, late_s in zip(wakeups, (8e-5, 9e-5), strict=True):
        thread.lateness[bisect_left(thread.bounds_s, late_s)] += 1
        thread.lateness[-1] += late_s
        thread.overruns += 2
    metrics.observe(cycle(1099, both))
    get = shown(metrics).get_sample_value
    assert get("footsense_wakeup_lateness_seconds_count") == 0
    metrics.observe(cycle(1100, both))
    assert get("footsense_wakeup_lateness_seconds_bucket", {"le": "0.0001"}) == 2
    assert get("footsense_wakeup_lateness_seconds_bucket", {"le": "7e-05"}) == 0
    assert get("footsense_wakeup_lateness_seconds_sum") == pytest.approx(1.7e-4)
    assert get("footsense_overruns_total") == 4
    assert get("footsense_late_ticks_total") == 3
    metrics.close()


def test_in_virtual_time_nobody_is_late(metrics: Metrics) -> None:
    """What is not measured is not shown, rather than as zero."""
    metrics.observe(cycle(1000, (State.VALID, State.VALID)))
    get = shown(metrics).get_sample_value
    assert get("footsense_wakeup_lateness_seconds_count") is None
    assert get("footsense_overruns_total") is None


def test_a_leg_is_shown_with_phase_cause_contact_and_zero(metrics: Metrics) -> None:
    """Each changes by itself; a zero that does not exist is NaN, not 0."""
    plain = cycle(2000, (State.VALID, State.ELEMENT_FAULT))
    zero = BaselineDrift(
        np.array([ZeroStatus.HELD, ZeroStatus.NONE], np.uint8),
        np.array([0.002, np.nan]),
        np.array([-0.003, np.nan]),
        np.array([500 * MS, 0]),
    )
    told = replace(
        plain.forces,
        cause=np.array([Cause.NONE, Cause.ELEMENT_SHORTED], np.uint8),
        flags=np.array([Flag.CONTACT | Flag.DEGRADED_TIMING, 0], np.uint8),
        baseline=zero,
    )
    metrics.observe(plain._replace(forces=told))
    get = shown(metrics).get_sample_value
    lf, rr = {"leg": "lf"}, {"leg": "rr"}
    assert (get("footsense_leg_phase", lf), get("footsense_leg_phase", rr)) == (Phase.VALID, Phase.FAULTED)
    assert get("footsense_leg_cause", rr) == Cause.ELEMENT_SHORTED
    assert (get("footsense_leg_contact", lf), get("footsense_leg_contact", rr)) == (1, 0)
    assert get("footsense_degraded_timing") == 1
    assert get("footsense_zero_status", lf) == ZeroStatus.HELD
    assert get("footsense_zero_mean_offset_farads", lf) == pytest.approx(2e-15)
    assert get("footsense_zero_worst_offset_farads", lf) == pytest.approx(-3e-15)
    assert get("footsense_zero_age_seconds", lf) == pytest.approx(1.5)
    assert math.isnan(get("footsense_zero_age_seconds", rr) or 0)
    off = replace(told, flags=np.zeros(2, np.uint8), cause=np.zeros(2, np.uint8))
    metrics.observe(plain._replace(forces=off))
    assert (get("footsense_leg_contact", lf), get("footsense_leg_cause", rr)) == (0, 0)
    assert get("footsense_degraded_timing") == 0


def test_the_file_describes_itself_and_is_gone_at_the_end(tmp_path: Path) -> None:
    """A reader needs nothing but the file; closing twice is once."""
    families = [
        Family("a_total", "counter", "A.", {"leg": ["lf", "rr"]}),
        Family("b", "histogram", "B.", {}, [1.0]),
    ]
    counters = SharedCounters(families, tmp_path)
    counters.cells[counters.first["b"] + 2] = 2.5
    read, cells = read_counters(counters.path)
    assert read == families
    assert cells.tolist() == [0, 0, 0, 0, 2.5]
    counters.close()
    counters.close()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("content", [b"", b"short", b"FSCOUNT1" + b"\xff" * 40, b"x" * 64])
def test_another_file_is_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    """Neither an empty nor a foreign file is taken for counters."""
    path = tmp_path / "file"
    path.write_bytes(content)
    with pytest.raises(FootsenseError, match=r"file does not hold footsense's counters"):
        read_counters(path)


def test_a_missing_file_is_one_line(tmp_path: Path) -> None:
    """The reason is the system's."""
    with pytest.raises(FootsenseError, match="No such file"):
        read_counters(tmp_path / "missing")


def test_the_exporter_shows_the_counters_and_ends_when_told(metrics: Metrics) -> None:
    """A scrape over HTTP has the living numbers."""
    exporter = start_exporter(metrics.path, "127.0.0.1", 0)
    metrics.observe(cycle(0, (State.VALID, State.VALID)))
    with urllib.request.urlopen(f"http://127.0.0.1:{exporter.port}/metrics", timeout=10) as answer:
        text = answer.read().decode()
    assert "footsense_scans_total 1.0" in text.splitlines()
    with pytest.raises(
        ConfigError, match=rf"127\.0\.0\.1:{exporter.port}: Address already in use; choose another"
    ):
        start_exporter(metrics.path, "127.0.0.1", exporter.port)
    exporter.close()
    exporter.close()


def test_an_exporter_that_was_killed_is_started_again(metrics: Metrics) -> None:
    """Its successor listens on the same port and shows the same numbers; the service has nothing to do with it."""
    metrics.observe(cycle(0, (State.VALID, State.VALID)))
    keeper = subprocess.Popen(
        [
            *(sys.executable, "-m", "footsense.telemetry.exporter_keeper"),
            *("--file", str(metrics.path), "--port", "0"),
        ],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert keeper.stdout is not None
    _, port, pid = keeper.stdout.readline().split()
    os.kill(int(pid), signal.SIGKILL)
    _, same_port, successor = keeper.stdout.readline().split()
    assert (same_port, successor != pid) == (port, True)
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=10) as answer:
        assert b"footsense_scans_total 1.0" in answer.read().splitlines()
    _, errors = keeper.communicate(timeout=10)
    assert keeper.returncode == 0
    assert "the metrics exporter ended (signal 9) and is started again" in errors
    assert not metrics.path.exists()


def test_an_address_of_another_machine_is_not_blamed_on_the_port(metrics: Metrics) -> None:
    """The remedy names the key that is wrong; 192.0.2.0/24 is nobody's, by RFC 5737."""
    with pytest.raises(ConfigError, match=r"192\.0\.2\.1:9108: Cannot assign .*; metrics\.address has to be"):
        start_exporter(metrics.path, "192.0.2.1", 9108)


def test_an_exporter_without_counters_is_one_line(tmp_path: Path) -> None:
    """What the exporter cannot do is told by whoever started it."""
    with pytest.raises(FootsenseError, match=r"exporter did not start: .*missing: No such file"):
        start_exporter(tmp_path / "missing", "127.0.0.1", 0)


def test_the_exporter_ends_after_a_killed_service_and_removes_its_file(tmp_path: Path) -> None:
    """SIGKILL leaves neither a process nor a file behind."""
    service = (
        "import sys; from pathlib import Path\n"
        "from footsense.frames import CanStats\n"
        "from footsense.telemetry.exporter_process import start_exporter\n"
        "from footsense.telemetry.metrics import Metrics\n"
        "metrics = Metrics(('lf',), CanStats(), directory=Path(sys.argv[1]))\n"
        "exporter = start_exporter(metrics.path, '127.0.0.1', 0)\n"
        "print(exporter._process.pid, flush=True)\n"
        "sys.stdin.read()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", service, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        exporter = os.pidfd_open(int(process.stdout.readline()))
        process.send_signal(signal.SIGKILL)
    # A process descriptor becomes readable when its process has ended.
    assert select.select([exporter], [], [], 10.0)[0]
    os.close(exporter)
    assert list(tmp_path.iterdir()) == []
