"""What every decoder may do with bytes of any content: give the right answer, or refuse in one line."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from footsense.errors import FootsenseError

#: Examples of each test in a round of `python -m tests.fuzz`; 0 in the suite.
EXAMPLES = int(os.environ.get("FOOTSENSE_FUZZ_EXAMPLES", "0"))

#: How much is tried: the same examples each time, few enough for every run of the suite.
TRIED = settings(
    max_examples=EXAMPLES or 60,
    derandomize=not EXAMPLES,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


def nested(leaves: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    """Return leaves, and lists and dictionaries of them."""
    return st.recursive(
        leaves | st.text(max_size=8),
        lambda inner: st.lists(inner, max_size=9) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
        max_leaves=9,
    )


#: Whatever JSON can say.
anything = nested(st.none() | st.booleans() | st.integers() | st.floats() | st.just(10**400))
#: JSON that is none of what is expected: nesting and numbers without end, and the wrong kind.
NO_MESSAGE = ("", "[" * 100_000, '{"format":' * 50_000, "1" * 10_000, "{}", "null", "[]", '{"format": 2e400}')

_LIMITED = """
import pathlib, resource, sys
from footsense.errors import FootsenseError
from footsense.estimation.network import Network
from footsense.recording.replay import Replay
size = 4096 * int(pathlib.Path("/proc/self/statm").read_text().split()[0])
resource.setrlimit(resource.RLIMIT_AS, (size + (int(sys.argv[1]) << 20),) * 2)
resource.setrlimit(resource.RLIMIT_CPU, (60, 60))
read = {".mcap": lambda path: list(Replay(path)), ".onnx": lambda path: Network(path, 12)}
for path in map(pathlib.Path, sys.argv[2:]):
    try:
        read[path.suffix](path)
        print(path, "taken")
    except FootsenseError as error:
        assert str(error).isprintable()
        print(path, "refused:", error)
"""


def judged_with_little_memory(mebibytes: int, *files: Path) -> list[str]:
    """Open files in a process that may be hurt, with so much more memory than it has; return a line for each."""
    done = subprocess.run(
        [sys.executable, "-c", _LIMITED, str(mebibytes), *map(str, files)],
        capture_output=True,
        text=True,
        check=False,
        timeout=100,
    )
    lines = [line for line in done.stdout.splitlines() if " taken" in line or " refused: " in line]
    assert (done.returncode, len(lines)) == (0, len(files)), (done.stdout[-500:], done.stderr[-500:])
    return lines


def refusal(attempt: Callable[[], object], error: type[Exception] = FootsenseError) -> str | None:
    """Return the one line with which something is refused, None if it is not; any other error passes through."""
    try:
        attempt()
    except error as refused:
        line = str(refused)
        assert line
        assert line.isprintable()
        return line
    return None
