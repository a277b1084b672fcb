"""What every decoder may do with bytes of any content: give the right answer, or refuse in one line."""

import os
from collections.abc import Callable

from hypothesis import HealthCheck, settings

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
