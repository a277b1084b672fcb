"""Trials of the service: what happens to its process, its machine and its files."""

from statistics import quantiles

import pytest

from firmware_interface.can.codes import State
from firmware_interface.can.force import QUALITY, QUALITY_ID
from tests.kernel.can_stream import LEGS
from tests.kernel.robot import CONFIG, Trial, matching

_FOOTSENSE = "/opt/footsense/bin/footsense"
#: Longest time that a missing device may hold up a start or a boot [s].
_LONGEST_BLOCK_S = 5.0
#: Of 10, as `systemd-analyze security` counts.
_MOST_EXPOSURE = 1.5
#: Of a force: older ones are stale [ms].
_MOST_AGE_MS = 28.0


def test_ages(trial: Trial) -> None:
    """Feet in the air for 4 s: ages of the forces when they were sent, and what it takes of the processor."""
    units = ("footsense", "footsense-exporter", "chips")

    def totals() -> list[float]:
        used = "".join(f"systemctl show -P CPUUsageNSec {unit}; " for unit in units)
        metrics = (
            "curl -s http://127.0.0.1:9108/metrics | grep -E '^footsense_(missed_deadlines|cycles)_total'"
        )
        clock = "cut -d' ' -f1 /proc/uptime"
        return [
            float(line.split()[-1]) for line in trial.machine.run(f"{clock}; {used}{metrics}").splitlines()
        ]

    before, mark = totals(), trial.can.mark
    trial.machine.run("sleep 4")
    frames = [frame for frame in trial.can.since(mark) if frame.can_id - QUALITY_ID in LEGS]
    passed_s, *used_ns, cycles, missed = (now - then for now, then in zip(totals(), before, strict=True))
    ages_ns = [QUALITY.decode(frame.can_id, frame.data).age_ns or 0 for frame in frames]
    middle, *_, worst = (each * 1e-6 for each in quantiles(ages_ns, n=100, method="inclusive")[49:])
    shares = ", ".join(
        f"{unit} {ns * 1e-7 / passed_s:.0f} %" for unit, ns in zip(units, used_ns, strict=True)
    )
    trial.row.shown = (
        f"ages {middle:.1f} ms, at most {worst:.1f} ms of 99 %; {cycles / passed_s:.0f} estimates a second; "
        f"{missed:.0f} missed deadlines; {shares}"
    )
    assert trial.can.all_states(mark) == {State.VALID}
    assert worst < _MOST_AGE_MS
    assert missed == 0


def test_stopped_process(trial: Trial) -> None:
    """Loop stopped (SIGSTOP): the watchdog restarts the service."""
    pid = trial.robot.pid
    trial.machine.run(f"kill -STOP {pid}")
    trial.recovered()
    assert trial.robot.pid not in {0, pid}


def test_stepped_clock(trial: Trial) -> None:
    """Clock stepped by an hour forward, then three hours back."""
    pid = trial.robot.pid
    for step in ("+1 hour", "-3 hours", "+2 hours"):
        trial.machine.run(f"date --set '{step}'")
        trial.can.wait_for(State.VALID)
    assert trial.robot.pid == pid
    assert trial.can.all_states(trial.mark) == {State.VALID}, trial.can.causes(trial.mark)
    trial.row.shown = "all valid"


def test_busy_metrics_port(trial: Trial) -> None:
    """Another program on port 9108 when service and exporter start, then it ends."""
    run = trial.machine.run
    run("systemctl stop footsense footsense-exporter")
    run("systemd-run --quiet --unit squatter python3 -m http.server --bind 127.0.0.1 9108")
    run("until curl -s http://127.0.0.1:9108/ >/dev/null; do sleep 0.2; done")
    run("systemctl start footsense footsense-exporter --no-block")
    trial.can.wait_for(State.VALID)
    run("systemctl stop squatter")
    trial.can.wait(
        "the metrics",
        lambda: "footsense_up 1" in run("curl -s http://127.0.0.1:9108/metrics || true"),
    )
    trial.recovered()


def test_reboot(trial: Trial) -> None:
    """Reboot, with the can0 of `70-can0-trial.netdev` alone."""
    trial.machine.run("rm -f /etc/systemd/network/70-can0.netdev")
    trial.machine.reboot()
    trial.can.wait_for(State.VALID)
    trial.row.recovered_s = trial.machine.active_since_s("footsense")
    trial.row.shown = "all valid; the time is that from the kernel's start to the service's first scan"


