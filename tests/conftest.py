"""How hypothesis searches: without a deadline, because the machine may be busy, and with the same examples each time.

A change is judged by what it changes; `pytest --hypothesis-profile random` tries other examples, and `few` is for an
emulated computer.

Commands silence loggers of their process; each test begins with all of them audible.
"""

import logging
from collections.abc import Iterator

import pytest
from hypothesis import HealthCheck, settings

import footsense  # noqa: F401 - before any test imports numpy: it limits numpy's threads

settings.register_profile("same", deadline=None, derandomize=True)
settings.register_profile("random", deadline=None)
settings.register_profile(
    "few", deadline=None, derandomize=True, max_examples=10, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("same")


@pytest.fixture(autouse=True)
def _audible_loggers() -> Iterator[None]:
    """Undo after each test what a command silenced: a later test in the same process reads the log."""
    yield
    logging.disable(logging.NOTSET)
    logging.getLogger("footsense.acquisition").setLevel(logging.NOTSET)
