"""Trials of the service: what happens to its process, its machine and its files."""

import json

from firmware_interface.can.codes import State
from tests.kernel.robot import CONFIG, Trial, matching

_FOOTSENSE = "/opt/footsense/bin/footsense"


def test_stopped_process(trial: Trial) -> None:
    """Loop stopped (SIGSTOP): the watchdog restarts the service."""
    pid = trial.robot.pid
    trial.machine.run(f"kill -STOP {pid}")
    trial.recovered()
    assert trial.robot.pid not in {0, pid}


def test_stop_and_start(trial: Trial) -> None:
    """`systemctl stop footsense`, then `start`."""
    trial.machine.run("systemctl stop footsense")
    assert {frame.can_id: frame.data for frame in trial.can.since(trial.mark)}[0x701] == b"\x04"
    trial.machine.run("systemctl start footsense --no-block")
    trial.recovered()


def test_stepped_clock(trial: Trial) -> None:
    """Clock stepped by an hour forward, then three hours back."""
    pid = trial.robot.pid
    for step in ("+1 hour", "-3 hours", "+2 hours"):
        trial.machine.run(f"date --set '{step}'")
        trial.can.wait_for(State.VALID)
        trial.machine.run("sleep 2")
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
    """Reboot."""
    trial.machine.reboot()
    trial.can.wait_for(State.VALID)
    started_s = float(trial.machine.run("systemctl show -P ActiveEnterTimestampMonotonic footsense")) / 1e6
    trial.row.recovered_s = started_s
    trial.row.shown = "all valid; the time is that from the kernel's start to the service's first scan"


def test_second_process(trial: Trial) -> None:
    """`footsense probe`, and a second `footsense run`, beside the service."""
    pid = trial.robot.pid
    for command in ("probe", "run --duration 5"):
        code, output = trial.machine.shell.wait(
            trial.machine.shell.start(f"{_FOOTSENSE} {command} --config {CONFIG}")
        )
        assert code == 69, output
        assert "/dev/i2c-1" in output.strip().splitlines()[-1]
    trial.recovered()
    assert trial.robot.pid == pid
    assert trial.can.all_states(trial.mark) == {State.VALID}, trial.can.causes(trial.mark)


def test_full_disk(trial: Trial) -> None:
    """Recording to a disk with room for 120 kB: forces go on; `recover` and `replay` of what is there."""
    run, shell = trial.machine.run, trial.machine.shell
    run("systemctl stop footsense; mount -t tmpfs -o size=120k tmpfs /mnt")
    try:
        recording = shell.start(
            f"{_FOOTSENSE} run --config {CONFIG} --record /mnt/walk.mcap --duration 14 --summary json"
        )
        code, output = shell.wait(recording)
        assert code == 74, output
        (partial,) = run("ls /mnt").split()
        run(f"{_FOOTSENSE} recover /mnt/{partial} --output /tmp/walk.mcap")
        replayed = json.loads(run(f"{_FOOTSENSE} replay /tmp/walk.mcap --summary json 2>/dev/null"))
        assert replayed["cycles"] > 50
    finally:
        run("umount /mnt; rm -f /tmp/walk.mcap; systemctl start footsense --no-block")
    trial.recovered()


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


def test_missing_can(trial: Trial) -> None:
    """`systemctl start` without can0, which comes later."""
    run = trial.machine.run
    run("systemctl stop footsense; ip link del can0")
    start_s = trial.chips.monotonic_s
    trial.machine.shell.wait(trial.machine.shell.start("systemctl start footsense"))
    took_s = trial.chips.monotonic_s - start_s
    run("sleep 5; ip link add can0 type vcan; ip link set can0 up")
    trial.recovered()
    assert took_s < 12.0
    trial.row.shown += f"`systemctl start` returned after {took_s:.1f} s"


def test_missing_i2c_dev(trial: Trial) -> None:
    """`systemctl start` without /dev/i2c-1, which comes later."""
    run = trial.machine.run
    run("systemctl stop footsense; until modprobe -r i2c-dev; do sleep 0.1; done")
    start_s = trial.chips.monotonic_s
    trial.machine.shell.wait(trial.machine.shell.start("systemctl start footsense"))
    took_s = trial.chips.monotonic_s - start_s
    run("sleep 5; modprobe i2c-dev")
    trial.recovered()
    assert took_s < 12.0
    trial.row.shown += f"`systemctl start` returned after {took_s:.1f} s"
