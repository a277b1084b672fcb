"""A process beside a service: it waits for one, follows it to its end, waits for the next, and ends with a signal."""

import subprocess
import sys
from contextlib import closing
from pathlib import Path

from footsense.ring.cycle_ring import CycleRing
from tests.support.cycles import LEGS, cycle, status

FOLLOW = """
import pathlib, sys
from footsense.ring import following

class Follower:
    def __init__(self, reader):
        print("begins with", reader.header["scene"], flush=True)
    def add(self, cycles):
        if cycles:
            print(len(cycles), "cycles", flush=True)
    def end(self):
        print("ends", flush=True)

following._POLL_PERIOD_S = 0.01
following.follow_services(pathlib.Path(sys.argv[1]), Follower)
"""


def test_services_are_followed_one_after_the_other(tmp_path: Path) -> None:
    path = tmp_path / "ring"
    command = [sys.executable, "-c", FOLLOW, str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert "ring: no service runs here" in process.stderr.readline()
        for scene in ("flat", "rough"):
            with closing(CycleRing(path, LEGS, {"scene": scene}, 40.0, status)) as ring:
                assert process.stdout.readline() == f"begins with {scene}\n"
                ring.observe(cycle(0))
                assert process.stdout.readline() == "1 cycles\n"
                if scene == "rough":
                    process.terminate()
                    assert process.stdout.readline() == "ends\n"
            if scene == "flat":
                assert process.stdout.readline() == "ends\n"
        assert process.wait(timeout=20) == 0
