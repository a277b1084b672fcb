"""Trials of CAN: interfaces that go, queues that are full, a kernel that keeps its network lock."""

from firmware_interface.can.codes import State
from tests.kernel.robot import Trial, matching


def test_can_down_and_up(trial: Trial) -> None:
    """`ip link set can0 down` for 2 s, then `up`."""
    pid, cursor = trial.robot.pid, trial.machine.journal_cursor
    trial.machine.run("ip link set can0 down; sleep 2; ip link set can0 up")
    trial.recovered()
    assert trial.robot.pid == pid
    lines = trial.machine.journal(cursor)
    assert matching(lines, "can0.*back")
    assert len(lines) <= 4, lines


def test_network_lock_is_held(trial: Trial) -> None:
    """The kernel's network lock (RTNL) is held for 4 s while can0 is down."""
    pid = trial.robot.pid
    run = trial.machine.run
    run("ip link set can0 down; sleep 1; modprobe rtnl_hold ms=4000 || true; ip link set can0 up")
    trial.recovered()
    assert trial.robot.pid == pid


def test_full_queue(trial: Trial) -> None:
    """A queue of can0 that is full half of the time (netem, 3 frames)."""
    pid, cursor = trial.robot.pid, trial.machine.journal_cursor
    run = trial.machine.run
    queue = run(
        "set -e; tc qdisc replace dev can0 root netem delay 200ms limit 3; sleep 3\n"
        "tc -s qdisc show dev can0; tc qdisc del dev can0 root"
    )
    trial.recovered()
    assert trial.robot.pid == pid
    metrics = run("curl -s http://127.0.0.1:9108/metrics").splitlines()
    dropped = matching(metrics, "^footsense_can_dropped_frames_total")
    assert float(dropped[0].split()[-1]) > 0
    lines = trial.machine.journal(cursor)
    assert matching(lines, "can0.*queue is full"), (lines, dropped, queue)
    trial.row.shown = f"{trial.can.shown(trial.mark)}; {float(dropped[0].split()[-1]):.0f} frames dropped"


def test_foreign_frames(trial: Trial) -> None:
    """Three thousand frames of others, as fast as they go (`cangen`)."""
    pid = trial.robot.pid
    trial.machine.run("cangen can0 -g 0 -n 3000 -I 7A0 -L 8 -i")
    trial.recovered()
    assert trial.robot.pid == pid
    assert State.ABSENT not in trial.can.all_states(trial.mark)
