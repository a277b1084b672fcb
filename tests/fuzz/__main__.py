"""`python -m tests.fuzz --minutes 60`: the tests of this folder with other and more examples, until one fails.

Each round has a seed of its own, which repeats what it found.
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path

from footsense.clock import MonotonicClock

_NS_PER_MINUTE = 60 * 10**9
#: Examples of each test in a round: some minutes on one processor.
_EXAMPLES = 1000


def main() -> int:
    """Run rounds until the time is over; return the exit code of pytest."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0, help="no round begins later; default: 60")
    parser.add_argument("--seed", type=int, default=None, help="repeat the round of this seed, and no other")
    options = parser.parse_args()
    environment = {**os.environ, "FOOTSENSE_FUZZ_EXAMPLES": str(_EXAMPLES)}
    clock = MonotonicClock()
    end_ns = clock.now_ns() + round(options.minutes * _NS_PER_MINUTE)
    failed, n_rounds = 0, 0
    while not failed and (not n_rounds or (options.seed is None and clock.now_ns() < end_ns)):
        seed = int.from_bytes(os.urandom(4)) if options.seed is None else options.seed
        print(f"fuzz: round {n_rounds + 1}, --seed {seed}", flush=True)
        tests = ["-m", "pytest", "-q", "-x", f"--hypothesis-seed={seed}", str(Path(__file__).parent)]
        failed = subprocess.run([sys.executable, *tests], env=environment, check=False).returncode
        n_rounds += 1
    return failed


if __name__ == "__main__":
    sys.exit(main())