def test_boot_without_devices(trial: Trial) -> None:
    """Reboot without can0 and /dev/i2c-1, which come later."""
    run = trial.machine.run
    files = "/etc/systemd/network/70-can0-trial.netdev", "/etc/modules-load.d/footsense.conf"
    for file in files:
        run(f"mv {file} {file}.away")
    try:
        trial.machine.reboot()
        mark = trial.can.mark
        run("until systemctl --quiet is-active multi-user.target; do sleep 0.2; done")
    finally:
        for file in files:
            run(f"mv {file}.away {file}")
    starting = run("journalctl -b -u footsense -o short-monotonic --no-pager | grep -m 1 Starting")
    held_s = float(starting.partition("]")[0].strip("[ ")) - trial.machine.active_since_s("basic.target")
    assert trial.can.since(mark) == []
    run("modprobe i2c-dev; ip link add can0 type vcan; ip link set can0 up")
    trial.recovered()
    trial.row.shown = f"nothing; devices held the service up for {held_s:.1f} s"
    assert held_s <= _LONGEST_BLOCK_S


def test_second_process(trial: Trial) -> None:
    """`footsense probe`, and a second `footsense run`, beside the service."""
    pid = trial.robot.pid
    shell = trial.machine.shell
    for asked in [
        shell.start(f"{_FOOTSENSE} {each} --config {CONFIG}") for each in ("probe", "run --duration 5")
    ]:
        code, output = shell.wait(asked)
        assert code == 69, output
        assert "/dev/i2c-1" in output.strip().splitlines()[-1]
    trial.recovered()
    assert trial.robot.pid == pid
    assert trial.can.all_states(trial.mark) == {State.VALID}, trial.can.causes(trial.mark)


def test_no_thread_of_another(trial: Trial) -> None:
    """Threads and files of the service: none of ONNX Runtime's telemetry."""
    pid = trial.robot.pid
    threads = trial.machine.run(f"ps -L -o class=,comm= -p {pid}").splitlines()
    files = trial.machine.run(
        "find / -xdev -path '*Microsoft*' -newer /etc/hostname 2>/dev/null || true"
    ).split()
    assert files == []
    assert not matching(trial.machine.run("journalctl -u footsense -b --no-pager").splitlines(), "telemetry")
    trial.row.shown = f"{len(threads)} threads, all footsense's"


@pytest.mark.parametrize(
    ("device", "away", "back"),
    [
        ("can0", "ip link del can0", "ip link add can0 type vcan; ip link set can0 up"),
        (
            "/dev/i2c-3",
            "echo 1 > /sys/module/feet_adapter/parameters/plugged",
            "echo 3 > /sys/module/feet_adapter/parameters/plugged",
        ),
    ],
)
def test_missing_device(trial: Trial, device: str, away: str, back: str) -> None:
    """`systemctl start` without {device}, which comes later."""
    trial.machine.run(f"systemctl stop footsense; {away}")
    took_s = trial.robot.started_within_s()
    trial.machine.run(back)
    trial.recovered()
    trial.row.shown = f"{trial.can.shown(trial.mark)}; `systemctl start` returned after {took_s:.1f} s"
    assert took_s <= _LONGEST_BLOCK_S


def test_missing_group(trial: Trial) -> None:
    """`systemctl start` without the group i2c, then with an adapter of another group: each is set right later."""
    run, cursor = trial.machine.run, trial.machine.journal_cursor
    run("systemctl stop footsense; groupmod --new-name away i2c")
    try:
        trial.robot.started_within_s()
    finally:
        run("groupmod --new-name i2c away")
    trial.can.wait_for(State.VALID)
    run("systemctl stop footsense; chgrp root /dev/i2c-1")
    try:
        trial.robot.started_within_s()
    finally:
        run("chgrp i2c /dev/i2c-1")
    trial.recovered()
    lines = trial.machine.journal(cursor)
    assert matching(lines, "status=216/GROUP")
    assert matching(lines, "/dev/i2c-1: permission denied; .*group i2c"), lines
    assert matching(lines, "status=69/UNAVAILABLE")


def test_unreadable_configuration(trial: Trial) -> None:
    """Configuration that the service may not read: exit 78, no further attempt until it is started again."""
    run, cursor = trial.machine.run, trial.machine.journal_cursor
    run(f"systemctl stop footsense; chmod 600 {CONFIG}")
    try:
        trial.robot.started_within_s()
        lines = trial.machine.journal(cursor)
        assert trial.robot.restarts == 0
    finally:
        run(f"chmod 644 {CONFIG}")
    run("systemctl start footsense --no-block")
    trial.recovered()
    assert matching(lines, "status=78/CONFIG")
    assert matching(lines, CONFIG), lines
    assert not matching(lines, "Usage:")


def test_what_the_units_may_do(trial: Trial) -> None:
    """`systemd-analyze security`: exposure of both units, of 10."""
    levels = {
        unit: float(trial.machine.run(f"systemd-analyze security --no-pager {unit} | tail -1").split()[-3])
        for unit in ("footsense", "footsense-exporter")
    }
    trial.row.shown = ", ".join(f"{unit} {level:.1f}" for unit, level in levels.items())
    assert max(levels.values()) <= _MOST_EXPOSURE
